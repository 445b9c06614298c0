// The imports of every module: elements and hooks, and nothing that turns text into markup.
import { Fragment, createContext, h, render } from "./vendor/preact.mjs";
import { useEffect, useRef } from "./vendor/hooks.mjs";
import htm from "./vendor/htm.mjs";

export { Fragment, createContext, h, render };
export * from "./vendor/hooks.mjs";

/** Listens to events of the window. @param {string} name @param {(event: any) => void} listener the newest one is called */
export function useWindowEvent(name, listener) {
  const latest = useRef(listener);
  latest.current = listener;
  useEffect(() => {
    const called = (/** @type {Event} */ event) => latest.current(event);
    addEventListener(name, called);
    return () => removeEventListener(name, called);
  }, []);
}

/** Calls back every so often while the page can be seen, or not at all. @param {number | null} everyMs @param {() => void} call */
export function useEvery(everyMs, call) {
  const latest = useRef(call);
  latest.current = call;
  useEffect(() => {
    if (!everyMs) return;
    const timer = setInterval(() => document.hidden || latest.current(), everyMs);
    return () => clearInterval(timer);
  }, [everyMs]);
}

/** A handler of a form's submission, which leaves the page as it is. @param {() => unknown} act */
export const submits = (act) => (/** @type {Event} */ event) => {
  event.preventDefault();
  act();
};

/**
 * Elements from a template: html`<p class="note">${text}</p>`. Values are text, never markup.
 * @type {(strings: TemplateStringsArray, ...values: unknown[]) => any}
 */
export const html = htm.bind(h);
