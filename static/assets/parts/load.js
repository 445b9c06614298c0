// What a page loads, and what a visitor does on it by a press of a button.
import { html, useCallback, useEffect, useRef, useState } from "../ui.js";
import { Problem } from "../api.js";
import { Waiting } from "./problem.js";

const RETRY_MS = 3000;

/** The distance to the window within which content below it is drawn. */
const NEAR = "100px";

/**
 * The result of an asynchronous function. During a reload the earlier value stays; while the server does not answer
 * or is busy, the request is retried.
 * @template T
 * @param {(signal: AbortSignal) => Promise<T>} load
 * @param {unknown[]} inputs it is loaded again when one of them changes
 * @param {number} [everyMs] how often it is loaded again while the page can be seen
 * @returns {{value: T | null, problem: Error | null, isLoading: boolean, reload: () => void}}
 */
export function useLoaded(load, inputs, everyMs) {
  const [state, setState] = useState({ value: null, problem: null, isLoading: true });
  const [count, setCount] = useState(0);
  const latest = useRef(load);
  latest.current = load;
  const reload = useCallback(() => setCount((count) => count + 1), []);

  useEffect(() => {
    const aborted = new AbortController();
    let timer = 0;
    const later = (ms) => {
      timer = setTimeout(() => (document.hidden ? later(ms) : reload()), ms);
    };
    setState((state) => ({ ...state, isLoading: true }));
    latest.current(aborted.signal).then(
      (value) => {
        if (aborted.signal.aborted) return;
        setState({ value, problem: null, isLoading: false });
        if (everyMs) later(everyMs);
      },
      (problem) => {
        if (aborted.signal.aborted) return;
        setState((state) => ({ ...state, problem, isLoading: false }));
        const isTransient = problem instanceof Problem && (problem.status === 0 || problem.status === 429 || problem.status === 503);
        if (isTransient) later(Math.max(problem.retryAfterMs ?? 0, RETRY_MS));
      },
    );
    return () => {
      aborted.abort();
      clearTimeout(timer);
    };
  }, [...inputs, count, everyMs]);

  return { ...state, reload };
}

/**
 * What `children` makes of a value that was loaded; before, its problem, or that it loads.
 * @param {{of: {value: any, problem: Error | null, reload: () => void}, what?: string, children?: (value: any) => unknown}} props
 */
export const Loaded = ({ of, what, children }) => html`
  ${(of.problem || !of.value) && html`<${Waiting} of=${of} what=${what} />`}
  ${of.value && children?.(of.value)}
`;

/**
 * A component whose module is loaded when it is first drawn; before, its problem, or that it loads.
 * @param {{read: () => Promise<any>, name: string, props: any}} props
 */
export const Part = ({ read, name, props }) => html`<${Loaded} of=${useLoaded(read, [])}>${(part) => html`<${part[name]} ...${props} />`}<//>`;

/** Details whose module is loaded when they are opened. @param {Parameters<typeof Part>[0] & {summary: any, look?: string}} props look: the class of the summary */
export function Folded({ summary, look, ...part }) {
  const [isOpened, setIsOpened] = useState(false);
  return html`<details onToggle=${() => setIsOpened(true)}><summary class=${look}>${summary}</summary>${isOpened && html`<${Part} ...${part} />`}</details>`;
}

/** Content far below the window, which is drawn once it comes near. @param {{children?: any}} props */
export function Below({ children }) {
  const [isNear, setIsNear] = useState(false);
  const place = useRef(/** @type {HTMLElement | null} */ (null));
  useEffect(() => {
    const observer = new IntersectionObserver((seen) => setIsNear((isNear) => isNear || seen.some((one) => one.isIntersecting)), { rootMargin: NEAR });
    observer.observe(/** @type {HTMLElement} */ (place.current));
    return () => observer.disconnect();
  }, []);
  return html`<div ref=${place}>${isNear && children}</div>`;
}

/** Runs one task at a time, and keeps the problem of the last one. */
export function useTask() {
  const [state, setState] = useState({ isBusy: false, problem: /** @type {Error | null} */ (null) });
  const isBusy = useRef(false);
  /** Does nothing while a task runs. @param {() => Promise<unknown>} task */
  const run = async (task) => {
    if (isBusy.current) return;
    isBusy.current = true;
    setState({ isBusy: true, problem: null });
    const problem = await task().then(() => null, (problem) => problem);
    isBusy.current = false;
    setState({ isBusy: false, problem });
  };
  return { ...state, run };
}

/**
 * A module that is read when it is first needed; null until then.
 * @template T
 * @param {() => Promise<T>} read
 * @param {boolean} isNeeded
 */
export const usePart = (read, isNeeded) => useLoaded(async () => (isNeeded ? read() : null), [isNeeded]).value;
