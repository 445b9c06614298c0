// Views that are a list of the server: competitions, keys, the audit log, servers.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { ActMenu } from "../parts/act.js";
import { Made } from "../parts/copy.js";
import { duration } from "../parts/duration.js";
import { Form } from "../parts/form.js";
import { Items, ListTable, unseen } from "../parts/listed.js";
import { useLoaded } from "../parts/load.js";
import { Details, Subject, actionText } from "../parts/organizers.js";
import { usePages } from "../parts/pages.js";
import { ProblemNote, Waiting } from "../parts/problem.js";
import { Name, Text, visible } from "../parts/text.js";
import { Time } from "../parts/time.js";

const AUDIT_MS = 10_000;
const SERVERS_MS = 2000;

/** All competitions, for organizers and judges. @param {{mayChange: boolean}} props */
export function Competitions({ mayChange }) {
  const list = usePages("/api/v1/competitions");
  const name = (/** @type {any} */ { id, name, hidden }) =>
    html`<a href=${route`/desk?view=competition&id=${id}`}><${Text} value=${name} /></a>${hidden && html` <span class="badge">hidden</span>`}`;
  return html`
    <h2>Competitions</h2>
    ${mayChange && html`<p><a class="button primary" href="/desk?view=create">New competition</a></p>`}
    <${ListTable} list=${list} label="Table of competitions"
      filter=${{ textOf: (one) => one.name, statusOf: (one) => one.phase, label: "Phase", placeholder: "a name" }}
      columns=${[
        ["Name", name],
        ["Phase", (one) => one.phase],
        ["Opens", (one) => html`<${Time} value=${one.opens_at} />`],
        ["Closes", (one) => html`<${Time} value=${one.closes_at} />`],
        ["Page", (one) => html`<a href=${route`/competitions/${one.id}`}>as others see it</a>`],
      ]} />
  `;
}

/** @type {import("../parts/form.js").Field[]} */
const KEY_FIELDS = [
  { name: "name", label: "Whose it is", isRequired: true, max: 100 },
  { name: "role", label: "Role", kind: "choice", initial: "member", options: [
    ["member", "member: creates games and runs, enters competitions"],
    ["entrant", "entrant: enters competitions and plays their attempts"],
    ["judge", "judge: reads everything but keys and contacts, changes nothing"],
    ["organizer", "organizer: may do everything"],
  ] },
  { name: "expires_at", label: "Expires", kind: "time", help: "Left empty: never." },
];

/** Keys for people. */
export function Keys() {
  const list = usePages("/api/v1/keys");
  const [made, setMade] = useState(/** @type {any} */ (null));
  const create = async (/** @type {any} */ body) => {
    setMade(await request("/api/v1/keys", { method: "POST", body }));
    list.reload();
  };
  const revoke = (/** @type {any} */ { id }) => ({
    label: "Revoke",
    act: () => request(route`/api/v1/keys/${id}`, { method: "DELETE" }),
    text: "It is not accepted any more, at once and for ever. Games that were created with it continue, and their tokens stay valid.",
    children: html`<p class="muted">Where it is the key of this tab, this desk closes.</p>`,
  });
  return html`
    <h2>Keys</h2>
    <${Made} value=${made?.secret} label=${`Key of ${visible(made?.name)} (${made?.role})`} to="its holder" />
    <details><summary>New key</summary><${Form} fields=${KEY_FIELDS} label="Create a key" send=${create} /></details>
    <${ListTable} list=${list} label="Table of keys"
      filter=${{ textOf: (one) => [one.name, one.role, one.id].join("\n"), statusOf: (one) => one.state, label: "State", placeholder: "a name, a role, an id", initial: "good" }}
      columns=${[
        ["Holder", (one) => html`<${Name} value=${one.name} /><div><code class="id">${one.id}</code></div>`],
        ["Role", (one) => one.role],
        ["State", (one) => html`${one.state}${one.revoked_at && html` <${Time} value=${one.revoked_at} />`}`],
        ["Created", (one) => html`<${Time} value=${one.created_at} />`],
        ["Expires", (one) => (one.expires_at ? html`<${Time} value=${one.expires_at} />` : "never")],
        [unseen("Actions"), (one) => html`<${ActMenu} of=${`the key of ${visible(one.name)}`} acts=${[one.state === "good" && revoke(one)]} done=${list.reload} />`],
      ]} />
  `;
}

/** The maximum number of competitions whose entrants are asked for by their names, and of entrants of each. */
const COMPETITIONS_MAX = 5;
const ENTRANTS_MAX = 1000;

/** Details that only the audit log has, in words; others need no word, or have their own in `Details`. */
const WORDS = { name: "name", role: "role", description: "those with", doubt: "why it was in doubt" };

