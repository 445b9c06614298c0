// Actions and their results in words.

/** @import { State } from "./game.js" */

/**
 * By the characters of a replay: the name, its key for a person at a seat with the sign of the key, and the step as rows and columns.
 * @type {Record<string, {name: string, keys?: string[], sign?: string, by?: [number, number]}>}
 */
export const ACTIONS = {
  U: { name: "UP", keys: ["ArrowUp"], sign: "↑", by: [-1, 0] },
  D: { name: "DOWN", keys: ["ArrowDown"], sign: "↓", by: [1, 0] },
  L: { name: "LEFT", keys: ["ArrowLeft"], sign: "←", by: [0, -1] },
  R: { name: "RIGHT", keys: ["ArrowRight"], sign: "→", by: [0, 1] },
  S: { name: "STAY", keys: ["s", "S"], sign: "S" },
  X: { name: "SWITCH", keys: ["l", "L", " "], sign: "L" },
  "-": { name: "none" },
};

/** The number of an agent. @param {{agent: string}} one what names it: an observation, a decision */
export const agentOf = ({ agent }) => Number(agent.replace("Agent_", ""));

/** The letter of an action by its name, empty for another. @param {string | null} [name] */
export const letterOf = (name) => Object.keys(ACTIONS).find((letter) => ACTIONS[letter].name === name) ?? "";

/** The choice of an agent in the round that led to a state. @param {State | null} next @param {number} agent */
export const actionOf = (next, agent) => (next?.actions ? (ACTIONS[next.actions[agent]] ?? null) : null);

/** The result of an agent's choice, in words. @param {State | null} next @param {number} agent */
export function resultOf(next, agent) {
  /** @type {[number[] | undefined, string][]} */
  const lists = [[next?.timeouts, "out of time"], [next?.invalid, "invalid answer"], [next?.blocked, "blocked"], [next?.pushed, "pushed"]];
  return next?.actions ? lists.flatMap(([agents, words]) => (agents?.includes(agent) ? [words] : [])).join(", ") : "";
}

/** What an agent said in the round that led to a state. @param {State | null} next @param {number} agent */
export const saidBy = (next, agent) => next?.said?.find(({ from }) => from === agent)?.text ?? "";

/** Agents whose answer was invalid or late in the round that led to a state, and those that spoke. @param {State | null} next */
export const voicesIn = (next) => ({
  silent: new Set([...(next?.invalid ?? []), ...(next?.timeouts ?? [])]),
  speaking: new Set(next?.said?.map(({ from }) => from)),
});
