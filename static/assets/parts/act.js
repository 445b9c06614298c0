// Acts that affect others: a dialog says what will happen, and asks for a confirmation.
import { html, useEffect, useId, useLayoutEffect, useRef, useState } from "../ui.js";
import { Text } from "./text.js";
import { FieldProblems } from "./problem.js";

/** `reason_chars_max` of the API. */
const REASON_CHARS_MAX = 500;

/**
 * A button, and the dialog that confirms its act.
 * @param {{label: string, of?: string, title: any, act: (reason: string) => Promise<unknown>, done?: () => void,
 *   reason?: "required" | "optional", isDangerous?: boolean, dismiss?: string, children: any}} props
 *   of: what the act concerns, for those who hear the button; children: what will happen; dismiss: what
 *   closes the dialog without the act
 */
export function ActButton({ label, of, title, act, done, reason, isDangerous = true, dismiss = "Cancel", children }) {
  const dialog = useRef(/** @type {HTMLDialogElement | null} */ (null));
  const near = useRef(/** @type {HTMLElement | null} */ (null));
  const id = useId();
  const [text, setText] = useState("");
  const [problem, setProblem] = useState(/** @type {any} */ (null));
  const [isSending, setIsSending] = useState(false);
  const [isOpen, setIsOpen] = useState(false);

  const open = (/** @type {any} */ event) => {
    near.current = event.currentTarget.closest("[tabindex]");
    setProblem(null);
    setText("");
    setIsOpen(true);
  };
  // Only now the dialog has the element to focus.
  useLayoutEffect(() => {
    if (isOpen) dialog.current?.showModal();
  }, [isOpen]);
  // An act may remove its button: the focus stays near it.
  useEffect(() => () => void (document.activeElement === document.body && near.current?.focus()), []);
  /** @param {Event} event */
  const confirmed = async (event) => {
    event.preventDefault();
    setIsSending(true);
    setProblem(null);
    try {
      await act(text.trim());
      dialog.current?.close();
      done?.();
    } catch (error) {
      setProblem(error);
    } finally {
      setIsSending(false);
    }
  };
  return html`<button type="button" class=${isDangerous ? "danger" : ""} onClick=${open} aria-label=${of && `${label} ${of}`}>
      ${label}
    </button>
    <dialog ref=${dialog} aria-labelledby=${`${id}-title`} onClose=${() => setIsOpen(false)}>
      ${isOpen &&
      html`<form onSubmit=${confirmed}>
        <h2 id=${`${id}-title`}>${title}</h2>
        ${children}
        ${reason &&
        html`<label class="field"
          >Reason${reason === "optional" && " (may be left out)"}; everybody may read it
          <input
            required=${reason === "required"}
            maxlength=${REASON_CHARS_MAX}
            value=${text}
            onInput=${(/** @type {any} */ event) => setText(event.target.value)}
          />
        </label>`}
        ${problem &&
        html`<div role="alert" class="bad"><p><${Text} value=${problem.message} /></p>
          ${problem.fields && html`<${FieldProblems} problem=${problem} />`}</div>`}
        <p class="buttons">
          <button type="submit" class=${isDangerous ? "danger" : "primary"} disabled=${isSending}>${label}</button>
          <button type="button" onClick=${() => dialog.current?.close()}>${dismiss}</button>
        </p>
      </form>`}
    </dialog>`;
}