/** @param {{mayChange: boolean}} props */
export function Audit({ mayChange }) {
  const list = usePages("/api/v1/audit", AUDIT_MS);
  // Judges do not read keys.
  const named = useLoaded((signal) => namesOf(mayChange ? ["/api/v1/keys", "/api/v1/competitions"] : ["/api/v1/competitions"], signal), [mayChange]);
  // Entrants have their names from the competitions of the entries that are loaded.
  const about = list.items.filter(({ subject, detail }) => subject.startsWith("ent_") && detail?.competition);
  const paths = [...new Set(about.map(({ detail }) => route`/api/v1/competitions/${detail.competition}/entrants`))].slice(0, COMPETITIONS_MAX);
  const entrants = useLoaded((signal) => namesOf(paths, signal, ENTRANTS_MAX), [paths.join()]);
  const names = new Map([...(named.value ?? []), ...(entrants.value ?? [])]);
  const whoOf = (/** @type {any} */ { who }) => names.get(who) ?? (who === "local" ? "on the server's machine" : who);
  const textOf = (/** @type {any} */ one) => [whoOf(one), names.get(one.subject), JSON.stringify(one)].join("\n");
  const details = (/** @type {any} */ { detail }) =>
    html`<div class="small"><${Details} detail=${detail ?? {}} names=${names} /><${Others} detail=${detail ?? {}} names=${names} /></div>`;
  return html`
    <h2>Audit log</h2>
    <p>What organizers did, and what judges read of sealed games, newest first. It is stored together with what it describes.</p>
    <${ListTable} list=${list} label="Table of audit entries" header=${2}
      filter=${{ textOf, statusOf: (one) => actionText(one.action), label: "What", placeholder: "an id, a name, a reason" }}
      columns=${[
        ["When", (one) => html`<${Time} value=${one.at} />`],
        ["Who", (one) => html`<${Text} value=${whoOf(one)} title=${one.who} />`],
        ["What", (one) => html`<${Text} value=${actionText(one.action)} title=${one.action} />`],
        ["Concerns", (one) => html`<${Subject} id=${one.subject} detail=${one.detail} names=${names} isHere=${false} />`],
        ["Details", details],
      ]} />
  `;
}

/** Names by ids. @param {string[]} paths of lists @param {AbortSignal} signal @param {number} [limit] */
async function namesOf(paths, signal, limit = 100) {
  const pages = await Promise.all(paths.map((path) => request(`${path}?limit=${limit}`, { signal })));
  return new Map(pages.flatMap(({ items }) => items.map(({ id, name }) => [id, name])));
}

/** @param {{detail: any, names: Map<string, string>}} props */
const Others = ({ detail, names }) =>
  html`${names.has(detail.competition) && html`<div>in <${Text} value=${names.get(detail.competition)} /></div>`}
    ${detail.moved_ms !== undefined && html`<div>moved by ${duration(Math.abs(detail.moved_ms))} ${detail.moved_ms < 0 ? "back" : "ahead"}</div>`}
    ${Object.entries(WORDS)
      .filter(([name]) => detail[name] !== undefined && detail[name] !== null)
      .map(([name, word]) => html`<div><span class="muted">${word}</span> <${Text} value=${[detail[name]].flat().join(", ")} /></div>`)}`;

/** The silence after which others take over a server's games. */
const TAKEN_OVER_AFTER_MS = 6000;

/** The maximum offset of a clock. */
const CLOCK_OFF_MAX_MS = 500;

/** The servers that play on the same database. */
export function Servers() {
  const loaded = useLoaded((signal) => request("/api/v1/nodes", { signal }), [], SERVERS_MS);
  if (!loaded.value) return html`<${Waiting} of=${loaded} />`;
  const { cluster, items } = loaded.value;
  const faults = items.flatMap(faultsOf);
  return html`
    <h2>Servers</h2>
    ${loaded.problem && html`<${ProblemNote} problem=${loaded.problem} retry=${loaded.reload} />`}
    <p>
      ${cluster
        ? "These servers play on the same database. Each game is played by one of them, and any of them answers. When one dies, the others take its games over."
        : "This server has its database to itself. With PostgreSQL several servers can share one."}
    </p>
    ${faults.length > 0 && html`<ul role="status">${faults.map((fault) => html`<li class="bad"><${Text} value=${fault} /></li>`)}</ul>`}
    <${Items} items=${items} label="Table of servers" columns=${[
      ["Server", (one) => html`<${Text} value=${one.name} />${one.is_this && html` <span class="muted">(answers this page)</span>`}`],
      ["State", (one) => html`<span class=${one.connected ? "" : "bad"}>${stateOf(one, cluster)}</span>`],
      ["#Plays", (one) => one.places],
      ["#In memory", (one) => one.episodes],
      ["#Seen", (one) => (cluster ? `${(one.seen_ms_ago / 1000).toFixed(1)} s ago` : "–")],
      ["#Clock", (one) => (cluster ? `${one.clock_offset_ms > 0 ? "+" : ""}${one.clock_offset_ms} ms` : "–")],
      ["Address for servers", (one) => (one.address ? html`<code><${Text} value=${one.address} /></code>` : "–")],
      ["Version", (one) => html`<${Text} value=${one.version} />`],
      ["Started", (one) => html`<${Time} value=${one.started_at} />`],
    ]} />
    <p class="muted">Plays: games without a run, runs and competitions. Clock: how far it is ahead of the database's.</p>
  `;
}

/** @param {any} one @param {boolean} cluster */
function stateOf(one, cluster) {
  if (!one.connected) return "not connected to the database";
  if (one.ready) return cluster ? "takes games" : "ready";
  return cluster ? "takes no games: it starts, stops, or only forwards" : "starts";
}

/** Warnings for the operator. @param {any} one */
const faultsOf = ({ name, seen_ms_ago, clock_offset_ms }) => [
  ...(seen_ms_ago > TAKEN_OVER_AFTER_MS ? [`${name} was not seen for ${Math.round(seen_ms_ago / 1000)} s, and is taken over.`] : []),
  ...(Math.abs(clock_offset_ms) > CLOCK_OFF_MAX_MS ? [`The clock of ${name} is ${clock_offset_ms} ms off: synchronize it with that of the database.`] : []),
];
