// The line at the top of every page: links, and the key of this tab.
import { html, useEffect, useRef, useState } from "../ui.js";
import { key, onRemembered, remember } from "../api.js";

const PLACES = [
  ["/boards", "Boards", /^\/board/],
  ["/competitions", "Competitions", /^\/competitions/],
  ["/episodes", "Games", /^\/(episodes|imports|compare)/],
  ["/runs", "Runs", /^\/runs/],
  ["/play", "Play", /^\/play/],
  ["/desk", "Desk", /^\/desk/],
];

export function openKeyDialog() {
  const dialog = document.getElementById("key-dialog");
  if (dialog instanceof HTMLDialogElement && !dialog.open) dialog.showModal();
}

/** @param {{path: string}} props */
export function Header({ path }) {
  const [hasKey, setHasKey] = useState(Boolean(key()));
  useEffect(() => onRemembered(() => setHasKey(Boolean(key()))), []);
  return html`<header class="top">
    <a class="home" href="/">swarmbench</a>
    <nav aria-label="Pages">
      ${PLACES.map(
        ([href, name, paths]) =>
          html`<a href=${href} aria-current=${/** @type {RegExp} */ (paths).test(path) ? "page" : undefined}>${name}</a>`,
      )}
      <a href="/docs">API</a>
    </nav>
    <button type="button" class="quiet" onClick=${openKeyDialog}>${hasKey ? "Key: entered" : "Key"}</button>
    <${KeyDialog} hasKey=${hasKey} />
  </header>`;
}

/** @param {{hasKey: boolean}} props */
function KeyDialog({ hasKey }) {
  const dialog = useRef(/** @type {HTMLDialogElement | null} */ (null));
  const input = useRef(/** @type {HTMLInputElement | null} */ (null));
  /** @param {string | null} value */
  const set = (value) => {
    remember("key", value);
    if (input.current) input.current.value = "";
    dialog.current?.close();
    location.reload();
  };
  /** @param {Event} event */
  const entered = (event) => {
    event.preventDefault();
    const value = input.current?.value.trim();
    if (value) set(value);
  };
  return html`<dialog id="key-dialog" ref=${dialog} aria-labelledby="key-title">
    <form onSubmit=${entered}>
      <h2 id="key-title">Your key</h2>
      <p>
        A key (<code>secret_…</code>) from an organizer shows what is private, starts games, and opens the desk. It stays in
        this tab, and is forgotten when the tab is closed.
      </p>
      <label>Key <input ref=${input} type="password" autocomplete="off" spellcheck="false" /></label>
      <p class="buttons">
        <button type="submit" class="primary">Use this key</button>
        ${hasKey && html`<button type="button" onClick=${() => set(null)}>Forget the key</button>`}
        <button type="button" onClick=${() => dialog.current?.close()}>Close</button>
      </p>
    </form>
  </dialog>`;
}
