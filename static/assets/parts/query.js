// The query of the address as state of a page: a link to the current view, without a reload.
import { useCallback, useEffect, useState, useWindowEvent } from "../ui.js";

const here = () => new URLSearchParams(location.search);

/** @returns {[URLSearchParams, (changes: Record<string, string | null>) => void]} null and "" remove a name */
export function useQuery() {
  const [query, setQuery] = useState(here);
  useWindowEvent("popstate", () => setQuery(here()));
  const change = useCallback((/** @type {Record<string, string | null>} */ changes) => {
    const next = here();
    for (const [name, value] of Object.entries(changes)) {
      if (value) next.set(name, value);
      else next.delete(name);
    }
    const text = next.toString();
    history.replaceState(history.state, "", location.pathname + (text && `?${text}`));
    setQuery(next);
  }, []);
  return [query, change];
}

/** Sets the title of the document when it is known. @param {string | null | undefined} title */
export function useTitle(title) {
  useEffect(() => {
    if (title) document.title = `${title} · swarmbench`;
  }, [title]);
}
