// Events of rounds, as marks on the curve and as destinations.
import { isLive } from "../parts/game.js";
import { useLoaded } from "../parts/load.js";
import { reasonText, roundsText } from "../parts/words.js";

/** @import { Game } from "../parts/game.js" */

/** @type {Record<string, {sign: string, name: string, kind: "good" | "bad" | "talk"}>} */
export const MARKS = {
  points: { sign: "▲", name: "the score rose", kind: "good" },
  drop: { sign: "▼", name: "the score fell", kind: "bad" },
  invalid: { sign: "!", name: "invalid answer", kind: "bad" },
  timeout: { sign: "◷", name: "out of time", kind: "bad" },
  silence: { sign: "○", name: "nobody spoke any more", kind: "talk" },
  convergence: { sign: "≡", name: "all said the same", kind: "talk" },
};

/** The maximum numbers of pages read to find the next mark, and only for their marks. */
const [SEARCHED_MAX, READ_MAX] = [20, 10];

/** @param {Game} game */
const pageRounds = (game) => Math.max((game.piece(game.first)?.states.length ?? 2) - 1, 1);

/** Whether a game is short enough to read all its marks. @param {Game} game */
export const isShort = (game) => (game.last - game.first) / pageRounds(game) <= READ_MAX;

/** Reads all marks of a short game. @param {Game} game */
export const useAllMarks = (game) =>
  useLoaded(async (signal) => {
    for (let round = game.first; isShort(game) && !signal.aborted && round <= game.last; round += pageRounds(game)) await game.load(round);
  }, [game]);

/** Whether there is a mark after a round or before it, as far as it is known. @param {Game} game @param {number} round @param {1 | -1} direction */
export const hasMark = (game, round, direction) => !isShort(game) || [...game.marks.keys()].some((at) => (at - round) * direction > 0);

/** Marks as words. @param {string[] | undefined} marks */
export const inWords = (marks) => (marks ?? []).map((mark) => MARKS[mark]?.name ?? mark).join(", ");

/**
 * The next or previous round with a mark, or null; reads pages on the way.
 * @param {Game} game
 * @param {number} round
 * @param {1 | -1} direction
 * @returns {Promise<number | null>}
 */
export async function findMark(game, round, direction) {
  let at = round + direction;
  for (let read = 0; at >= game.first && at < game.last; at += direction) {
    if (game.marks.has(at)) return at;
    // The marks of a round come with the state after it.
    if (game.peek(at + 1)) continue;
    if (read++ === SEARCHED_MAX) return null;
    await game.load(at + 1);
    if (game.marks.has(at)) return at;
  }
  return null;
}

/** The status of a game, in a sentence. @param {{head: {status: string, rounds: number}, summary: any}} game */
export function standing({ head, summary }) {
  // A file may have only a part of the rounds.
  const count = summary?.result?.rounds ?? head.rounds;
  const rounds = roundsText(count);
  if (head.status === "waiting") return "It has not started.";
  if (isLive(head)) return `It is running: ${rounds} so far.`;
  return `It ended after ${rounds}${summary?.result?.reason ? `: ${reasonText(summary.result.reason)}` : ""}.`;
}
