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
