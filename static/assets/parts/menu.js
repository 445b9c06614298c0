// Menus: a button that opens a short list of actions and links over the page.
import { html, useId, useRef } from "../ui.js";

/** The distance from the edges of the window, in pixels. */
const MARGIN = 4;

/**
 * A button and its list, which closes at a choice, at Escape and at a press elsewhere.
 * @param {{label: any, name?: string, children: any}} props label: what the button shows; name: what it is called where that is a
 *   sign; children: buttons and links, and `<hr>` before those that destroy
 */
export function Menu({ label, name, children }) {
  const id = useId();
  const button = useRef(/** @type {HTMLElement | null} */ (null));
  const list = useRef(/** @type {HTMLElement | null} */ (null));
  const place = (event) => {
    if (event.newState !== "open" || !button.current || !list.current) return;
    const from = button.current.getBoundingClientRect();
    const { width, height } = list.current.getBoundingClientRect();
    const isAbove = from.bottom + height > innerHeight && from.top > height;
    const left = from.left + width + MARGIN > innerWidth ? from.right - width : from.left;
    list.current.style.left = `${Math.max(MARGIN, left)}px`;
    list.current.style.top = `${isAbove ? from.top - height : from.bottom}px`;
  };
  // Before the choice itself acts: a dialog that it opens gives the focus back to the button, and not to a choice that is hidden.
  const close = (event) => event.target.closest("button, a") && list.current?.hidePopover();
  return html`<button type="button" ref=${button} popovertarget=${id} aria-label=${name}>${label}</button>
    <div class="menu" id=${id} ref=${list} popover="auto" onToggle=${place} onClickCapture=${close}>${children}</div>`;
}
