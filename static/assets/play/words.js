// An observation in words. Only facts of an observation are used.
import { ACTIONS, letterOf } from "../parts/actions.js";
import { readCell } from "../parts/cell.js";

/** @import { Rules } from "../parts/cell.js" */

/** @typedef {{origin: {i: number, j: number}, cells: string[][]}} View */

/** The maximum number of things listed besides the four neighbours. */
const LISTED_MAX = 12;

/** The task and its rules, by which a window is read. @param {any} obs @param {any} config @returns {Rules} */
export const rulesOf = (obs, config) => ({ task: obs.task.name, rules: config?.rules });

/** The agent's cell in its view. @param {View} view */
function ownPlace(view) {
  const row = view.cells.findIndex((cells) => cells.includes("Y"));
  const column = view.cells[row]?.indexOf("Y");
  return row < 0 ? null : { row, column, i: view.origin.i + row, j: view.origin.j + column };
}

/** The surroundings: the four neighbours, then all else in sight, nearest first. @param {View} view @param {Rules} rules */
function surroundings(view, rules) {
  const own = ownPlace(view);
  if (!own) return "";
  const cells = view.cells.flatMap((row, i) => row.map((symbol, j) => ({ cell: readCell(symbol, rules), di: i - own.row, dj: j - own.column })));
  const at = (/** @type {number} */ i, /** @type {number} */ j) => cells.find(({ di, dj }) => di === i && dj === j)?.cell.name ?? "out of sight";
  const near = `Up: ${at(-1, 0)}. Down: ${at(1, 0)}. Left: ${at(0, -1)}. Right: ${at(0, 1)}.`;
  const distance = (/** @type {{di: number, dj: number}} */ { di, dj }) => Math.abs(di) + Math.abs(dj);
  const far = cells.filter((one) => distance(one) > 1 && !["empty", "outside", "wall"].includes(one.cell.kind)).sort((one, other) => distance(one) - distance(other));
  const listed = far.slice(0, LISTED_MAX).map(({ cell, di, dj }) => `${cell.name} ${way(di, dj)}`).join(", ");
  return `${near}${listed && ` Also in sight: ${listed}${far.length > LISTED_MAX ? `, and ${far.length - LISTED_MAX} more` : ""}.`}`;
}

/** @param {number} di @param {number} dj */
const way = (di, dj) => [di !== 0 && `${Math.abs(di)} ${di < 0 ? "up" : "down"}`, dj !== 0 && `${Math.abs(dj)} ${dj < 0 ? "left" : "right"}`].filter(Boolean).join(" ");

/** The result of the last action, as far as the agent can infer it from its cell. @param {any} obs */
export function outcome(obs) {
  const last = obs.history[0];
  if (!last || last.round !== obs.round - 1) return "";
  if (!last.action) return `You did nothing in round ${last.round}: no act came in time.`;
  const before = obs.past_views[0] && ownPlace(obs.past_views[0]);
  const by = ACTIONS[letterOf(last.action)]?.by;
  if (!before || !obs.position) return `You chose ${last.action}.`;
  const [di, dj] = [obs.position.i - before.i, obs.position.j - before.j];
  if (di === (by?.[0] ?? 0) && dj === (by?.[1] ?? 0)) return `You chose ${last.action}${by ? " and moved" : ""}.`;
  if (di === 0 && dj === 0) return `You chose ${last.action} and did not move: something was in the way.`;
  return `You chose ${last.action}, and were pushed ${way(di, dj)}.`;
}

/** A round for screen readers. @param {any} obs @param {any} config */
export function spoken(obs, config) {
  const heard = obs.messages.length;
  const parts = [`Round ${obs.round} of ${obs.max_round}. Score ${obs.score}.`, outcome(obs)];
  if (obs.view) parts.push(surroundings(obs.view, rulesOf(obs, config)));
  if (heard > 0) parts.push(`${heard} message${heard === 1 ? "" : "s"} heard.`);
  return parts.filter(Boolean).join(" ");
}
