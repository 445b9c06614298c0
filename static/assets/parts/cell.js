// Symbols of a window, and what agents show besides their numbers: a light, or a load. States name lights and loads; in a window
// a mark stands for them, whose meaning depends on the rules.
import { visible } from "./text.js";

/** @import { Head, State } from "./game.js" */

/** @typedef {"on" | "off" | "food" | null} Sign a light, a load, or nothing */
/** @typedef {{task: string, rules?: string}} Rules */
/** @typedef {{kind: string, name: string, agent?: number, sign?: Sign}} Cell */

/** The signs of agents in tasks that have them: without and with what the task is about. @type {Record<string, [Sign, Sign]>} */
const SIGNS = { Synchronization: ["off", "on"], Foraging: [null, "food"] };

export const IN_WORDS = { on: "light on", off: "light off", food: "carries food" };

/** @type {Record<string, string>} */
const KINDS = { ".": "empty", "*": "outside", W: "wall", B: "block", P: "prey", N: "nest", F: "food", Y: "you" };

/** The sign of each agent in a state. @param {Head} head @param {State} state @returns {(agent: number) => Sign} */
export function signsIn(head, state) {
  const [without, withIt] = SIGNS[head.task] ?? [null, null];
  const listed = head.task === "Synchronization" ? state.lit : state.loaded;
  // A file of another program may not have recorded lights.
  if (!withIt || (!listed && head.status === "imported")) return () => null;
  const having = new Set(listed);
  return (agent) => (having.has(agent) ? withIt : without);
}

/** The sign of the agent that is asked, which its observation has in words. @param {any} observation @returns {Sign} */
export function ownSign({ light_on: isOn, carrying_food: isLoaded } = {}) {
  if (isOn !== undefined && isOn !== null) return isOn ? "on" : "off";
  return isLoaded ? "food" : null;
}

/** Whether the mark of a window means the opposite. @param {Rules} rules */
const isInverted = ({ rules }) => rules === "reference";

/** The symbol of an agent in a window. @param {Rules} rules @param {number} agent @param {Sign} sign */
export function symbolOf(rules, agent, sign) {
  const [without, withIt] = SIGNS[rules.task] ?? [];
  const isMarked = without !== undefined && sign === (isInverted(rules) ? without : withIt);
  return `${isMarked ? "$" : ""}${agent}`;
}

/** A cell of a window. @param {string} symbol @param {Rules} rules @returns {Cell} */
export function readCell(symbol, rules) {
  const kind = KINDS[symbol];
  if (kind) return { kind, name: kind };
  const number = /^(\$?)(\d+)$/.exec(symbol);
  if (!number) return { kind: "other", name: visible(symbol) };
  const sign = SIGNS[rules.task]?.[Number((number[1] === "$") !== isInverted(rules))] ?? null;
  const agent = Number(number[2]);
  return { kind: "agent", agent, sign, name: `agent ${agent}${sign ? ` (${IN_WORDS[sign]})` : ""}` };
}
