// Filters above lists.
import { html } from "../ui.js";

/** @param {{label: string, value: string, options: string[], onChange: (value: string) => void}} props */
export const Choice = ({ label, value, options, onChange }) => html`<label>
  ${label}${" "}
  <select onChange=${(/** @type {any} */ event) => onChange(event.currentTarget.value)}>
    <option value="" selected=${value === ""}>all</option>
    ${options.map((option) => html`<option value=${option} selected=${value === option}>${option}</option>`)}
  </select>
</label>`;

/** A text to filter by, used when it is complete. @param {{label: string, value: string, onChange: (value: string) => void}} props */
export const Exact = ({ label, value, onChange }) =>
  html`<label>${label} <input type="search" value=${value} placeholder="its whole name" onChange=${(/** @type {any} */ event) => onChange(event.currentTarget.value.trim())} /></label>`;
