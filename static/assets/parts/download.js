// Files from the server. A link cannot send the key of the tab, so with a key the file is fetched first.
import { html, useState } from "../ui.js";
import { key, send } from "../api.js";
import { Text } from "./text.js";

/** @param {{path: string, name: string, label: string}} props name: that of the file */
export function Download({ path, name, label }) {
  const [state, setState] = useState({ isLoading: false, problem: "" });
  if (!key()) return html`<a href=${path} download=${name}>${label}</a>`;
  const fetched = async () => {
    setState({ isLoading: true, problem: "" });
    try {
      save(await (await send(path)).blob(), name);
      setState({ isLoading: false, problem: "" });
    } catch (error) {
      setState({ isLoading: false, problem: error instanceof Error ? error.message : "" });
    }
  };
  return html`<button type="button" onClick=${fetched} disabled=${state.isLoading}>${state.isLoading ? "Downloading …" : label}</button>
    ${state.problem && html` <span class="bad" role="alert"><${Text} value=${state.problem} /></span>`}`;
}

/** @param {Blob} blob @param {string} name */
function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  // The browser has begun to read it by then.
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
