// Chooses the page for an address, and follows links between pages without loading the document again.
import { html, render, useEffect, useErrorBoundary, useRef, useState } from "./ui.js";
import { Header } from "./parts/header.js";
import { ProblemNote } from "./parts/problem.js";

/**
 * The pages by their addresses. A page's module exports the component `Page`, which gets the names of the address and the
 * query (`URLSearchParams`); a page with `style` has a style sheet of the same name.
 * @type {{path: string, page: string, title: string, style?: boolean, bare?: boolean}[]}
 */
const ROUTES = [
  { path: "/", page: "front", title: "swarmbench", style: true },
  { path: "/boards", page: "boards", title: "Boards", style: true },
  { path: "/board/:suite", page: "board", title: "Board", style: true },
  { path: "/board/:suite/:row", page: "player", title: "Player", style: true },
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

/**
 * The route of a path, with the names in it.
 * @param {string} path
 */
function find(path) {
  const parts = path.replace(/\/+$/, "").split("/");
  for (const route of ROUTES) {
    const names = route.path.replace(/\/+$/, "").split("/");
    if (names.length !== parts.length) continue;
    /** @type {Record<string, string>} */
    const values = {};
    const fits = names.every((name, index) => {
      if (!name.startsWith(":")) return name === parts[index];
      try {
        values[name.slice(1)] = decodeURIComponent(parts[index]);
      } catch {
        return false;
      }
      return values[name.slice(1)] !== "";
    });
    if (fits) return { route, values };
  }
  return null;
}

/**
 * Loads the style sheet of a page, once.
 * @param {string} name
 */
function style(name) {
  const href = new URL(`./pages/${name}.css`, import.meta.url).href;
  if (document.querySelector(`link[href="${href}"]`)) return Promise.resolve();
  return new Promise((resolve) => {
    const link = document.createElement("link");
    link.rel = "stylesheet";
    link.href = href;
    link.onload = link.onerror = () => resolve(undefined);
    document.head.append(link);
  });
}

/** Shows another page: for links, and for what happens after a form. @param {string} address */
export function visit(address) {
  history.pushState(null, "", address);
  dispatchEvent(new PopStateEvent("popstate"));
}

/** @param {MouseEvent} event */
function followed(event) {
  const link = event.target instanceof Element ? event.target.closest("a[href]") : null;
  if (!(link instanceof HTMLAnchorElement) || link.target || link.hasAttribute("download")) return;
  if (event.defaultPrevented || event.button !== 0 || event.metaKey || event.ctrlKey || event.shiftKey || event.altKey) {
    return;
  }
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

  useEffect(() => {
    const changed = () => setAddress(location.pathname + location.search);
    addEventListener("popstate", changed);
    document.addEventListener("click", followed);
    return () => {
      removeEventListener("popstate", changed);
      document.removeEventListener("click", followed);
    };
  }, []);

  useEffect(() => {
    let isCurrent = true;
    const found = find(location.pathname);
    const page = found?.route.page ?? "missing";
    const loaded = Promise.all([import(`./pages/${page}.js`), found?.route.style && style(page)]);
    const show = (/** @type {any} */ Page) => {
      if (!isCurrent) return;
      // A default title: the page may set a better one.
      document.title = found?.route.title ?? "No such page";
      setShown({ address, found, Page });
    };
    loaded.then(
      ([module]) => show(module.Page),
      () => show(Outdated),
    );
    return () => {
      isCurrent = false;
    };
  }, [address]);

  useEffect(() => {
    if (!shown) return;
    resetError();
    // Screen readers announce the new page.
    if (!isFirst.current) main.current?.focus();
    isFirst.current = false;
    scrollTo(0, 0);
  }, [shown]);

  const bare = shown?.found?.route.bare;
  const content = error
    ? html`<${ProblemNote} problem=${error} />`
    : shown &&
      html`<${shown.Page}
        key=${shown.address}
        ...${shown.found?.values ?? {}}
        query=${new URLSearchParams(shown.address.split("?")[1] ?? "")}
        embedded=${Boolean(bare)}
      />`;
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
if (root) render(html`<${App} />`, root);
