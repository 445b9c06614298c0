// Texts to copy that are not on the page. Games are watched more often than values are copied: those have a module of their own.
import { html, useState } from "../ui.js";

/** Copies a text; false where the browser does not allow it. @param {string} text */
export const copied = (text) => Promise.resolve(navigator.clipboard?.writeText(text) ?? Promise.reject()).then(() => true, () => false);

/** Copies a text that is not on the page, and says so; shows the text where the browser does not allow it. */
export function useCopied() {
  const [note, setNote] = useState(/** @type {any} */ (null));
  const copy = async (/** @type {string} */ text, /** @type {string} */ what) =>
    setNote((await copied(text))
      ? `Copied: ${what}.`
      : html`<label>${what} <input readonly size="40" value=${text} onFocus=${(event) => event.currentTarget.select()} /></label>`);
  return { copy, note };
}
