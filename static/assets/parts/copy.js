// Values to copy, and secrets that are shown once.
import { html, useRef, useState } from "../ui.js";
import { copied } from "./copied.js";
import { visible } from "./text.js";

/** Copies the text of an element. If the browser forbids that, selects it. */
function useCopy() {
  const shown = useRef(/** @type {HTMLElement | null} */ (null));
  const [note, setNote] = useState("");
  const copy = async (/** @type {string} */ text) => {
    const isCopied = await copied(text);
    if (!isCopied && shown.current) getSelection()?.selectAllChildren(shown.current);
    setNote(isCopied ? "Copied" : "Selected: press Ctrl+C");
  };
  return { shown, copy, note };
}

/** A value with a button that copies it. @param {{value: string, label: string}} props label: what it is, for those who hear the button */
export function Copyable({ value, label }) {
  const { shown, copy, note } = useCopy();
  return html`<span class="copyable">
    <code class="foreign" ref=${shown}>${visible(value)}</code>
    <button type="button" onClick=${() => copy(value)} aria-label=${`Copy ${label}`}>Copy</button>
    <span class="muted small" role="status">${note}</span>
  </span>`;
}

/** Lines, of commands mostly, with one button for all. @param {{lines: string[], label: string, what?: string}} props */
export function Commands({ lines, label, what = "the commands" }) {
  const { shown, copy, note } = useCopy();
  const text = lines.join("\n");
  return html`<pre tabindex="0" role="region" aria-label=${label} ref=${shown}>${visible(text, true)}</pre>
    <p class="buttons">
      <button type="button" onClick=${() => copy(text)}>Copy ${what}</button>
      <span class="muted small" role="status">${note}</span>
    </p>`;
}

/**
 * A key or token that was just made, for someone else; nothing before.
 * @param {{value?: string, label: string, to: string, children?: any}} props to: who gets it
 */
export const Made = ({ value, label, to, children }) => html`<div role="status">
  ${value && html`<${Secret} value=${value} label=${label}><p>Give it to ${to} by a way that nobody else reads. It cannot be shown again.</p>${children}<//>`}
</div>`;

/**
 * A key, code or token that the server shows once.
 * @param {{value: string, label: string, children?: any}} props children: what to do with it
 */
export function Secret({ value, label, children }) {
  return html`<div class="inset" role="group" aria-label=${label}>
    <p><strong>${label}</strong> <span class="badge">shown once</span></p>
    <p><${Copyable} value=${value} label=${label} /></p>
    ${children}
  </div>`;
}
