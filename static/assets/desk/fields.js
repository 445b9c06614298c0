// Fields that several forms of the desk share.
import { TASKS } from "../parts/tasks.js";

/** @typedef {import("../parts/form.js").Field} Field */

/** The maximum length of a competition's terms. */
export const TERMS_CHARS_MAX = 20_000;

/** @type {[string, string][]} */
export const TASK_OPTIONS = TASKS.map((task) => [task, task]);

/** @type {[string, string][]} */
export const RULES = [["paper", "paper"], ["reference", "reference"]];

/** @type {[string, string, string, number, number, (number | string)?][]} name, label, what counts where it is empty, limits, step */
const NUMBERS = [
  ["num_agents", "Agents", "12", 1, 1024],
  ["width", "Columns of the map", "10", 8, 256],
  ["height", "Rows of the map", "10", 8, 256],
  ["view_size", "Rows and columns of an agent's window, odd", "5", 3, 513],
  ["memory", "Rounds that an agent remembers", "5", 0, 50],
  ["max_round", "Rounds", "100", 1, 100_000],
  ["noise", "Probability that a message is corrupted", "0", 0, 1, "any"],
  ["max_delay", "Most rounds that a message is late", "0", 0, 100],
];

/** Settings of games. @param {string} prefix @returns {Field[]} */
export const settingsFields = (prefix) => [
  {
    name: `${prefix}control`,
    label: "Control",
    kind: "choice",
    options: [["", "decentralized"], ["centralized", "centralized: a commander sees all and sends orders"]],
  },
  ...NUMBERS.map(([name, label, placeholder, min, max, step]) => ({
    name: `${prefix}${name}`,
    label,
    kind: /** @type {const} */ ("number"),
    placeholder,
    min,
    max,
    step,
  })),
];

/** Clocks of games. @param {string} prefix @param {boolean} isRequired @returns {Field[]} */
export const clockFields = (prefix, isRequired) => [
  {
    name: `${prefix}round_deadline_s`,
    label: "Clock of a round, in seconds",
    kind: "number",
    isRequired,
    min: 0.05,
    max: 86_400,
    step: "any",
    placeholder: isRequired ? "" : "none",
    help: isRequired ? "It ends the rounds that are open when the competition closes." : "An agent that does not answer in time does nothing in that round.",
  },
  { name: `${prefix}bank_s`, label: "Bank of a seat in a game, in seconds", kind: "number", min: 0, max: 604_800, step: "any", placeholder: "0", help: "What a seat may overspend in all rounds together." },
  { name: `${prefix}idle_timeout_s`, label: "A game is abandoned after, in seconds", kind: "number", min: 1, max: 31_536_000, step: "any", placeholder: "86400", help: "The time without any act." },
];
