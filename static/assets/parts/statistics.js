// Intervals of means, by the method that docs/evaluate/boards.md gives for differences of rows.

/** The quantile 0.9875 of the normal distribution. */
const Z = 2.2414027276;

/** The minimum size of a sample for an interval. */
const GAMES_MIN = 3;

/**
 * The quantile 0.9875 of Student's t: exact for two degrees of freedom, else by the expansion of Cornish and Fisher, to half
 * a percent.
 * @param {number} f degrees of freedom, at least 2
 */
export function studentQuantile(f) {
  if (f < 2.5) return 6.2053;
  const z2 = Z * Z;
  const terms = [
    (z2 + 1) / 4,
    ((5 * z2 + 16) * z2 + 3) / 96,
    (((3 * z2 + 19) * z2 + 17) * z2 - 15) / 384,
    ((((79 * z2 + 776) * z2 + 1482) * z2 - 1920) * z2 - 945) / 92_160,
  ];
  return Z * terms.reduce((sum, term, index) => sum + term / f ** (index + 1), 1);
}

/**
 * @typedef {{mean?: number | null, deviation?: number | null, games?: number | null}} Sample
 * `deviation` is that of the population
 */

/**
 * The mean of a task, or the sum of the means of several, with an interval of 95 %; null where a mean is missing. `low` and
 * `high` are null where a task has too few games.
 * @param {Sample[]} samples
 * @returns {{mean: number, low: number | null, high: number | null} | null}
 */
export function interval(samples) {
  let [mean, variance, freedom] = [0, 0, 0];
  let isKnown = samples.length > 0;
  for (const { mean: of, deviation, games } of samples) {
    if (of === null || of === undefined) return null;
    mean += of;
    if (typeof deviation !== "number" || !games || games < GAMES_MIN) {
      isKnown = false;
      continue;
    }
    const part = deviation ** 2 / (games - 1);
    variance += part;
    freedom += part ** 2 / (games - 1);
  }
  if (!isKnown) return { mean, low: null, high: null };
  const half = variance === 0 ? 0 : studentQuantile(variance ** 2 / freedom) * Math.sqrt(variance);
  return { mean, low: mean - half, high: mean + half };
}
