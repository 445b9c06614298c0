// A game whose rounds are all at hand: of a file, or packed with the pages.
import { collectMarks } from "./game.js";

/** @import { Game, Scores, State } from "./game.js" */
/** @import { Worth } from "./worth.js" */

/**
 * @typedef {object} Content
 * @property {any} head the answer of a replay without its states
 * @property {State[]} states
 * @property {Record<string, any>} [acts] by round and agent: "37/5"
 * @property {Scores} [scores]
 * @property {Worth} [worth] of the whole game
 * @property {any} summary
 */

/** @implements {Game} */
export class PackedGame {
  /** @param {Content} content */
  constructor({ head, states, acts = {}, scores, worth, summary }) {
    this.kind = /** @type {const} */ ("file");
    this.head = { ...head, id: head.id ?? head.episode ?? "game" };
    this.summary = { ...summary, config: summary.config ?? {} };
    this.states = states;
    this.acts = acts;
    this.curve = scores;
    this.appraisal = worth ?? null;
    this.first = states[0].round;
    this.last = states[states.length - 1].round;
    this.isLost = false;
    this.marks = new Map();
    collectMarks(this.marks, states.slice(1));
    this.all = { from: this.first, states, metrics: head.metrics ?? {} };
  }

  /** @param {number} round */
  peek(round) {
    return this.states[round - this.first] ?? null;
  }

  /** @param {number} round */
  piece(round) {
    return this.peek(round) && this.all;
  }

  /** @param {number} round */
  async load(round) {
    const state = this.peek(round);
    if (!state) throw new Error(`Round ${round} is not in this file.`);
    return state;
  }

  /** @param {number} round @param {number} agent */
  async act(round, agent) {
    return this.acts[`${round}/${agent}`] ?? { isMissing: true };
  }

  async scores() {
    const scores = this.states.map((state) => state.score);
    // The curve of the whole game is useless if the file has only a part.
    return this.curve && this.states.length > this.head.rounds ? { ...this.curve, rounds: this.last } : { rounds: this.last, every: 1, first: this.first, scores };
  }

  async worth() {
    return this.appraisal;
  }

  subscribe() {
    return () => {};
  }

  async follow() {}
}
