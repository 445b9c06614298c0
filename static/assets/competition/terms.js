// The terms of a competition, and accepting their newest version.
import { html } from "../ui.js";
import { request } from "../api.js";
import { ActButton } from "../parts/act.js";
import { visible } from "../parts/text.js";
import { Prose } from "./prose.js";

/** @param {{terms: {version: number, text: string}}} props */
export const Terms = ({ terms }) => html`<section aria-labelledby="terms">
  <h2 id="terms">Terms, version ${terms.version}</h2>
  <${Prose} text=${terms.text} label="The text of the terms" />
</section>`;

/**
 * The version that an entrant has accepted, and a button that accepts a newer one.
 * @param {{terms: {version: number, text: string}, one: any, path: string, mayAccept: boolean, changed: () => void}} props path: of the entrant
 */
export function Accepted({ terms, one, path, mayAccept, changed }) {
  const { version } = terms;
  if (one.terms === version) return html`<p>Terms: version ${version}, the newest, was accepted.</p>`;
  const accept = () => request(path, { method: "PATCH", body: { accepts_terms: version } });
  return html`<div class="inset">
    <p><strong>The terms have changed.</strong> ${one.terms ? `Version ${one.terms} was accepted` : "None was accepted"}; the newest is version ${version}.</p>
    ${mayAccept &&
    // Each version has its own dialog: nobody accepts a text that changed while it was read.
    html`<p><${ActButton} key=${version} label=${`Accept version ${version}`} of=${`of the terms for ${visible(one.name)}`} isDangerous=${false} title=${`Accept version ${version} of the terms?`} done=${changed} act=${accept}>
      <${Prose} text=${terms.text} label=${`Version ${version} of the terms`} />
    <//></p>`}
  </div>`;
}
