// One game: its states in pages, its acts when they are looked at, and what is new while it runs. The page of a game reads
// it through the type `Game` alone, so that a game can also come from a file.
import { useEffect, useState } from "../ui.js";
import { request, route, sleep, stream, tokenOf, withQuery } from "../api.js";

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
 * @property {(listener: () => void) => () => void} subscribe calls back when something was read; returns what ends that
 * @property {(signal: AbortSignal) => Promise<void>} follow reads what is new until the game ends
 */

/** Rounds that are asked for at once. The server sends fewer of large games. */
const PAGE_ROUNDS = 100;

/** Pages that are kept; the oldest one is forgotten for another. */
const PAGES_MAX = 24;

/** Acts that are kept. */
const ACTS_MAX = 64;

/** Points of the curve of scores. */
const SCORE_POINTS = 400;

/** Between two readings of a running game. */
const LIVE_PAUSE_MS = 500;

/** After a reading of a running game that failed. */
const RETRY_MS = 2000;

/** For how long one has to stay at a round that was not read: scrubbing over many pages reads few of them. */
const REST_MS = 80;

const RUNNING = ["waiting", "running"];

/** Whether more rounds may come. @param {Head} head */
export const isLive = (head) => RUNNING.includes(head.status);

/**
 * Marks of a state, by the round that led to it.
 * @param {Map<number, string[]>} marks
 * @param {State[]} states
 */
export function collectMarks(marks, states) {
  for (const state of states) if (state.marks?.length) marks.set(state.round - 1, state.marks);
}

/** @implements {Game} */
class ServerGame {
  /**
   * @param {"episodes" | "imports"} kind
   * @param {string} id
   */
  constructor(kind, id) {
    this.kind = kind;
    this.id = id;
    this.base = kind === "imports" ? route`/api/v1/imports/${id}` : route`/api/v1/episodes/${id}`;
    this.token = tokenOf(id);
    this.head = /** @type {Head} */ (/** @type {unknown} */ (null));
    this.summary = /** @type {any} */ (null);
    this.first = 0;
    this.isLost = false;
    this.marks = new Map();
    /** @type {Piece[]} the one used last is the last */
    this.pages = [];
    this.pageRounds = PAGE_ROUNDS;
    /** @type {Map<number, Promise<State>>} */
    this.loading = new Map();
    this.acts = new Map();
    /** @type {Set<() => void>} */
    this.listeners = new Set();
  }

  get last() {
    return this.head.rounds;
  }

  /** @param {string} path @param {AbortSignal} [signal] */
  get(path, signal) {
    return request(this.base + path, { token: this.token, signal });
  }

  /** @param {AbortSignal} signal */
  async open(signal) {
    const [summary, page] = await Promise.all([this.get("", signal), this.get(this.#address(0, true), signal)]);
    this.summary = summary;
    this.#setHead(page);
    this.#add(page);
    return this;
  }

  /** @param {number} from @param {boolean} ground */
  #address(from, ground) {
    return withQuery("/replay", { from, rounds: this.pageRounds, ground });
  }

  /** @param {any} page */
  #setHead(page) {
    const { states: _, metrics: __, from: ___, length: ____, next: _____, ...head } = page;
    this.head = { ...this.head, ...head, id: this.id };
  }

  /** @param {any} page */
  #add({ from, states, metrics = {}, next }) {
    if (next !== null && next !== undefined && next > from) this.pageRounds = next - from;
    collectMarks(this.marks, states);
    const before = this.pages.find((piece) => piece.from < from && piece.from + piece.states.length > from);
    if (before && from + states.length - before.from <= PAGE_ROUNDS + 1) {
      join(before, { from, states, metrics });
    } else {
      this.pages = this.pages.filter((piece) => piece.from !== from);
      this.pages.push({ from, states, metrics });
      // The first page stays: it is where everybody begins.
      if (this.pages.length > PAGES_MAX) this.pages.splice(1, 1);
    }
    this.changed();
  }

  changed() {
    for (const listener of this.listeners) listener();
  }

  /** @param {() => void} listener */
  subscribe(listener) {
    this.listeners.add(listener);
    return () => void this.listeners.delete(listener);
  }

  /** @param {number} round */
  piece(round) {
    return this.pages.find((piece) => round >= piece.from && round < piece.from + piece.states.length) ?? null;
  }

  /** @param {number} round */
  peek(round) {
    const piece = this.piece(round);
    return piece ? piece.states[round - piece.from] : null;
  }

