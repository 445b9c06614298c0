// The desk: what a key may see and change beside the pages of everybody, one view per part.
import { html } from "../ui.js";
import { request, route } from "../api.js";
import { holder } from "../parts/caller.js";
import { Commands } from "../parts/copy.js";
import { openKeyDialog } from "../parts/header.js";
import { Part, useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { useTitle } from "../parts/query.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

/** @typedef {import("../parts/caller.js").Role} Role */

const OVERSEERS = /** @type {Role[]} */ (["organizer", "judge"]);
const PLAYERS = /** @type {Role[]} */ (["organizer", "other", "none"]);

/** Modules with several views. */
const lists = () => import("../desk/lists.js");
const forms = () => import("../desk/forms.js");
const played = () => import("../desk/played.js");

/**
 * Views by their names in the address: their components, and the roles that have them, all where nothing is said. Those with a parent are
 * below it.
 * @type {Record<string, {title: string, load: () => Promise<any>, view: string, roles?: Role[], parent?: string}>}
 */
const VIEWS = {
  health: { title: "Health", load: () => import("../desk/health.js"), view: "Health" },
  competitions: { title: "Competitions", load: lists, view: "Competitions", roles: OVERSEERS },
  create: { title: "New competition", load: forms, view: "Create", roles: ["organizer"], parent: "competitions" },
  competition: { title: "Competition", load: () => import("../desk/competition.js"), view: "Competition", roles: OVERSEERS, parent: "competitions" },
  keys: { title: "Keys", load: lists, view: "Keys", roles: ["organizer"] },
  games: { title: "Games", load: played, view: "Games" },
  runs: { title: "Runs", load: played, view: "Runs" },
  start: { title: "Start", load: forms, view: "Start", roles: PLAYERS },
  exports: { title: "Exports", load: forms, view: "Exports" },
  nodes: { title: "Servers", load: lists, view: "Servers", roles: OVERSEERS },
  audit: { title: "Audit log", load: lists, view: "Audit", roles: OVERSEERS },
};

/** @param {{query: URLSearchParams}} props */
export function Page({ query }) {
  const asked = query.get("view") ?? "";
  const name = Object.hasOwn(VIEWS, asked) ? asked : "health";
  const { title, load, view, parent, roles } = VIEWS[name];
  const { value: whose, problem, reload } = useLoaded(holder, []);
  const role = whose?.role;
  useTitle(`${title}: desk`);
  const has = (/** @type {{roles?: Role[]}} */ { roles }) => role && (!roles || roles.includes(role));
  return html`
    <h1>Desk</h1>
    ${whose && html`<${Whose} ...${whose} />`}
    <nav class="views" aria-label="Views of the desk">
      ${Object.entries(VIEWS)
        .filter(([, view]) => !view.parent && has(view))
        .map(([one, view]) => html`<a href=${`/desk?view=${one}`} aria-current=${one === (parent ?? name) ? "page" : undefined}>${view.title}</a>`)}
    </nav>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    ${role && (has({ roles }) ? html`<${Part} key=${name} read=${load} name=${view} props=${{ query, mayChange: role === "organizer", isJudge: role === "judge" }} />` : html`<${NeedsKey} />`)}
  `;
}

/** Whose key this is, and what it may change. @type {Record<Role, {name: string, may: string}>} */
const WHOSE = {
  organizer: { name: "An organizer's key", may: "You may change all competitions, games, runs and keys of this server." },
  judge: { name: "A judge's key", may: "You read all competitions, games and runs, also before their end, and the audit log, and change nothing. What you open of a sealed game is noted there." },
  other: { name: "The key of an entrant or a member", may: "You see what everybody sees, and may end what was created with this key." },
  none: { name: "No key in this tab", may: "You see what everybody sees. A key from an organizer shows more." },
};

/** @param {import("../parts/caller.js").Holder} props */
const Whose = ({ role, name, expires_at: end }) => html`<p class="whose">
    <strong>${WHOSE[role].name}${name && html`: <${Text} value=${name} />`}.</strong>${" "}
    ${end && html`It expires on <${Time} value=${end} />. `}${WHOSE[role].may}
    ${role === "none" && html` <button type="button" onClick=${openKeyDialog}>Enter a key</button>`}
  </p>
  ${role === "other" && html`<${Entries} />`}`;

/** The entrants of this key in competitions that are not over. */
function Entries() {
  const { value } = useLoaded(entriesOf, []);
  return value &&
    value.length > 0 &&
    html`<p>In competitions it may change: ${value.map(
      ({ competition: { id, name }, entrant }, place) =>
        html`${place > 0 && ", "}<${Text} value=${entrant.name} /> in <a href=${route`/competitions/${id}`}><${Text} value=${name} /></a>`,
    )}.</p>`;
}

/** @param {AbortSignal} signal */
async function entriesOf(signal) {
  const { items } = await request("/api/v1/competitions?limit=20", { signal });
  const current = items.filter(({ phase }) => ["announced", "open", "closing"].includes(phase));
  const own = await Promise.all(current.map(({ id }) => request(`${route`/api/v1/competitions/${id}/entrants`}?own=true`, { signal })));
  return own.flatMap(({ items }, place) => items.map((entrant) => ({ competition: current[place], entrant })));
}

const NeedsKey = () => html`<section class="inset">
  <h2>This view needs an organizer's key</h2>
  <p>An organizer manages competitions and keys, voids games, and reads the audit log; a judge reads all of it but keys.</p>
  <p class="buttons"><button type="button" onClick=${openKeyDialog}>Enter a key</button></p>
  <p>Another organizer makes a key at this desk. The first one is made on the server's machine, with the file of its database:</p>
  <${Commands} label="How to make the first key" lines=${["swarmbench key create --name NAME --role organizer --db swarmbench.db"]} />
</section>`;
