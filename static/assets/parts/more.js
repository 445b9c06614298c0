// Lists that are read in pages.
import { html, useEffect, useState } from "../ui.js";
import { request, withQuery } from "../api.js";
import { useLoaded } from "./load.js";

/** Items of a page. */
const PAGE = 50;

/**
 * The items of a list, and what reads more of them.
 * @param {string} path
 * @param {Record<string, string>} filters
 * @param {number} [everyMs] how often the first page is read again
 */
export function useList(path, filters, everyMs) {
  const address = withQuery(path, { ...filters, limit: PAGE });
  const first = useLoaded((signal) => request(address, { signal }), [address], everyMs);
  const [later, setLater] = useState({ address, items: /** @type {any[]} */ ([]), cursor: /** @type {string | null} */ (null), isRead: false });
  const [problem, setProblem] = useState(/** @type {Error | null} */ (null));
  useEffect(() => setLater({ address, items: [], cursor: null, isRead: false }), [address]);
  const isSame = later.address === address;
  const cursor = isSame && later.isRead ? later.cursor : first.value?.next_cursor;
  const more = async () => {
    setProblem(null);
    try {
      const page = await request(withQuery(path, { ...filters, limit: PAGE, cursor }));
      setLater((later) => ({ address, items: [...later.items, ...page.items], cursor: page.next_cursor, isRead: true }));
    } catch (error) {
      setProblem(/** @type {Error} */ (error));
    }
  };
  const items = first.value ? unique([...first.value.items, ...(isSame ? later.items : [])]) : null;
  return { items, hasMore: Boolean(cursor), more, problem: first.problem ?? problem, isLoading: first.isLoading, reload: first.reload };
}

/** A list that grew between two pages has items twice. @param {any[]} items @returns {any[]} */
const unique = (items) => [...new Map(items.map((item) => [item.id, item])).values()];

/** @param {{list: {hasMore: boolean, more: () => void}}} props */
export const MoreButton = ({ list }) => list.hasMore && html`<p><button type="button" onClick=${list.more}>More</button></p>`;

/** Tasks, for filters. */
export const TASKS = ["Transport", "Pursuit", "Synchronization", "Foraging", "Flocking"];

/**
 * Filters that stand in the address, so that a list can be linked.
 * @param {URLSearchParams} query
 * @param {string[]} names
 * @returns {[Record<string, string>, (name: string, value: string) => void]}
 */
export function useFilters(query, names) {
  const [filters, setFilters] = useState(() => Object.fromEntries(names.map((name) => [name, query.get(name) ?? ""])));
  /** @param {string} name @param {string} value */
  const set = (name, value) => {
    const changed = { ...filters, [name]: value };
    setFilters(changed);
    history.replaceState(history.state, "", withQuery(location.pathname, changed));
  };
  return [filters, set];
}

/** @param {{label: string, value: string, options: string[], onChange: (value: string) => void}} props */
export const Choice = ({ label, value, options, onChange }) => html`<label>
  ${label}${" "}
  <select onChange=${(/** @type {any} */ event) => onChange(event.currentTarget.value)}>
    <option value="" selected=${value === ""}>all</option>
    ${options.map((option) => html`<option value=${option} selected=${value === option}>${option}</option>`)}
  </select>
</label>`;

/** A text to filter by, used when it is complete. @param {{label: string, value: string, onChange: (value: string) => void}} props */
export const Exact = ({ label, value, onChange }) =>
  html`<label>${label} <input type="search" value=${value} placeholder="its whole name" onChange=${(/** @type {any} */ event) => onChange(event.currentTarget.value.trim())} /></label>`;
