// Actions and their results in words.

/** @import { State } from "./game.js" */

/** By the characters of a replay. @type {Record<string, {name: string, arrow: string, by?: [number, number]}>} */
export const ACTIONS = {
  U: { name: "UP", arrow: "↑", by: [-1, 0] },
  D: { name: "DOWN", arrow: "↓", by: [1, 0] },
  L: { name: "LEFT", arrow: "←", by: [0, -1] },
  R: { name: "RIGHT", arrow: "→", by: [0, 1] },
  S: { name: "STAY", arrow: "·" },
  X: { name: "SWITCH", arrow: "⇄" },
  "-": { name: "none", arrow: "–" },
};

/**
 * The choice of an agent in the round that led to a state.
 * @param {State | null} next
 * @param {number} agent
 */
export const actionOf = (next, agent) => (next?.actions ? (ACTIONS[next.actions[agent]] ?? null) : null);

/**
 * The result of an agent's choice, in words.
 * @param {State | null} next
 * @param {number} agent
 */
export function resultOf(next, agent) {
  if (!next?.actions) return "";
  const said = [];
  if (next.timeouts?.includes(agent)) said.push("out of time");
  if (next.invalid?.includes(agent)) said.push("invalid answer");
  if (next.blocked?.includes(agent)) said.push("blocked");
  if (next.pushed?.includes(agent)) said.push("pushed");
  return said.join(", ");
}
