// Lists that the server sends in pages.
import { html, useCallback, useEffect, useRef, useState } from "../ui.js";
import { request, withQuery } from "../api.js";
import { useLoaded } from "./load.js";

/** The number of items per page. */
export const PAGE_ITEMS = 100;

/** The maximum number of pages read to find an item, or all games of a run: at most 1,000. */
const PAGES_MAX = 20;

/**
 * Reads a list to its end, or to `PAGES_MAX` pages.
 * @param {string} path
 * @param {Record<string, string | number | boolean | null | undefined>} query
 * @param {AbortSignal} signal
 * @param {(page: any) => boolean | void} onPage true where no more are needed
 */
export async function eachPage(path, query, signal, onPage) {
  let cursor = null;
  for (let pages = 0; pages < PAGES_MAX; pages++) {
    const page = await request(withQuery(path, { limit: PAGE_ITEMS, ...query, cursor }), { signal });
    cursor = page.next_cursor;
    if (onPage(page) || !cursor) return;
  }
}

/**
 * A list whose first page is loaded again every `everyMs`, and to which further pages are added on request.
 * @param {string} path with its query, but without a cursor
 * @param {number} [everyMs]
 */
export function usePages(path, everyMs) {
  const first = useLoaded((signal) => request(path, { signal }), [path], everyMs);
  const [more, setMore] = useState({ path, items: /** @type {any[]} */ ([]), next: /** @type {string | null} */ (null) });
  const [state, setState] = useState({ isLoading: false, problem: /** @type {Error | null} */ (null) });
  const latest = useRef(path);
  latest.current = path;
  useEffect(() => setMore({ path, items: [], next: null }), [path]);

  const isMore = more.path === path && more.items.length > 0;
  const next = isMore ? more.next : first.value?.next_cursor;
  const loadMore = useCallback(async () => {
    setState({ isLoading: true, problem: null });
    try {
      const page = await request(`${path}${path.includes("?") ? "&" : "?"}cursor=${encodeURIComponent(next)}`);
      if (latest.current !== path) return;
      setMore((more) => ({ path, items: [...(more.path === path ? more.items : []), ...page.items], next: page.next_cursor }));
      setState({ isLoading: false, problem: null });
    } catch (problem) {
      setState({ isLoading: false, problem: /** @type {Error} */ (problem) });
    }
  }, [path, next]);

  const items = [...(first.value?.items ?? []), ...(isMore ? more.items : [])];
  // The change may be on a later page.
  const reload = () => {
    setMore({ path, items: [], next: null });
    first.reload();
  };
  return { ...first, reload, items, hasMore: Boolean(next), loadMore, isLoadingMore: state.isLoading, moreProblem: state.problem };
}

/** @param {{list: ReturnType<typeof usePages>}} props */
export const More = ({ list }) =>
  list.hasMore &&
  html`<p>
    <button type="button" onClick=${list.loadMore} disabled=${list.isLoadingMore}>More</button>
    ${list.moreProblem && html` <span class="bad" role="alert">That did not work. Try again.</span>`}
  </p>`;
