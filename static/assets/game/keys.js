// Keys of a game's page. Each key does the same as a button.
import { html, useEffect, useRef } from "../ui.js";

/** @type {[string, string][]} */
const HELP = [
  ["← →", "one round back, one on"],
  ["Shift ← →", "ten rounds"],
  ["Home End", "the first round, the newest"],
  ["Space", "play, pause"],
  [", .", "slower, faster"],
  ["n p", "the next mark, the one before"],
  ["0 … 9", "the agent with this number"],
  ["[ ]", "the agent before, the next"],
  ["m", "lines to who heard a message"],
  ["v", "the windows of all agents"],
  ["t", "the table of all agents"],
  ["z", "a large map"],
  ["f", "follow a running game"],
  ["l", "copy a link to this moment"],
  ["c", "compare with another game"],
  ["?", "this list"],
];

const MOVES = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End", "PageUp", "PageDown"];

/** Whether the focused element uses a key itself. @param {EventTarget | null} target @param {string} key */
function isTaken(target, key) {
  if (!(target instanceof Element) || document.querySelector("dialog[open]")) return true;
  if (target instanceof HTMLInputElement && target.type === "range") return MOVES.includes(key);
  if (target.closest("input, select, textarea, [contenteditable]")) return true;
  if (target.closest("button, a, summary")) return key === " " || key === "Enter";
  return target.closest("[tabindex='0']") !== null && MOVES.includes(key);
}

/**
 * Calls the function of a key. Names are those of `KeyboardEvent`, after "Shift+" if Shift is held.
 * @param {Record<string, () => void>} actions
 */
export function useKeys(actions) {
  const latest = useRef(actions);
  latest.current = actions;
  useEffect(() => {
    /** @param {KeyboardEvent} event */
    const pressed = (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || isTaken(event.target, event.key)) return;
      const isMove = MOVES.includes(event.key);
      const action = latest.current[isMove && event.shiftKey ? `Shift+${event.key}` : event.key];
      if (!action) return;
      event.preventDefault();
      action();
    };
    addEventListener("keydown", pressed);
    return () => removeEventListener("keydown", pressed);
  }, []);
}

/** @param {{dialog: {current: HTMLDialogElement | null}, help?: [string, string][]}} props */
export const KeyHelp = ({ dialog, help = HELP }) => html`<dialog ref=${dialog} aria-labelledby="keys-title">
  <h2 id="keys-title">Keys</h2>
  <table>
    <tbody>
      ${help.map(([keys, what]) => html`<tr><th scope="row">${keys.split(" ").map((key) => (key === "…" ? " … " : html`<kbd>${key}</kbd> `))}</th><td>${what}</td></tr>`)}
    </tbody>
  </table>
  <p><button type="button" onClick=${() => dialog.current?.close()}>Close</button></p>
</dialog>`;
