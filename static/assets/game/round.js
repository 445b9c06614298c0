// All agents in one round: messages, a table, and all windows.
import { html, useState } from "../ui.js";
import { actionOf, resultOf } from "../parts/actions.js";
import { color } from "../parts/colors.js";
import { Text } from "../parts/text.js";
import { AgentWindow, surroundings } from "../parts/window.js";

/** @import { Head, State } from "../parts/game.js" */

/** @typedef {{head: Head, state: State, next: State | null, agent: number | null, onChoose: (agent: number) => void}} Props */

/** The number of rows, messages or windows shown at first; more on request. */
const SHOWN = 48;

/** The maximum number of agents that a list names. */
const NAMED = 24;

/** @param {number[]} agents */
const list = (agents) => agents.slice(0, NAMED).join(", ") + (agents.length > NAMED ? ` and ${agents.length - NAMED} more` : "");

/** An agent as a button with its colour. @param {{agent: number, onChoose: (agent: number) => void}} props */
export const AgentLink = ({ agent, onChoose }) =>
  html`<button type="button" class="agent-link" aria-label=${`Agent ${agent}`} style=${{ "--agent": color(agent) }} onClick=${() => onChoose(agent)}>${agent}</button>`;

/** The first of many things, and a button for more. @param {{items: any[], wrap: (shown: any[]) => unknown}} props */
function Shown({ items, wrap }) {
  const [count, setCount] = useState(SHOWN);
  return html`${wrap(items.slice(0, count))}
  ${items.length > count && html`<p><button type="button" onClick=${() => setCount(count + SHOWN)}>Show more (${items.length - count})</button></p>`}`;
}

/** The messages of the round, and their readers. @param {Props} props */
export function Messages({ head, state, next, onChoose }) {
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
      <${AgentLink} agent=${from} onChoose=${onChoose} /> “<${Text} value=${text} />”
      <span class="muted">${to !== undefined && ` to agent ${to},`} ${by.length ? `heard by ${list(by)}` : !isUnknown && "heard by nobody"}</span>
      ${changed.map((one) => html`<br /><span class="bad small">noise: agent ${list(one.by)} reads</span> “<${Text} value=${one.text} />”`)}
    </li>`;
  };
  const late = (next.heard ?? []).filter((one) => one.sent !== undefined);
  return html`<${Shown} items=${said} wrap=${(/** @type {any[]} */ shown) => html`<ul class="plain messages">${shown.map(row)}</ul>`} />
    ${late.length > 0 &&
    html`<p class="muted small">Also arriving late: ${late.slice(0, SHOWN).map(({ from, by, sent, text }) => html`<br />agent ${from} in round ${sent} to ${list(by)}${text !== undefined && html`: “<${Text} value=${text} />”`}`)}</p>`}`;
}

/** @type {[string, string][]} */
const COLUMNS = [["agent", "Agent"], ["row", "Row"], ["column", "Column"], ["action", "Action"], ["result", "Result"], ["message", "Message"]];

/** All agents as a table: the map for screen readers. @param {Props} props */
export function AgentTable({ head, state, next, agent, onChoose }) {
  const [order, setOrder] = useState({ by: "agent", isDown: false });
  const rows = Array.from({ length: head.num_agents }, (_, n) => rowOf(state, next, n)).sort((a, b) => compare(a[order.by], b[order.by]) * (order.isDown ? -1 : 1));
  /** @param {string} by */
  const sort = (by) => setOrder({ by, isDown: order.by === by && !order.isDown });
  const marked = state.lit ? "Light" : state.loaded ? "Load" : null;
  /** @param {any[]} shown */
  const table = (shown) => html`<div class="scroll" tabindex="0" role="region" aria-label="Table of all agents">
    <table class="agents">
      <caption>All agents in round ${state.round}</caption>
      <thead>
        <tr>
          ${COLUMNS.map(([name, title]) => html`<th scope="col" aria-sort=${order.by === name ? (order.isDown ? "descending" : "ascending") : undefined}>
            <button type="button" onClick=${() => sort(name)}>${title}${order.by === name && (order.isDown ? " ↓" : " ↑")}</button>
          </th>`)}
          ${marked && html`<th scope="col">${marked}</th>`}
        </tr>
      </thead>
      <tbody>
        ${shown.map((row) => html`<tr key=${row.agent} class=${row.agent === agent ? "chosen" : ""}>
          <th scope="row"><${AgentLink} agent=${row.agent} onChoose=${onChoose} /></th>
          <td class="number">${row.row ?? "–"}</td><td class="number">${row.column ?? "–"}</td>
          <td>${row.action}</td><td>${row.result}</td><td><${Text} value=${row.message} /></td>
          ${marked && html`<td>${row.marked}</td>`}
        </tr>`)}
      </tbody>
    </table>
  </div>`;
  return html`<${Shown} items=${rows} wrap=${table} />`;
}

/** @param {State} state @param {State | null} next @param {number} n @returns {Record<string, any>} */
function rowOf(state, next, n) {
  const isGone = state.gone?.includes(n);
  const said = next?.said?.find((one) => one.from === n)?.text ?? "";
  return {
    agent: n,
    row: isGone ? null : state.at[2 * n],
    column: isGone ? null : state.at[2 * n + 1],
    action: isGone ? "not on the map" : (actionOf(next, n)?.name ?? ""),
    result: resultOf(next, n),
    message: said,
    marked: state.lit ? (state.lit.includes(n) ? "on" : "off") : state.loaded?.includes(n) ? "food" : "",
  };
}

/** @param {any} a @param {any} b */
const compare = (a, b) => (typeof a === "string" ? a.localeCompare(b) : (a ?? -1) - (b ?? -1));

/** The windows of all agents. @param {Props} props */
export function AllWindows({ head, state, next, onChoose }) {
  if (head.control === "centralized") return html`<p class="muted">Agents of this game see the whole map.</p>`;
  const there = Array.from({ length: head.num_agents }, (_, n) => n).filter((n) => !state.gone?.includes(n));
  /** @param {number} n */
  const one = (n) => html`<li key=${n}>
    <div><${AgentLink} agent=${n} onChoose=${onChoose} /> <span class="small">${actionOf(next, n)?.name ?? ""} <span class="bad">${resultOf(next, n)}</span></span></div>
    <${AgentWindow} cells=${surroundings(head, state, n)} agent=${n} label=${`Around agent ${n}`} />
  </li>`;
  return html`<p class="muted small">The true surroundings on the map, without what the agents remember.</p>
    <${Shown} items=${there} wrap=${(/** @type {number[]} */ shown) => html`<ul class="all-windows">${shown.map(one)}</ul>`} />`;
}
