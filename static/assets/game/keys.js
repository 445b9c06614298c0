// Keys of pages. Each key does the same as a button.
import { useWindowEvent } from "../ui.js";

const MOVES = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End", "PageUp", "PageDown"];

/** Whether the focused element uses a key itself: an agent's panel scrolls up and down. @param {EventTarget | null} target @param {string} key */
function isTaken(target, key) {
  if (!(target instanceof Element) || document.querySelector("dialog[open]")) return true;
  if (target instanceof HTMLInputElement && target.type === "range") return MOVES.includes(key);
  if (target.closest("input, select, textarea, [contenteditable]")) return true;
  if (target.closest("button, a, summary")) return key === " " || key === "Enter";
  return target.closest("[tabindex='0']:not(.panel-content)") !== null && MOVES.includes(key);
}

/** @typedef {Record<string, (() => void) | null | undefined>} Keys functions by names of `KeyboardEvent`, after "Shift+" if Shift is held */

/** Calls the function of a key. @param {Keys} actions @param {boolean} [isOnce] a key that is held down acts once */
export function useKeys(actions, isOnce = false) {
  useWindowEvent("keydown", (/** @type {KeyboardEvent} */ event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.isComposing || isTaken(event.target, event.key)) return;
    const isMove = MOVES.includes(event.key);
    const action = actions[isMove && event.shiftKey ? `Shift+${event.key}` : event.key];
    if (!action) return;
    event.preventDefault();
    if (!(isOnce && event.repeat)) action();
  });
}
