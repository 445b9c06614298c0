// Chooses the page for an address, and follows links between pages without loading the document again.
import { html, render, useEffect, useErrorBoundary, useRef, useState, useWindowEvent } from "./ui.js";
import { Header } from "./parts/header.js";
import { findPlace, keepPlace, watchPlace } from "./parts/kept.js";
import { ProblemNote } from "./parts/problem.js";

/**
 * The pages by their addresses. A page's module exports the component `Page`, which gets the names of the address and the
 * query (`URLSearchParams`); a page with `style` has a style sheet of the same name.
 * @type {{path: string, page: string, title: string, style?: boolean, bare?: boolean}[]}
 */
const ROUTES = [
  { path: "/", page: "front", title: "swarmbench", style: true },
  { path: "/tasks/:task", page: "task", title: "Task" },
  { path: "/boards", page: "boards", title: "Boards", style: true },
  { path: "/board/:suite", page: "board", title: "Board", style: true },
  { path: "/board/:suite/:row", page: "player", title: "Player" },
  { path: "/runs", page: "runs", title: "Runs" },
  { path: "/runs/:id", page: "run", title: "Run" },
  { path: "/episodes", page: "episodes", title: "Games" },
  { path: "/imports", page: "imports", title: "Imported games" },
  { path: "/episodes/:id", page: "episode", title: "Game", style: true },
  { path: "/embed/episodes/:id", page: "episode", title: "Game", style: true, bare: true },
  { path: "/imports/:id", page: "episode", title: "Imported game", style: true },
  { path: "/compare", page: "compare", title: "Compare two games", style: true },
  { path: "/play", page: "play", title: "Play", style: true },
  { path: "/play/:id", page: "seat", title: "Play", style: true },
  { path: "/competitions", page: "competitions", title: "Competitions" },
  { path: "/competitions/:id", page: "competition", title: "Competition", style: true },
  { path: "/desk", page: "desk", title: "Organizer's desk", style: true },
];

/** Patterns of the addresses, with the names in them. */
const PATTERNS = ROUTES.map(({ path }) => new RegExp(`^${path.replace(/:(\w+)/g, "(?<$1>[^/]+)").replace(/\/$/, "")}/*$`));

/** The route of a path, with the names in it; null for a path of no page. @param {string} path */
function find(path) {
  const index = PATTERNS.findIndex((pattern) => pattern.test(path));
  if (index < 0) return null;
  try {
    const names = Object.entries(PATTERNS[index].exec(path)?.groups ?? {});
    return { route: ROUTES[index], values: Object.fromEntries(names.map(([name, value]) => [name, decodeURIComponent(value)])) };
  } catch {
    return null;
  }
}

/** The address of a page's style sheet. @param {string} name */
const styleOf = (name) => new URL(`./pages/${name}.css`, import.meta.url).href;

/** Loads the style sheet of a page, once. It counts while its page is shown. @param {string} name */
function loadStyle(name) {
  const href = styleOf(name);
  if (document.querySelector(`link[href="${href}"]`)) return Promise.resolve();
  return new Promise((resolve) => {
    const link = Object.assign(document.createElement("link"), { rel: "stylesheet", media: "not all", href, onload: resolve, onerror: resolve });
    document.head.append(link);
  });
}

/** Leaves no style sheet of a page on but the one of this page. @param {string} page */
function useStyleOf(page) {
  for (const link of document.querySelectorAll("head link[media]")) {
    if (link instanceof HTMLLinkElement) link.media = link.href === styleOf(page) ? "all" : "not all";
  }
}

/** Shows another page: for links, and for what happens after a form. @param {string} address */
export function visit(address) {
  keepPlace();
  history.pushState(null, "", address);
  dispatchEvent(new PopStateEvent("popstate"));
}

function followed(event) {
  const link = event.target.closest?.("a[href]");
  if (!(link instanceof HTMLAnchorElement) || link.target || link.hasAttribute("download")) return;
  if (event.defaultPrevented || event.button !== 0 || event.metaKey || event.ctrlKey || event.shiftKey || event.altKey) return;
  const to = new URL(link.href);
  const isHere = to.pathname === location.pathname && to.search === location.search;
  if (to.origin !== location.origin || !find(to.pathname) || (isHere && to.hash)) return;
  event.preventDefault();
  visit(to.href);
}

function App() {
  const [address, setAddress] = useState(() => location.pathname + location.search);
  const [shown, setShown] = useState(/** @type {any} */ (null));
  const [error, resetError] = useErrorBoundary((error) => console.error(error));
  const main = useRef(/** @type {HTMLElement | null} */ (null));
  const isFirst = useRef(true);

  useWindowEvent("popstate", () => setAddress(location.pathname + location.search));
  useWindowEvent("click", followed);

  useEffect(() => {
    let isCurrent = true;
    const found = find(location.pathname);
    const page = found?.route.page ?? "missing";
    const show = (/** @type {any} */ Page) => {
      if (!isCurrent) return;
      // A default title: the page may set a better one.
      document.title = found?.route.title ?? "No such page";
      useStyleOf(page);
      setShown({ address, found, Page });
    };
    Promise.all([import(`./pages/${page}.js`), found?.route.style && loadStyle(page)]).then(([module]) => show(module.Page), () => show(Outdated));
    return () => void (isCurrent = false);
  }, [address]);

  useEffect(() => {
    if (!shown) return;
    resetError();
    // Screen readers announce the new page.
    if (!isFirst.current) main.current?.focus();
    isFirst.current = false;
    findPlace();
  }, [shown]);

  const bare = Boolean(shown?.found?.route.bare);
  const content = error
    ? html`<${ProblemNote} problem=${error} />`
    : shown && html`<${shown.Page} key=${shown.address} ...${shown.found?.values} query=${new URLSearchParams(shown.address.split("?")[1])} embedded=${bare} />`;
  return html`
    ${!bare && html`<a class="skip" href="#main">Skip to the content</a><${Header} path=${address} />`}
    <main id="main" tabindex="-1" ref=${main}>${content ?? html`<p class="muted" role="status">Loading …</p>`}</main>
  `;
}

/** Shown when the files of this version are gone: the server was updated while the page was open. */
const Outdated = () => html`
  <h1>This page cannot be loaded</h1>
  <p>The server does not answer, or it was updated since this page was opened.</p>
  <p><button type="button" onClick=${() => location.reload()}>Load again</button></p>
`;

const root = document.getElementById("app");
watchPlace();
// What the document says of a page that does not start.
root?.replaceChildren();
if (root) render(html`<${App} />`, root);
