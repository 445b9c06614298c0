// Messages of a round.
import { html } from "../ui.js";
import { color } from "../parts/colors.js";
import { SHOWN, Shown } from "../parts/table.js";
import { Text } from "../parts/text.js";

/** @import { Head, State } from "../parts/game.js" */

/** @typedef {{head: Head, state: State, next: State | null, agent: number | null, onChoose: (agent: number) => void}} Props */

/** The maximum number of agents that a list names. */
const NAMED = 24;

/** @param {number[]} agents */
export const list = (agents) => agents.slice(0, NAMED).join(", ") + (agents.length > NAMED ? ` and ${agents.length - NAMED} more` : "");

/** An agent as a button with its colour. @param {{agent: number, onChoose: (agent: number) => void}} props */
export const AgentLink = ({ agent, onChoose }) =>
  html`<button type="button" class="agent-link" aria-label=${`Agent ${agent}`} style=${{ "--agent": color(agent) }} onClick=${() => onChoose(agent)}>${agent}</button>`;

/** The messages of the round, and their readers. @param {Props & {codes: typeof import("../parts/codes.js") | null}} props `codes`: where built-in players speak */
export function Messages({ head, state, next, codes, onChoose }) {
  if (!next) return html`<p class="muted">This is the newest round: nothing has been said in it.</p>`;
  const said = next.said ?? [];
  if (said.length === 0) return html`<p class="muted">Nobody said anything in round ${state.round}.</p>`;
  // Imported files may lack the hearers of messages.
  const isUnknown = head.status === "imported" && !next.heard;
  /** @param {{from: number, text: string, to?: number}} one */
  const row = ({ from, text, to }) => {
    const heard = (next.heard ?? []).filter((one) => one.from === from && one.sent === undefined);
    const by = heard.flatMap((one) => one.by);
    const changed = heard.filter((one) => one.text !== undefined);
    return html`<li>
      <${AgentLink} agent=${from} onChoose=${onChoose} /> “<${Text} value=${text} />” ${codes && html`<${codes.Meaning} text=${text} />`}
      <span class="muted">${to !== undefined && ` to agent ${to},`} ${by.length ? `heard by ${list(by)}` : !isUnknown && "heard by nobody"}</span>
      ${changed.map((one) => html`<br /><span class="bad small">noise: agent ${list(one.by)} reads</span> “<${Text} value=${one.text} />”`)}
    </li>`;
  };
  const late = (next.heard ?? []).filter((one) => one.sent !== undefined);
  return html`<${Shown} items=${said} wrap=${(/** @type {any[]} */ shown) => html`<ul class="plain messages">${shown.map(row)}</ul>`} />
    ${late.length > 0 &&
    html`<p class="muted small">Also arriving late: ${late.slice(0, SHOWN).map(({ from, by, sent, text }) => html`<br />agent ${from} in round ${sent} to ${list(by)}${text !== undefined && html`: “<${Text} value=${text} />”`}`)}</p>`}`;
}
