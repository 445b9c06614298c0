// Messages of a round.
import { html, useState } from "../ui.js";
import { color } from "../parts/colors.js";
import { Text } from "../parts/text.js";

/** @import { Head, State } from "../parts/game.js" */

/** @typedef {{head: Head, state: State, next: State | null, agent: number | null, onChoose: (agent: number) => void}} Props */

/** The number of rows, messages or windows shown at first; more on request. */
const SHOWN = 48;

/** The maximum number of agents that a list names. */
const NAMED = 24;

/** @param {number[]} agents */
export const list = (agents) => agents.slice(0, NAMED).join(", ") + (agents.length > NAMED ? ` and ${agents.length - NAMED} more` : "");

/** An agent as a button with its colour. @param {{agent: number, onChoose: (agent: number) => void}} props */
export const AgentLink = ({ agent, onChoose }) =>
  html`<button type="button" class="agent-link" aria-label=${`Agent ${agent}`} style=${{ "--agent": color(agent) }} onClick=${() => onChoose(agent)}>${agent}</button>`;

/** The first of many things, and a button for more. @param {{items: any[], wrap: (shown: any[]) => unknown}} props */
export function Shown({ items, wrap }) {
  const [count, setCount] = useState(SHOWN);
  return html`${wrap(items.slice(0, count))}
  ${items.length > count && html`<p><button type="button" onClick=${() => setCount(count + SHOWN)}>Show more (${items.length - count})</button></p>`}`;
}

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
