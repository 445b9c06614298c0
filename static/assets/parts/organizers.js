// Organizers' actions in a competition, as everybody sees them.
import { html } from "../ui.js";
import { route } from "../api.js";
import { More } from "./pages.js";
import { ProblemNote } from "./problem.js";
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
  "key.revoke": "Revoked a key of an entrant",
  "entrants.exclude": "Excluded entrants",
  "member.add": "Added a member to a team",
  "member.remove": "Removed a member from a team",
  "attempt.void": "Voided an attempt",
  "run.abort": "Ended an attempt",
  "run.token": "Replaced the token of an attempt",
  "episode.void": "Voided a game",
  "episode.abort": "Ended a game",
};

/** The maximum number of entrants' names in an entry, beside their count. */
const NAMES_SHOWN = 20;

/** The fields of ends that organizers can extend. */
const END = /^(?:attempts\[(\d+)\]\.)?closes_at$/;

/** @param {{list: ReturnType<typeof import("./pages.js").usePages>, names: Map<string, string>}} props names: of entrants */
export function Actions({ list, names }) {
  if (list.problem && !list.value) return html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`;
  if (!list.value) return html`<p class="muted" role="status">Loading …</p>`;
  if (list.items.length === 0) return html`<p class="empty">Nothing since it was created.</p>`;
  return html`<div class="scroll" tabindex="0" role="region" aria-label="Table of what organizers did">
      <table>
        <thead><tr><th scope="col">When</th><th scope="col">What</th><th scope="col">Concerns</th><th scope="col">Details</th></tr></thead>
        <tbody>
          ${list.items.map(
            (one) => html`<tr>
              <td><${Time} value=${one.at} /></td>
              <th scope="row">${ACTIONS[one.action] ?? html`<${Text} value=${one.action} />`}</th>
              <td><${Subject} id=${one.subject} detail=${one.detail} names=${names} /></td>
              <td><${Details} detail=${one.detail ?? {}} names=${names} /></td>
            </tr>`,
          )}
        </tbody>
      </table>
    </div>
    <${More} list=${list} />`;
}

/** @param {{id: string, detail: any, names: Map<string, string>}} props */
function Subject({ id, detail, names }) {
  const name = names.get(detail?.entrant ?? id);
  const who = name && html`<${Text} value=${name} />`;
  if (id.startsWith("cmp_")) return "the competition";
  if (id.startsWith("run_")) return html`<a href=${route`/runs/${id}`}>attempt ${detail?.attempt}</a>${who && html` of ${who}`}`;
  if (id.startsWith("ep_")) return html`<a href=${route`/episodes/${id}`}>a game</a>`;
  return who ?? html`<${Text} value=${id} />`;
}

/** @param {{detail: any, names: Map<string, string>}} props */
const Details = ({ detail, names }) => {
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
  if (end) return html`${end[1] ? `attempt ${Number(end[1]) + 1} closes` : "closes"} <${Time} value=${to} both />, earlier <${Time} value=${from} both />`;
  if (field === "hidden") return to ? "hidden" : "in lists again";
  if (field === "description") {
    return html`another description
      <details><summary>The earlier one</summary><${Lines} value=${from} /></details>`;
  }
  if (field === "terms") {
    return html`version ${to.version} of the terms
      ${from && html`<details><summary>The earlier one</summary><${Lines} value=${from.text} /></details>`}`;
  }
  return html`<${Text} value=${field} />: <${Text} value=${to} />, earlier <${Text} value=${from} />`;
}

/**
 * The original ends of extended windows and competitions, by field.
 * @param {any[]} actions newest first
 * @returns {Map<string, string>}
 */
export function firstEnds(actions) {
  const ends = new Map();
  for (const { action, detail } of actions) {
    if (action !== "competition.change") continue;
    for (const { field, from } of detail?.changes ?? []) if (END.test(field)) ends.set(field, from);
  }
  return ends;
}
