// Values to copy, and secrets that are shown once.
import { html, useRef, useState } from "../ui.js";
import { visible } from "./text.js";

/** Copies a text. If the browser forbids that, selects the element that shows it. */
function useCopy() {
  const shown = useRef(/** @type {HTMLElement | null} */ (null));
  const [note, setNote] = useState("");
  /** @param {string} text */
  const copy = async (text) => {
    try {
      await navigator.clipboard.writeText(text);
      setNote("Copied");
    } catch {
      if (shown.current) getSelection()?.selectAllChildren(shown.current);
      setNote("Selected: press Ctrl+C");
    }
  };
  return { shown, copy, note };
}

/**
 * A value with a button that copies it.
 * @param {{value: string, label: string}} props label: what it is, for those who hear the button
 */
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
