// Two games in step: their differences in a round, and the round where they part.
import { actionOf } from "../parts/actions.js";
import { openGame } from "../parts/game.js";

/** @typedef {import("../parts/game.js").Game} Game */
/** @typedef {import("../parts/game.js").State} State */
/** @typedef {import("../parts/game.js").Head} Head */

/** The number of rounds between two reports of a search. */
const REPORT_ROUNDS = 50;

/** Parses a game in an address, a link or an input. @param {string} text */
export function readId(text) {
  const found = /(?:ep|imp)_[0-9a-zA-Z]+/.exec(text);
  return found?.[0] ?? text.trim();
}

/** @param {string} id @param {AbortSignal} signal */
export const openById = (id, signal) => openGame({ kind: kindOf(id), id }, signal);

/** @param {string} id @returns {"imports" | "episodes"} */
const kindOf = (id) => (id.startsWith("imp_") ? "imports" : "episodes");

/** The page of a game. @param {string} id */
export const pageOf = (id) => `/${kindOf(id)}/${encodeURIComponent(id)}`;

/** Both games as one for the playback, as long as the longer one. */
export class Pair {
  first = 0;

  /** @param {Game} a @param {Game} b */
  constructor(a, b) {
    this.a = a;
    this.b = b;
  }

  get last() {
    return Math.max(this.a.last, this.b.last);
  }

  /** The last round of both games. */
  get common() {
    return Math.min(this.a.last, this.b.last);
  }

  /** @param {number} round */
  async load(round) {
    const [a] = await Promise.all([this.a, this.b].map((game) => game.load(Math.min(round, game.last))));
    return a;
  }

  /** @param {number} round */
  isRead(round) {
    return [this.a, this.b].every((game) => game.peek(Math.min(round, game.last)));
  }
}

/**
 * The reason why agents and places of two games cannot be compared, or an empty text.
 * @param {Head} a
 * @param {Head} b
 */
export function obstacle(a, b) {
  if (a.task !== b.task) return "They are of different tasks";
  if (a.width !== b.width || a.height !== b.height) return "Their maps are of different sizes";
  if (a.num_agents !== b.num_agents) return "They have different numbers of agents";
  return "";
}

/** @param {number[] | undefined} list @param {number} agent */
const has = (list, agent) => Boolean(list?.includes(agent));

/** @param {State | null} next @param {number} agent */
export const saidBy = (next, agent) => next?.said?.find(({ from }) => from === agent)?.text ?? "";

/**
 * The differences of an agent: its place and its decision.
 * @param {{state: State, next: State | null}} a
 * @param {{state: State, next: State | null}} b
 * @param {number} agent
 */
export function agentDiffers(a, b, agent) {
  const [one, other] = [a.state, b.state];
  const isGone = has(one.gone, agent);
  const place =
    isGone !== has(other.gone, agent) ||
    (!isGone && (one.at[2 * agent] !== other.at[2 * agent] || one.at[2 * agent + 1] !== other.at[2 * agent + 1])) ||
    has(one.lit, agent) !== has(other.lit, agent) ||
    has(one.loaded, agent) !== has(other.loaded, agent);
  // A game that has ended has no decisions.
  const both = Boolean(a.next && b.next);
  const action = both && actionOf(a.next, agent)?.name !== actionOf(b.next, agent)?.name;
  const message = both && saidBy(a.next, agent) !== saidBy(b.next, agent);
  return { place, action, message, any: place || action || message };
}

/** @param {[number, number] | undefined} a @param {[number, number] | undefined} b */
const elsewhere = (a, b) => String(a) !== String(b);

/**
 * All differences in a round; `isPlaced` if it is more than decisions and messages.
 * @param {Head} head
 * @param {{state: State, next: State | null}} a
 * @param {{state: State, next: State | null}} b
 */
export function differences(head, a, b) {
  const agents = new Map();
  for (let agent = 0; agent < head.num_agents; agent++) {
    const differs = agentDiffers(a, b, agent);
    if (differs.any) agents.set(agent, differs);
  }
  const things = [];
  if (elsewhere(a.state.prey, b.state.prey)) things.push("the prey");
  if (elsewhere(a.state.block, b.state.block)) things.push("the block");
  if (a.state.score !== b.state.score) things.push("the score");
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
