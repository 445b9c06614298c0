// Lists that the server sends in pages.
import { html, useEffect, useRef, useState } from "../ui.js";
import { request, withQuery } from "../api.js";
import { kept, keep } from "./kept.js";
import { useLoaded } from "./load.js";
import { Waiting } from "./problem.js";

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
 * A list whose first page is loaded again every `everyMs`, and to which further pages are added on request. A visitor who comes
 * back finds as many.
 * @param {string} path with its query, but without a cursor
 * @param {number} [everyMs]
 */
export function usePages(path, everyMs) {
  const first = useLoaded((signal) => request(path, { signal }), [path], everyMs);
  const nothing = { path, pages: /** @type {any[]} */ ([]), isLoading: false, problem: /** @type {unknown} */ (null) };
  const [added, setAdded] = useState(nothing);
  const latest = useRef(path);
  latest.current = path;
  // What was added to the list of another path does not count.
  const more = added.path === path ? added : nothing;
  const next = (more.pages.at(-1) ?? first.value)?.next_cursor;
  const length = `items of ${path}`;
  const itemsOf = (/** @type {any[]} */ pages) => pages.flatMap((page) => page?.items ?? []);
  const loadMore = async () => {
    const set = (/** @type {Partial<typeof nothing>} */ change) => latest.current === path && setAdded({ ...more, ...change });
    set({ isLoading: true, problem: null });
    try {
      const pages = [...more.pages, await request(`${path}${path.includes("?") ? "&" : "?"}cursor=${encodeURIComponent(next)}`)];
      set({ pages, isLoading: false });
      if (latest.current === path) keep(length, Math.max(itemsOf(pages).length, kept(length) ?? 0));
    } catch (problem) {
      set({ isLoading: false, problem });
    }
  };
  // The change may be on a later page.
  const reload = () => {
    setAdded(nothing);
    first.reload();
  };
  // The first page is read again, and new items move others to the page after it.
  const items = [...new Map(itemsOf([first.value, ...more.pages]).map((item) => [item.id ?? item, item])).values()];
  const { isLoading: isLoadingMore, problem: moreProblem, pages } = more;
  const list = { ...first, reload, items, hasMore: Boolean(next), pages: pages.length, loadMore, isLoadingMore, moreProblem };
  useReadOn(list, itemsOf(pages).length < (kept(length) ?? 0));
  return list;
}

/**
 * Reads one page after another while `isWanted`; whether it does.
 * @param {Pick<ReturnType<typeof usePages>, "hasMore" | "isLoadingMore" | "moreProblem" | "loadMore">} list
 * @param {boolean} isWanted
 */
export function useReadOn({ hasMore, isLoadingMore, moreProblem, loadMore }, isWanted) {
  const readsOn = isWanted && hasMore && !moreProblem;
  useEffect(() => {
    if (readsOn && !isLoadingMore) void loadMore();
  }, [readsOn, isLoadingMore]);
  return readsOn;
}

/** @param {{list: ReturnType<typeof usePages>}} props */
export const More = ({ list }) =>
  list.hasMore &&
  html`<p>
    <button type="button" onClick=${list.loadMore} disabled=${list.isLoadingMore}>More</button>
    ${list.moreProblem && html` <span class="bad" role="alert">That did not work. Try again.</span>`}
  </p>`;

/**
 * A list: that it loads, its problem, `empty`, or its items (`children`); and more of them.
 * @param {{list: ReturnType<typeof usePages>, empty: any, children?: any}} props
 */
export function Listed({ list, empty, children }) {
  const { value, problem, items } = list;
  if (!value) return html`<${Waiting} of=${list} />`;
  return html`${problem && html`<p class="bad" role="status">${problem.message} What is shown may be out of date.</p>`}
    ${items.length > 0 ? children : empty}
    <${More} list=${list} />`;
}
