import { html } from "../ui.js";

export const Page = () => html`<h1>swarmbench</h1>`;
