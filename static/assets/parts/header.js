// The line at the top of every page: links, and the key of this tab.
import { html, submits, useEffect, useRef, useState } from "../ui.js";
import { key, onRemembered, remember } from "../api.js";
import { Menu } from "./menu.js";

/** @type {[string, string, RegExp][]} */
const PLACES = [
  ["/boards", "Boards", /^\/board/],
  ["/competitions", "Competitions", /^\/competitions/],
  ["/episodes", "Games", /^\/(episodes|imports|compare)/],
  ["/runs", "Runs", /^\/runs/],
  ["/play", "Play", /^\/play/],
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
      ${PLACES.map(([href, name, paths]) => html`<a href=${href} aria-current=${paths.test(path) ? "page" : undefined}>${name}</a>`)}
    </nav>
    <${Menu} label=${hasKey ? "Key: entered" : "Key"}>
      <button type="button" onClick=${openKeyDialog}>${hasKey ? "Enter another key" : "Enter a key"}</button>
      <a href="/desk">Desk</a>
      ${hasKey && html`<a href="/desk?view=keys">Keys</a>`}
      <a href="/docs">API</a>
      ${hasKey && html`<hr /><button type="button" class="danger" onClick=${() => takeKey(null)}>Forget the key</button>`}
    <//>
    <${KeyDialog} />
  </header>`;
}

/** Every page is loaded again, as it shows other things to another caller. @param {string | null} value null to forget it */
export function takeKey(value) {
  remember("key", value);
  location.reload();
}

function KeyDialog() {
  const dialog = useRef(/** @type {HTMLDialogElement | null} */ (null));
  const input = useRef(/** @type {HTMLInputElement | null} */ (null));
  const entered = () => {
    const value = input.current?.value.trim();
    if (value) takeKey(value);
  };
  return html`<dialog id="key-dialog" ref=${dialog} aria-labelledby="key-title">
    <form onSubmit=${submits(entered)}>
      <h2 id="key-title">Your key</h2>
      <p>
        A key (<code>secret_…</code>) from an organizer shows what is private, starts games, and opens the desk. It stays in
        this tab, and is forgotten when the tab is closed.
      </p>
      <label>Key <input ref=${input} type="password" autocomplete="off" spellcheck="false" /></label>
      <p class="buttons">
        <button type="submit" class="primary">Use this key</button>
        <button type="button" onClick=${() => dialog.current?.close()}>Close</button>
      </p>
    </form>
  </dialog>`;
}
