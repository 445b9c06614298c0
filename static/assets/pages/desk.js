// The organizer's desk: the API's functions for organizers, one view per part.
import { html, useEffect } from "../ui.js";
import { Problem, key, request } from "../api.js";
import { Commands } from "../parts/copy.js";
import { openKeyDialog } from "../parts/header.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";

/**
 * Views by their names in the address. Those `forAll` show what every caller may see and do; those with a parent are below it.
 * @type {Record<string, {title: string, load: () => Promise<any>, forAll?: boolean, parent?: string}>}
 */
const VIEWS = {
  health: { title: "Health", load: () => import("../desk/health.js"), forAll: true },
  competitions: { title: "Competitions", load: () => import("../desk/competitions.js") },
  create: { title: "New competition", load: () => import("../desk/create.js"), parent: "competitions" },
  competition: { title: "Competition", load: () => import("../desk/competition.js"), parent: "competitions" },
  keys: { title: "Keys", load: () => import("../desk/keys.js") },
  games: { title: "Games", load: () => import("../desk/games.js"), forAll: true },
  runs: { title: "Runs", load: () => import("../desk/runs.js"), forAll: true },
  start: { title: "Start", load: () => import("../desk/start.js"), forAll: true },
  exports: { title: "Exports", load: () => import("../desk/exports.js"), forAll: true },
  nodes: { title: "Servers", load: () => import("../desk/nodes.js") },
  audit: { title: "Audit log", load: () => import("../desk/audit.js") },
};

/** @typedef {"organizer" | "other" | "none"} Role */

/** @param {{query: URLSearchParams}} props */
export function Page({ query }) {
  const asked = query.get("view") ?? "";
  const name = Object.hasOwn(VIEWS, asked) ? asked : "health";
  const { title, parent, forAll } = VIEWS[name];
  const { value: role, problem, reload } = useLoaded(roleOf, []);
  useEffect(() => {
    document.title = `${title} · Organizer's desk`;
  }, [title]);
  const isOrganizer = role === "organizer";
  return html`
    <h1>Organizer's desk</h1>
    <nav class="views" aria-label="Views of the desk">
      ${Object.entries(VIEWS)
        .filter(([, view]) => !view.parent)
        .map(([one, view]) => html`<a href=${`/desk?view=${one}`} aria-current=${one === (parent ?? name) ? "page" : undefined}>${view.title}</a>`)}
    </nav>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    ${role && (isOrganizer || forAll) && html`<${Shown} view=${VIEWS[name]} query=${query} isOrganizer=${isOrganizer} />`}
    ${role && !isOrganizer && html`<${NeedsKey} role=${role} isNote=${Boolean(forAll)} />`}
  `;
}

/** A view, once its module is loaded. @param {{view: {load: () => Promise<any>}, query: URLSearchParams, isOrganizer: boolean}} props */
function Shown({ view, query, isOrganizer }) {
  const { value: module, problem, reload } = useLoaded(view.load, []);
  if (module) return html`<${module.View} query=${query} isOrganizer=${isOrganizer} />`;
  return problem ? html`<${ProblemNote} problem=${problem} retry=${reload} />` : html`<p class="muted" role="status">Loading …</p>`;
}

/** Whose key this tab has. @param {AbortSignal} signal @returns {Promise<Role>} */
async function roleOf(signal) {
  if (!key()) return "none";
  try {
    await request("/api/v1/audit?limit=1", { signal });
    return "organizer";
  } catch (error) {
    if (error instanceof Problem && error.status === 403) return "other";
    throw error;
  }
}

/** @param {{role: Role, isNote: boolean}} props isNote: the view shows what everybody may see */
const NeedsKey = ({ role, isNote }) => html`<section class="inset">
  <h2>${isNote ? "More with an organizer's key" : "This view needs an organizer's key"}</h2>
  <p>
    ${role === "none"
      ? "This tab has no key."
      : "The key of this tab is not an organizer's. You see what everybody sees, and can end what was created with your key."}
    ${" "}An organizer also manages competitions and keys, voids games, and reads the audit log.
  </p>
  <p class="buttons"><button type="button" onClick=${openKeyDialog}>Enter a key</button></p>
  <p>Another organizer makes a key at this desk. The first one is made on the server's machine, with the file of its database:</p>
  <${Commands} label="How to make the first key" lines=${["swarmbench key create --name NAME --role organizer --db swarmbench.db"]} />
</section>`;
