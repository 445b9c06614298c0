// What a page keeps in its entry of the browser's history, for a visitor who comes back: how far it was scrolled, and how long its
// lists were.

/** The pause after scrolling before it is kept: browsers limit the rate. */
const REST_MS = 200;

/** The maximum time for a page to grow as long as it was. */
const GROWING_MS = 5_000;

/** @param {string} name */
export const kept = (name) => history.state?.[name];

/** @param {string} name @param {unknown} value */
export const keep = (name, value) => history.replaceState({ ...history.state, [name]: value }, "");

let resting = 0;

/** Keeps how far the page is scrolled. Before it is left, `keepPlace` keeps it at once. */
export function watchPlace() {
  history.scrollRestoration = "manual";
  addEventListener("scroll", () => {
    clearTimeout(resting);
    resting = setTimeout(keepPlace, REST_MS);
  });
  // The entry is another one by now.
  addEventListener("popstate", () => clearTimeout(resting));
}

export function keepPlace() {
  clearTimeout(resting);
  keep("scrolled", scrollY);
}

/** Scrolls to the kept place as soon as the page is long enough, unless the visitor scrolls first. */
export function findPlace() {
  const to = kept("scrolled") ?? 0;
  scrollTo(0, to);
  if (scrollY >= to) return;
  const grown = new ResizeObserver(() => {
    scrollTo(0, to);
    if (scrollY >= to) stop();
  });
  const timer = setTimeout(() => stop(), GROWING_MS);
  const stop = () => {
    grown.disconnect();
    clearTimeout(timer);
    for (const name of MOVES) removeEventListener(name, stop);
  };
  for (const name of MOVES) addEventListener(name, stop);
  grown.observe(document.body);
}

/** Events by which a visitor moves on. */
const MOVES = ["wheel", "touchmove", "keydown", "pointerdown", "popstate"];
