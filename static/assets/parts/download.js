// Files of the server. Files that need a key are fetched, as a link cannot send one.
import { html, useState } from "../ui.js";
import { key, send } from "../api.js";

/** @param {Blob} blob @param {string} name */
export function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** @param {{href: string, name: string, children?: unknown}} props */
export function Download({ href, name, children }) {
  const [problem, setProblem] = useState("");
  const clicked = async (event) => {
    if (!key()) return;
    event.preventDefault();
    setProblem("");
    try {
      save(await (await send(href)).blob(), name);
    } catch (error) {
      setProblem(/** @type {Error} */ (error).message);
    }
  };
  return html`<a href=${href} download=${name} onClick=${clicked}>${children}</a>${problem && html` <span class="bad" role="alert">${problem}</span>`}`;
}
