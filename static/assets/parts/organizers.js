// Organizers' actions in a competition, as everybody sees them.
import { html } from "../ui.js";
import { route } from "../api.js";
import { ListTable } from "./listed.js";
import { Lines, Text } from "./text.js";
import { Time } from "./time.js";

/** Actions of the API in words. @type {Record<string, string>} */
const ACTIONS = {
  "competition.create": "Created it",
  "competition.change": "Changed it",
  "competition.cancel": "Cancelled it",
  "competition.announce": "Announced",
  "competition.codes": "Made invitation codes",
  "competition.codes.revoke": "Revoked invitation codes",
  "competition.export": "Downloaded the file",
  "entrant.change": "Changed an entrant",
  "entrant.erase": "Erased an entrant",
  "entrant.key": "Replaced the key of an entrant",
  "entrant.rename": "An entrant renamed itself",
  "entrants.contacts": "Read the contacts of entrants",
  "entrants.exclude": "Excluded entrants",
  "key.create": "Made a key",
  "key.revoke": "Revoked a key",
  "member.add": "Added a member to a team",
  "member.remove": "Removed a member from a team",
  "attempt.void": "Voided an attempt",
  "run.abort": "Ended a run",
  "run.token": "Replaced the token of a run",
  "episode.void": "Voided a game",
  "episode.abort": "Ended a game",
  "sealed.read": "Read a sealed game or run",
  "clock.confirm": "Confirmed the clock",
};

/** An action of the API in words. @param {string} action */
export const actionText = (action) => ACTIONS[action] ?? action.replaceAll(".", " ");

/** The maximum number of entrants' names in an entry, beside their count. */
const NAMES_SHOWN = 20;

/** The fields of ends that organizers can extend. */
const END = /^(?:attempts\[(\d+)\]\.)?closes_at$/;

/** @param {{list: ReturnType<typeof import("./pages.js").usePages>, names: Map<string, string>}} props names: of entrants */
export const Actions = ({ list, names }) => html`<${ListTable} list=${list} label="Table of what organizers did" header=${1} empty="Nothing since it was created."
  columns=${[
    ["When", (one) => html`<${Time} value=${one.at} />`],
    ["What", (one) => html`<${Text} value=${actionText(one.action)} />`],
    ["Concerns", (one) => html`<${Subject} id=${one.subject} detail=${one.detail} names=${names} />`],
    ["Details", (one) => html`<${Details} detail=${one.detail ?? {}} names=${names} />`],
  ]} />`;

/** What an action concerns. @param {{id: string, detail: any, names: Map<string, string>, isHere?: boolean}} props isHere: its competition is this page's */
export function Subject({ id, detail, names, isHere = true }) {
  const name = names.get(detail?.entrant ?? id);
  const who = name && html`<${Text} value=${name} />`;
  if (id.startsWith("cmp_")) return isHere ? "the competition" : html`<a href=${route`/competitions/${id}`}>${who ?? "a competition"}</a>`;
  if (id.startsWith("run_") && !detail?.attempt) return html`<a href=${route`/runs/${id}`}>a run</a>`;
  if (id.startsWith("run_")) return html`<a href=${route`/runs/${id}`}>attempt ${detail?.attempt}</a>${who && html` of ${who}`}`;
  if (id.startsWith("ep_")) return html`<a href=${route`/episodes/${id}`}>a game</a>`;
  if (id === "clock") return "the clock";
  return who ?? html`<span class="muted">${id.startsWith("ent_") ? "an entrant, " : id.startsWith("key_") ? "a key, " : ""}</span><code class="id"><${Text} value=${id} /></code>`;
}

/** What an action changed. @param {{detail: any, names: Map<string, string>}} props */
export const Details = ({ detail, names }) => {
  const { changes = [], entrants = [], reason, status, vouched, codes, text, category, rewritten = [] } = detail;
  return html`${text && html`<${Lines} value=${text} />`}${changes.map((change) => html`<div><${Changed} ...${change} /></div>`)}
    ${status && html`<div>now ${status}${vouched && ", vouched"}</div>`}
    ${!status && vouched !== undefined && html`<div>${vouched ? "vouched for" : "not vouched for"}</div>`}
    ${category && html`<div><${Changed} field="category" ...${category} /></div>`}
    ${rewritten.length > 0 && html`<div>another ${rewritten.join(" and another ")}</div>`}
    ${codes > 0 && html`<div>${codes === 1 ? "1 code" : `${codes} codes`}</div>`}
    ${entrants.length > 0 &&
    html`<div>
      ${entrants.length === 1 ? "1 entrant" : `${entrants.length} entrants`}: ${entrants.slice(0, NAMES_SHOWN).map((id, index) => html`${index > 0 && ", "}<${Text} value=${names.get(id) ?? id} />`)}${entrants.length > NAMES_SHOWN && " …"}
    </div>`}
    ${reason && html`<div>Reason: <${Text} value=${reason} /></div>`}`;
};

/** @param {{field: string, from: any, to: any}} props */
function Changed({ field, from, to }) {
  const end = END.exec(field);
  const earlier = (/** @type {string} */ text) => html`<details><summary>The earlier one</summary><${Lines} value=${text} /></details>`;
  if (end) return html`${end[1] ? `attempt ${Number(end[1]) + 1} closes` : "closes"} <${Time} value=${to} both />, earlier <${Time} value=${from} both />`;
  if (field === "hidden") return to ? "hidden" : "in lists again";
  if (field === "description") return html`another description ${earlier(from)}`;
  if (field === "terms") return html`version ${to.version} of the terms ${from && earlier(from.text)}`;
  return html`<${Text} value=${field} />: <${Text} value=${to} />, earlier <${Text} value=${from} />`;
}

/** The original ends of extended windows and competitions, by field. @param {any[]} actions newest first @returns {Map<string, string>} */
export function firstEnds(actions) {
  const changes = actions.filter(({ action }) => action === "competition.change").flatMap(({ detail }) => detail?.changes ?? []);
  return new Map(changes.filter(({ field }) => END.test(field)).map(({ field, from }) => [field, from]));
}
