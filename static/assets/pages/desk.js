// The organizer's desk: what an organizer can do by the API, one view for each part of it.
import { html, useEffect } from "../ui.js";
import { Problem, key, request } from "../api.js";
import { Audit } from "../desk/audit.js";
import { Competition } from "../desk/competition.js";
import { Competitions } from "../desk/competitions.js";
import { Create } from "../desk/create.js";
import { Exports } from "../desk/exports.js";
import { Games } from "../desk/games.js";
import { Health } from "../desk/health.js";
import { Keys } from "../desk/keys.js";
import { Runs } from "../desk/runs.js";
import { Start } from "../desk/start.js";
import { Commands } from "../parts/copy.js";
import { openKeyDialog } from "../parts/header.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";

/** Views by their names in the address. Those `forAll` show what every caller may see and do. */
const VIEWS = {
  health: { title: "Health", forAll: true },
  competitions: { title: "Competitions" },
  keys: { title: "Keys" },
  games: { title: "Games", forAll: true },
  runs: { title: "Runs", forAll: true },
  start: { title: "Start", forAll: true },
  exports: { title: "Exports", forAll: true },
  audit: { title: "Audit log" },
};

/** Views below others. */
const PARENTS = { create: "competitions", competition: "competitions" };

/** @typedef {"organizer" | "other" | "none"} Role */

/** @param {{query: URLSearchParams}} props */
export function Page({ query }) {
  const asked = query.get("view") ?? "health";
  const parent = PARENTS[asked] ?? asked;
  const view = Object.hasOwn(VIEWS, parent) ? parent : "health";
  const { value: role, problem, reload } = useLoaded(roleOf, []);
  useEffect(() => {
    document.title = `${VIEWS[view].title} · Organizer's desk`;
  }, [view]);
  return html`
    <h1>Organizer's desk</h1>
    <nav class="views" aria-label="Views of the desk">
      ${Object.entries(VIEWS).map(
        ([name, { title }]) => html`<a href=${`/desk?view=${name}`} aria-current=${name === view ? "page" : undefined}>${title}</a>`,
      )}
    </nav>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    ${role && (role === "organizer" || VIEWS[view].forAll) && html`<${View} asked=${asked} view=${view} query=${query} isOrganizer=${role === "organizer"} />`}
    ${role && role !== "organizer" && html`<${NeedsKey} role=${role} isNote=${Boolean(VIEWS[view].forAll)} />`}
  `;
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

/** @param {{asked: string, view: string, query: URLSearchParams, isOrganizer: boolean}} props */
function View({ asked, view, query, isOrganizer }) {
  const status = query.get("status");
  if (asked === "create") return html`<${Create} />`;
  if (asked === "competition") return html`<${Competition} id=${query.get("id") ?? ""} />`;
  if (view === "competitions") return html`<${Competitions} />`;
  if (view === "keys") return html`<${Keys} />`;
  if (view === "games") return html`<${Games} run=${query.get("run")} status=${status} isOrganizer=${isOrganizer} />`;
  if (view === "runs") return html`<${Runs} status=${status} />`;
  if (view === "start") return html`<${Start} />`;
  if (view === "exports") return html`<${Exports} />`;
  if (view === "audit") return html`<${Audit} />`;
  return html`<${Health} mayConfirm=${isOrganizer} />`;
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
