// Two games in step: their differences in a round, and the round where they part.
import { actionOf, saidBy } from "../parts/actions.js";

/** @import { Game, Head, State } from "../parts/game.js" */
/** @typedef {{state: State, next: State | null}} Moment */

/** The number of rounds between two reports of a search. */
const REPORT_ROUNDS = 50;

/** Parses a game in an address, a link or an input. @param {string} text */
export function readId(text) {
  const found = /(?:ep|imp)_[0-9a-zA-Z]+/.exec(text);
  return found?.[0] ?? text.trim();
}

/** Two games as one for the playback, as long as the longer one. @param {Game} a @param {Game} b */
export const pairOf = (a, b) => ({
  a,
  b,
  get last() {
    return Math.max(a.last, b.last);
  },
  /** The last round of both games. */
  get common() {
    return Math.min(a.last, b.last);
  },
  load: (/** @type {number} */ round) => Promise.all([a, b].map((game) => game.load(Math.min(round, game.last)))),
});

/** @typedef {ReturnType<typeof pairOf>} Pair */

/** The reason why agents and places of two games cannot be compared, or an empty text. @param {Head} a @param {Head} b */
export function obstacle(a, b) {
  if (a.task !== b.task) return "They are of different tasks";
  if (a.width !== b.width || a.height !== b.height) return "Their maps are of different sizes";
  if (a.num_agents !== b.num_agents) return "They have different numbers of agents";
  return "";
}

/** An agent's place, light and load. @param {State} state @param {number} agent */
const placeOf = ({ at, gone, lit, loaded }, agent) =>
  gone?.includes(agent) ? "gone" : `${at[2 * agent]} ${at[2 * agent + 1]} ${Boolean(lit?.includes(agent))} ${Boolean(loaded?.includes(agent))}`;

/** The differences of an agent: its place and its decision. @param {Moment} a @param {Moment} b @param {number} agent */
function agentDiffers(a, b, agent) {
  const place = placeOf(a.state, agent) !== placeOf(b.state, agent);
  // A game that has ended has no decisions.
  const both = Boolean(a.next && b.next);
  const action = both && actionOf(a.next, agent)?.name !== actionOf(b.next, agent)?.name;
  const message = both && saidBy(a.next, agent) !== saidBy(b.next, agent);
  return { place, action, message, any: place || action || message };
}

/** All differences in a round; `isPlaced` if it is more than decisions and messages. @param {Head} head @param {Moment} a @param {Moment} b */
export function differences(head, a, b) {
  const agents = new Map();
  for (let agent = 0; agent < head.num_agents; agent++) {
    const differs = agentDiffers(a, b, agent);
    if (differs.any) agents.set(agent, differs);
  }
  const things = /** @type {const} */ (["prey", "block", "score"]).filter((name) => String(a.state[name]) !== String(b.state[name])).map((name) => `the ${name}`);
  const isPlaced = things.length > 0 || [...agents.values()].some(({ place }) => place);
  return { agents, things, isPlaced, any: agents.size > 0 || isPlaced };
}

/** @param {Game} game @param {number} round */
async function moment(game, round) {
  const state = await game.load(round);
  return { state, next: round < game.last ? await game.load(round + 1) : null };
}

/**
 * The next round of both games in which something differs, or null.
 * @param {Pair} pair
 * @param {number} from the first round that is looked at
 * @param {1 | -1} step
 * @param {AbortSignal} signal
 * @param {{onRound?: (round: number) => void, onlyPlaces?: boolean}} [options] `onRound` gets the round that is looked at, now
 *   and then; with `onlyPlaces` what is decided and said does not count
 */
export async function findDifference(pair, from, step, signal, { onRound, onlyPlaces = false } = {}) {
  for (let round = from; round >= 0 && round <= pair.common && !signal.aborted; round += step) {
    if (round % REPORT_ROUNDS === 0) onRound?.(round);
    const [a, b] = await Promise.all([moment(pair.a, round), moment(pair.b, round)]);
    if (round === 0 && !sameGround(pair)) return 0;
    const found = differences(pair.a.head, a, b);
    if (onlyPlaces ? found.isPlaced : found.any) return round;
  }
  return null;
}

/** @param {Pair} pair */
export const sameGround = ({ a, b }) => a.head.ground.join("\n") === b.head.ground.join("\n");
