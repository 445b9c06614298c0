// Acts that affect others: a dialog says what will happen, and asks for a confirmation.
import { html, useEffect, useId, useLayoutEffect, useRef, useState } from "../ui.js";
import { useTask } from "./load.js";
import { Menu } from "./menu.js";
import { FieldProblems } from "./problem.js";
import { Text } from "./text.js";

/** `reason_chars_max` of the API. */
const REASON_CHARS_MAX = 500;

/**
 * An act: its label; the title of its dialog, which is the label where it is left out; what will happen, in a sentence (`text`) or more
 * (`children`); `dismiss` closes the dialog without the act.
 * @typedef {{label: string, title?: any, act: (reason: string) => Promise<unknown>, done?: () => void, reason?: "required" | "optional",
 *   isDangerous?: boolean, dismiss?: string, text?: any, children?: any}} Act
 */

/** Keeps the focus near a button that its act removes. Returns a handler that notes where it is. */
function useNear() {
  const near = useRef(/** @type {HTMLElement | null} */ (null));
  useEffect(() => () => void (document.activeElement === document.body && near.current?.focus()), []);
  return (/** @type {any} */ event) => void (near.current = event.currentTarget.closest("[tabindex]"));
}

/**
 * A button, and the dialog that confirms its act.
 * @param {Act & {of?: string, isPrimary?: boolean}} props of: what the act concerns, for those who hear the button; isPrimary: the next step
 */
export function ActButton({ isPrimary, ...act }) {
  const { label, of, isDangerous } = act;
  const [isAsked, setIsAsked] = useState(false);
  const note = useNear();
  return html`<button type="button" class=${isPrimary ? "primary" : isDangerous === false ? "" : "danger"} aria-label=${of && `${label} ${of}`}
      onClick=${(/** @type {any} */ event) => (note(event), setIsAsked(true))}>${label}</button>
    ${isAsked && html`<${Confirmation} ...${act} close=${() => setIsAsked(false)} />`}`;
}

/**
 * The menu of a row: links and acts, dangerous ones below a line.
 * @param {{of: string, acts: (Act | false | null)[], done?: () => void, children?: any}} props of: the row; children: its links and buttons
 */
export function ActMenu({ of, acts, done, children }) {
  const [asked, setAsked] = useState(/** @type {Act | null} */ (null));
  const note = useNear();
  const given = acts.filter((act) => act !== null && act !== false);
  if (given.length === 0 && !children) return null;
  const items = (/** @type {boolean} */ isDangerous) =>
    given.filter((act) => (act.isDangerous ?? true) === isDangerous).map((act) => html`<button type="button" class=${isDangerous ? "danger" : ""}
      onClick=${(/** @type {any} */ event) => (note(event), setAsked(act))}>${act.label}</button>`);
  const [mild, dangerous] = [items(false), items(true)];
  return html`<${Menu} label="⋯" name=${`Actions for ${of}`}>
      ${children}${mild}${(children || mild.length > 0) && dangerous.length > 0 && html`<hr />`}${dangerous}
    <//>
    ${asked && html`<${Confirmation} of=${of} done=${done} ...${asked} close=${() => setAsked(null)} />`}`;
}

/** @param {Act & {of?: string, close: () => void}} props */
function Confirmation({ label, of, title, act, done, reason, isDangerous = true, dismiss = "Cancel", text, children, close }) {
  const dialog = useRef(/** @type {HTMLDialogElement | null} */ (null));
  const id = useId();
  const [typed, setTyped] = useState("");
  const { isBusy, problem, run } = useTask();
  useLayoutEffect(() => dialog.current?.showModal(), []);
  const send = async () => {
    await act(typed.trim());
    dialog.current?.close();
    done?.();
  };
  return html`<dialog ref=${dialog} aria-labelledby=${id} onClose=${close}>
    <form onSubmit=${(/** @type {Event} */ event) => (event.preventDefault(), run(send))}>
      <h2 id=${id}>${title ?? html`${label}${of && html` <${Text} value=${of} />`}?`}</h2>
      ${text && html`<p>${text}</p>`}${children}
      ${reason &&
      html`<label class="field">Reason${reason === "optional" && " (may be left out)"}; everybody may read it
        <input required=${reason === "required"} maxlength=${REASON_CHARS_MAX} value=${typed} onInput=${(/** @type {any} */ event) => setTyped(event.target.value)} />
      </label>`}
      ${problem && html`<div role="alert" class="bad"><p><${Text} value=${problem.message} /></p><${FieldProblems} problem=${problem} /></div>`}
      <p class="buttons">
        <button type="submit" class=${isDangerous ? "danger" : "primary"} disabled=${isBusy}>${label}</button>
        <button type="button" onClick=${() => dialog.current?.close()}>${dismiss}</button>
      </p>
    </form>
  </dialog>`;
}
