// One game: its states in pages, its acts when they are shown, and news while it runs. The page of a game reads
// it only through the type `Game`, so that a game can also come from a file.
import { useEffect, useState } from "../ui.js";

/** @import { Worth } from "./worth.js" */

/**
 * @typedef {object} Head what does not change from round to round
 * @property {string} id
 * @property {string} task
 * @property {string} [rules]
 * @property {string} [control]
 * @property {string} status
 * @property {number} rounds how many rounds are resolved
 * @property {number} [max_round]
 * @property {number} score
 * @property {number} width
 * @property {number} height
 * @property {number} num_agents
 * @property {number} [view_size]
 * @property {string[]} ground
 * @property {[number, number][]} [block_cells]
 *
 * @typedef {object} State the world after `round` rounds, and what was decided in the round before
 * @property {number} round
 * @property {number} score
 * @property {number[]} at row and column of every agent
 * @property {number[]} [gone]
 * @property {number[]} [lit]
 * @property {number[]} [loaded]
 * @property {[number, number]} [prey]
 * @property {[number, number]} [block]
 * @property {number} [distance]
 * @property {string} [actions] a character for each agent
 * @property {number[]} [blocked]
 * @property {number[]} [pushed]
 * @property {number[]} [invalid]
 * @property {number[]} [timeouts]
 * @property {{from: number, text: string, to?: number}[]} [said]
 * @property {{from: number, by: number[], sent?: number, text?: string}[]} [heard]
 * @property {string[]} [marks]
 *
 * @typedef {{from: number, states: State[], metrics: Record<string, (number | null)[]>}} Piece states of one page
 * @typedef {{rounds: number, every: number, first?: number, scores: number[]}} Scores `first`: the round of the first one, if not 0
 *
 * @typedef {{round: number, rounds: {score: number, agents: {action: string | null, at: [number, number], alive: boolean}[]}[]}} Line
 *
 * @typedef {object} Game
 * @property {"episodes" | "imports" | "file"} kind
 * @property {Head} head
 * @property {any} summary what the lists say about it: model, run, configuration, result
 * @property {number} first the first round that can be shown
 * @property {number} last the last one, so far
 * @property {boolean} isLost whether the connection to a running game is interrupted
 * @property {Map<number, string[]>} marks what happened in a round, as far as it was read
 * @property {(round: number) => State | null} peek a state that was read
 * @property {(round: number) => Piece | null} piece the page with a state that was read
 * @property {(round: number) => Promise<State>} load
 * @property {(round: number, agent: number, signal?: AbortSignal) => Promise<any>} act
 * @property {() => Promise<Scores>} scores
 * @property {(seats: boolean, signal: AbortSignal) => Promise<Worth | null>} worth what could still be scored; with `seats` what each lost
 * @property {(round: number, signal: AbortSignal) => Promise<Line>} [line] how the reference would play on
 * @property {(listener: () => void) => () => void} subscribe calls back when something was read; returns what ends that
 * @property {(signal: AbortSignal) => Promise<void>} follow reads what is new until the game ends
 */

/** The pause at an unread round before it is read: scrubbing over many pages reads few of them. */
const REST_MS = 80;

const RUNNING = ["waiting", "running"];

/** Whether more rounds may come. @param {{status: string}} head */
export const isLive = (head) => RUNNING.includes(head.status);

/** Adds the marks of states, by the rounds that led to them. @param {Map<number, string[]>} marks @param {State[]} states */
export function collectMarks(marks, states) {
  for (const state of states) if (state.marks?.length) marks.set(state.round - 1, state.marks);
}

/** Redraws a component when more of a game was read. @param {Game | null} game */
export function useChanges(game) {
  const [count, setCount] = useState(0);
  useEffect(() => game?.subscribe(() => setCount((count) => count + 1)), [game]);
  return count;
}

/**
 * A state that is shown, and the one after it, which says what was decided. Until it is read, the state shown
 * before stays, or the first one: the round of the state says which it is.
 * @param {Game | null} game
 * @param {number} round
 * @returns {{state: State | null, next: State | null, problem: Error | null}}
 */
export function useMoment(game, round) {
  const [problem, setProblem] = useState(/** @type {Error | null} */ (null));
  const [shown, setShown] = useState(/** @type {State | null} */ (null));
  const count = useChanges(game);
  useEffect(() => {
    if (!game) return;
    let isCurrent = true;
    const last = Math.min(round + 1, game.last);
    const read = () =>
      Promise.all([game.load(round), game.load(last)]).then(
        ([state]) => {
          if (!isCurrent) return;
          setShown(state);
          setProblem(null);
        },
        (error) => isCurrent && setProblem(error),
      );
    const timer = setTimeout(read, game.peek(round) ? 0 : REST_MS);
    return () => {
      isCurrent = false;
      clearTimeout(timer);
    };
  }, [game, round, count]);
  const state = game?.peek(round) ?? shown ?? game?.peek(game.first) ?? null;
  return { state, next: state ? (game?.peek(state.round + 1) ?? null) : null, problem };
}
