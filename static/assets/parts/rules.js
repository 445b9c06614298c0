// Rules of competitions in words.

/** Tie breaks of equal totals. @type {[string, string][]} */
export const TIE_BREAKS = [
  ["invalid", "the smaller share of invalid answers"],
  ["timeouts", "the smaller share of moves that timed out"],
  ["attempts", "fewer attempts"],
  ["earliest", "the attempt that counts and ended earlier"],
];

/** Tie-breaks in their order. @param {string[]} rules */
export const tieBreaksText = (rules) => rules.map((rule) => TIE_BREAKS.find(([name]) => name === rule)?.[1] ?? rule).join(", then ");

/** The number of seeds of an attempt, and of public ones: 0 if all make one board. @param {any} competition */
export const seedsOf = ({ suite }) => ({ seeds: suite.seeds ?? 5, publicSeeds: suite.public_seeds ?? 0 });

/** The two sets of rules. @type {[string, string][]} */
export const RULES = [["paper", "those of the paper"], ["reference", "those of the public toolkit (“reference”)"]];

/** @param {string} rules */
export const rulesText = (rules) => RULES.find(([name]) => name === rules)?.[1] ?? rules;

/** Settings of games in a sentence; those left out have their defaults. @param {Record<string, any>} settings */
export function settingsText({ num_agents = 12, width = 10, height = 10, view_size = 5, memory = 5, max_round = 100, noise = 0, max_delay = 0, control }) {
  return [
    `${num_agents} agents on ${width} × ${height} cells, for ${max_round} rounds`,
    `each sees ${view_size} × ${view_size} cells and remembers ${memory} rounds`,
    noise > 0 && `a message is corrupted with the probability ${noise}`,
    max_delay > 0 && `messages are up to ${max_delay} rounds late`,
    control === "centralized" && "a commander sees everything and sends orders",
  ].filter(Boolean).join("; ");
}
