// The observation of an agent, drawn and in words. Only facts of an observation are used.
import { html } from "../ui.js";
import { visible } from "../parts/text.js";
import { AgentWindow } from "../parts/window.js";

/** @typedef {{origin: {i: number, j: number}, cells: string[][]}} View */
/** @typedef {{kind: string, name: string, marked?: boolean}} Cell */

const KINDS = {
  ".": "empty",
  "*": "outside",
  W: "wall",
  B: "block",
  P: "prey",
  N: "nest",
  F: "food",
  Y: "you",
};

/** The maximum number of things listed besides the four neighbours. */
const LISTED_MAX = 12;

/** A step of each direction as rows and columns. @type {Record<string, [number, number]>} */
const STEPS = { UP: [-1, 0], DOWN: [1, 0], LEFT: [0, -1], RIGHT: [0, 1] };

/** @param {string} symbol @returns {Cell} */
export function readCell(symbol) {
  const kind = KINDS[/** @type {keyof typeof KINDS} */ (symbol)];
  if (kind) return { kind, name: kind };
  const marked = symbol.startsWith("$");
  const agent = Number(marked ? symbol.slice(1) : symbol);
  if (!Number.isInteger(agent)) return { kind: "other", name: visible(symbol) };
  return { kind: "agent", name: `agent ${agent}`, marked };
}

/**
 * The meaning of an agent's mark.
 * @param {string} task
 * @param {string} [rules]
 */
export function meaningOfMark(task, rules = "paper") {
  const isInverted = rules === "reference";
  if (task === "Synchronization") return isInverted ? "light off" : "light on";
  if (task === "Foraging") return isInverted ? "carries nothing" : "carries food";
  return "";
}

/** @param {Cell} cell @param {string} mark */
const inWords = (cell, mark) => (cell.marked && mark ? `${cell.name} (${mark})` : cell.name);

/** The agent's cell in its view. @param {View} view */
export function ownPlace(view) {
  for (const [row, cells] of view.cells.entries()) {
    const column = cells.indexOf("Y");
    if (column >= 0) return { row, column, i: view.origin.i + row, j: view.origin.j + column };
  }
  return null;
}

/**
 * A view, with the chosen action on the agent's own cell.
 * @param {{view: View, agent: string, label: string, isMarked?: boolean, action?: string | null, sign?: string}} props
 */
export function Sight({ view, agent, label, isMarked, action, sign }) {
  const own = ownPlace(view);
  // Between the agent's cell and its destination.
  const [di, dj] = (action && STEPS[action]) || [0, 0];
  const middle = (/** @type {number} */ index, /** @type {number} */ count) => `${(index / count) * 100}%`;
  const place = own && {
    top: middle(own.row + 0.5 + di / 2, view.cells.length),
    left: middle(own.column + 0.5 + dj / 2, view.cells[0].length),
  };
  return html`<div class="sight">
    <${AgentWindow} cells=${view.cells} agent=${numberOf(agent)} label=${label} isMarked=${isMarked} />
    ${sign && place && html`<span class="sign" aria-hidden="true" style=${place}>${sign}</span>`}
  </div>`;
}

/** @param {string} agent */
export const numberOf = (agent) => Number(agent.replace("Agent_", ""));

/**
 * The surroundings in words: the four neighbours, then all else in sight, nearest first.
 * @param {View} view
 * @param {string} mark
 */
export function surroundings(view, mark) {
  const own = ownPlace(view);
  if (!own) return "";
  const at = (/** @type {number} */ di, /** @type {number} */ dj) => {
    const symbol = view.cells[own.row + di]?.[own.column + dj];
    return symbol === undefined ? "out of sight" : inWords(readCell(symbol), mark);
  };
  const near = `Up: ${at(-1, 0)}. Down: ${at(1, 0)}. Left: ${at(0, -1)}. Right: ${at(0, 1)}.`;
  const far = others(view, own, mark);
  return far ? `${near} Also in sight: ${far}.` : near;
}

/** @param {View} view @param {{row: number, column: number}} own @param {string} mark */
function others(view, own, mark) {
  const found = [];
  for (const [row, cells] of view.cells.entries()) {
    for (const [column, symbol] of cells.entries()) {
      const cell = readCell(symbol);
      const [di, dj] = [row - own.row, column - own.column];
      const distance = Math.abs(di) + Math.abs(dj);
      if (distance < 2 || ["empty", "outside", "wall"].includes(cell.kind)) continue;
      found.push({ distance, text: `${inWords(cell, mark)} ${way(di, dj)}` });
    }
  }
  found.sort((a, b) => a.distance - b.distance);
  const more = found.length > LISTED_MAX ? `, and ${found.length - LISTED_MAX} more` : "";
  return found.slice(0, LISTED_MAX).map(({ text }) => text).join(", ") + more;
}

/** @param {number} di @param {number} dj */
function way(di, dj) {
  const steps = [];
  if (di !== 0) steps.push(`${Math.abs(di)} ${di < 0 ? "up" : "down"}`);
  if (dj !== 0) steps.push(`${Math.abs(dj)} ${dj < 0 ? "left" : "right"}`);
  return steps.join(" ");
}

/**
 * The result of the last action, as far as the agent can infer it from its cell.
 * @param {any} obs
 */
export function outcome(obs) {
  const last = obs.history[0];
  if (!last || last.round !== obs.round - 1) return "";
  if (!last.action) return `You did nothing in round ${last.round}: no act came in time.`;
  const before = obs.past_views[0] && ownPlace(obs.past_views[0]);
  const step = STEPS[last.action] ?? [0, 0];
  if (!before || !obs.position) return `You chose ${last.action}.`;
  const moved = [obs.position.i - before.i, obs.position.j - before.j];
  const asChosen = moved[0] === step[0] && moved[1] === step[1];
  if (asChosen) return `You chose ${last.action}${STEPS[last.action] ? " and moved" : ""}.`;
  if (moved[0] === 0 && moved[1] === 0) return `You chose ${last.action} and did not move: something was in the way.`;
  return `You chose ${last.action}, and were pushed ${way(moved[0], moved[1])}.`;
}