  /**
   * The state of a round; the next page is read ahead.
   * @param {number} round
   */
  async load(round) {
    const state = this.peek(round) ?? (await this.#read(round));
    const ahead = Math.min(round + Math.ceil(this.pageRounds / 2), this.head.rounds);
    if (!this.peek(ahead)) this.#read(ahead).catch(() => {});
    return state;
  }

  /** @param {number} round @returns {Promise<State>} */
  #read(round) {
    const from = this.#start(round);
    const pending = this.loading.get(from);
    if (pending) return pending.then(() => this.peek(round) ?? this.#read(round));
    const asked = this.pageRounds;
    const reading = this.get(this.#address(from, false)).then((page) => {
      this.#setHead(page);
      this.#add(page);
      const state = this.peek(round);
      if (state) return state;
      // The server sent fewer rounds than were asked for: pages begin elsewhere.
      if (this.pageRounds < asked) return this.#read(round);
      throw new Error(`round ${round} is not in the answer`);
    });
    const done = reading.finally(() => this.loading.delete(from));
    this.loading.set(from, done);
    return done;
  }

  /** Where the page begins that has a round: at a page's border, or at the newest state before it. @param {number} round */
  #start(round) {
    const border = Math.floor(round / this.pageRounds) * this.pageRounds;
    const piece = this.piece(border);
    return piece ? piece.from + piece.states.length - 1 : border;
  }

  /**
   * @param {number} round
   * @param {number} agent
   * @param {AbortSignal} [signal]
   */
  async act(round, agent, signal) {
    // The newest round changes while it is decided.
    const isOpen = round >= this.head.rounds;
    const name = `${round}/${agent}`;
    const known = this.acts.get(name);
    if (known) return known;
    const act = await this.get(route`/rounds/${round}/agents/${`Agent_${agent}`}`, signal);
    if (!isOpen) this.acts.set(name, act);
    if (this.acts.size > ACTS_MAX) this.acts.delete(this.acts.keys().next().value);
    return act;
  }

  scores() {
    return this.get(withQuery("/scores", { points: SCORE_POINTS }));
  }

  /** @param {AbortSignal} signal */
  async follow(signal) {
    let known = this.head.rounds;
    let isOver = false;
    const events = stream(withQuery(`${this.base}/events`, { after: known }), {
      signal,
      token: this.token,
      onEvent: ({ event, data }) => {
        if (event === "round") known = Math.max(known, data.round);
        isOver = event === "finished";
        return isOver;
      },
      onState: (state) => {
        if (this.isLost === (state === "lost")) return;
        this.isLost = state === "lost";
        this.changed();
      },
    });
    let problem = null;
    events.catch((error) => (problem = error)).finally(() => (isOver = true));
    while (!signal.aborted) {
      const ended = isOver;
      if (known > this.head.rounds) await this.#catchUp(known);
      if (ended) break;
      await sleep(LIVE_PAUSE_MS, signal);
    }
    if (signal.aborted) return;
    if (problem) throw problem;
    this.summary = await this.get("", signal);
    await this.#catchUp(this.head.rounds);
    this.head = { ...this.head, status: this.summary.status, score: this.summary.score };
    this.changed();
  }

  /** Reads the newest states; what fails is read with the next round. @param {number} known */
  async #catchUp(known) {
    const at = this.head.rounds;
    const from = this.piece(at) && known - at <= this.pageRounds ? at : this.#start(known);
    try {
      const page = await this.get(this.#address(from, false));
      this.isLost = false;
      this.#setHead(page);
      this.#add(page);
    } catch {
      this.isLost = true;
      this.changed();
      await sleep(RETRY_MS);
    }
  }
}

/** Adds later states to a page that overlaps with them. @param {Piece} piece @param {Piece} later */
function join(piece, later) {
  const kept = later.from - piece.from;
  piece.states = [...piece.states.slice(0, kept), ...later.states];
  for (const name of new Set([...Object.keys(piece.metrics), ...Object.keys(later.metrics)])) {
    const before = piece.metrics[name] ?? Array(kept).fill(null);
    const after = later.metrics[name] ?? Array(later.states.length).fill(null);
    piece.metrics[name] = [...before.slice(0, kept), ...after];
  }
}

/**
 * A game of the server, with its first states.
 * @param {{kind: "episodes" | "imports", id: string}} which
 * @param {AbortSignal} signal
 * @returns {Promise<Game>}
 */
export const openGame = ({ kind, id }, signal) => new ServerGame(kind, id).open(signal);

/**
 * Draws a component again when more of a game was read.
 * @param {Game | null} game
 */
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
