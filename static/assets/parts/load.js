// Loads and reloads the content of a page.
import { useCallback, useEffect, useRef, useState } from "../ui.js";
import { Problem } from "../api.js";

const RETRY_MS = 3000;

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
