// Lists that come page by page.
import { html, useCallback, useRef, useState } from "../ui.js";
import { request, withQuery } from "../api.js";
import { useLoaded } from "./load.js";

const PAGE_ITEMS = 100;

/** Pages of a list that a tab shows; the API has the rest. */
const PAGES_MAX = 50;

/**
 * A list and the function that shows more of it. With `everyMs` the first page is loaded again from time to time, until
 * somebody asks for more. `first` is the first page, with what else is in it.
 * @param {string} path
 * @param {number} [everyMs]
 * @param {string | null} [token] in the place of the tab's key
 */
export function usePages(path, everyMs, token) {
  const [wanted, setWanted] = useState(1);
  const kept = useRef({ path: "", pages: 0, items: /** @type {any[]} */ ([]), cursor: /** @type {string | null} */ (null), first: /** @type {any} */ (null) });
  const loaded = useLoaded(
    async (signal) => {
      const isMore = kept.current.path === path && kept.current.pages < wanted;
      let { pages, items, cursor, first } = isMore ? kept.current : { pages: 0, items: [], cursor: null, first: null };
      while (pages === 0 || (pages < wanted && cursor)) {
        const options = token === undefined ? { signal } : { signal, token };
        const page = withQuery("", { limit: PAGE_ITEMS, cursor });
        const answer = await request(path + (path.includes("?") ? page.replace("?", "&") : page), options);
        [items, cursor, pages] = [[...items, ...answer.items], answer.next_cursor, pages + 1];
        first ??= answer;
      }
      kept.current = { path, pages: wanted, items, cursor, first };
      return { items, first, hasMore: cursor !== null, isFull: cursor !== null && wanted >= PAGES_MAX };
    },
    [path, wanted, token],
    wanted === 1 ? everyMs : undefined,
  );
  const more = useCallback(() => setWanted((wanted) => wanted + 1), []);
  return { ...loaded, more };
}

/**
 * The button below a list that shows more of it.
 * @param {{list: ReturnType<typeof usePages>}} props
 */
export function More({ list }) {
  if (!list.value?.hasMore) return null;
  if (list.value.isFull) return html`<p class="muted">The list is longer. The API has all of it.</p>`;
  return html`<p>
    <button type="button" onClick=${list.more} disabled=${list.isLoading}>${list.isLoading ? "Loading …" : "More"}</button>
  </p>`;
}
