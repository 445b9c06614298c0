// Small facts of games and players in words.

/** @type {Record<string, string>} */
const REASONS = {
  task_done: "the task was done",
  rounds_played: "all rounds were played",
  aborted: "its creator or an organizer ended it",
  idle: "nobody acted for too long",
  closed: "its competition closed",
};

/** @param {string | null | undefined} reason */
export const reasonText = (reason) => (reason ? (REASONS[reason] ?? reason) : "");

/** @param {number} count */
export const roundsText = (count) => (count === 1 ? "1 round" : `${count} rounds`);

/** The game of a run that is played in the place of a voided one. @param {{episode: string, slot: number}} game @param {any[]} games of the run */
export const nextOf = ({ episode, slot }, games) => {
  const inPlace = games.filter((other) => other.slot === slot);
  return inPlace[inPlace.findIndex((other) => other.episode === episode) + 1];
};

/** Declared sampling in words, empty without any. @param {{temperature?: number | null, top_p?: number | null, sampling?: string | null}} player */
export const samplingText = ({ temperature = null, top_p = null, sampling = null }) =>
  [temperature !== null && `temperature ${temperature}`, top_p !== null && `top p ${top_p}`, sampling].filter(Boolean).join(", ");
