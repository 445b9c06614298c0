// A game of the server, read in pages.
import { Problem, persist, request, route, sleep, tokenOf, withQuery } from "../api.js";
import { collectMarks } from "./game.js";

/** @import { Game, Head, Piece, State } from "./game.js" */

/** The number of rounds per request. The server sends fewer of large games. */
const PAGE_ROUNDS = 100;

/** The maximum numbers of cached pages and acts; the oldest one is evicted. */
const [PAGES_MAX, ACTS_MAX] = [24, 64];

/** The numbers of points of the score curve, and of rounds that the reference plays on. */
const [SCORE_POINTS, LINE_ROUNDS] = [400, 10];

/** The intervals between looks at a running game, and at one that waits for its players. */
const [LIVE_MS, WAITING_MS] = [500, 5000];

/** A game whose players are visible to the reader, but not its rounds. */
export class HiddenGame extends Error {
  constructor(summary) {
    super("what happens in this game can be read after its end");
    this.summary = summary;
  }
}

/**
 * A game of the server, with its first states.
 * @param {string} id which says whether the game was imported
 * @param {AbortSignal} signal
 * @returns {Promise<Game>}
 */
export const openGame = (id, signal) => new ServedGame(id).open(signal);

/** @param {string} id @returns {"imports" | "episodes"} */
const kindOf = (id) => (id.startsWith("imp_") ? "imports" : "episodes");

/** The page of a game. @param {string} id */
export const pageOf = (id) => `/${kindOf(id)}/${encodeURIComponent(id)}`;

/** @implements {Game} */
class ServedGame {
  /** @param {string} id */
  constructor(id) {
    this.kind = kindOf(id);
    this.id = id;
    this.base = `/api/v1${pageOf(id)}`;
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
    const [summary, page] = await Promise.all([
      this.get("", signal),
      this.get(this.#address(0, true), signal).catch((error) => error),
    ]);
    if (page instanceof Problem && page.status === 403) throw new HiddenGame(summary);
    if (page instanceof Error) throw page;
    this.summary = summary;
    this.#add(page);
    return this;
  }

  /** @param {number} from @param {boolean} ground */
  #address(from, ground) {
    return withQuery("/replay", { from, rounds: this.pageRounds, ground });
  }

  /** Adds a page of the replay, also to one with which it overlaps. @param {any} page */
  #add({ from, states, metrics = {}, next, length: _, ...head }) {
    this.head = { ...this.head, ...head, id: this.id };
    if (next !== null && next !== undefined && next > from) this.pageRounds = next - from;
    collectMarks(this.marks, states);
    const before = this.pages.find((piece) => piece.from < from && piece.from + piece.states.length > from);
    if (before && from + states.length - before.from <= PAGE_ROUNDS + 1) {
      join(before, { from, states, metrics });
    } else {
      this.pages = this.pages.filter((piece) => piece.from !== from);
      this.pages.push({ from, states, metrics });
      // The first page stays: every visitor begins there.
      if (this.pages.length > PAGES_MAX) this.pages.splice(1, 1);
    }
    this.#changed();
  }

  #changed() {
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

  /** The state of a round; the next page is read ahead. @param {number} round */
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
      this.#add(page);
      const state = this.peek(round);
      if (state) return state;
      // The server sent fewer rounds than requested: pages begin elsewhere.
      if (this.pageRounds < asked) return this.#read(round);
      throw new Error(`round ${round} is not in the answer`);
    });
    const done = reading.finally(() => this.loading.delete(from));
    this.loading.set(from, done);
    return done;
  }

  /** The first state of the page with a round: at a page's border, or the newest state before it. @param {number} round */
  #start(round) {
    const border = Math.floor(round / this.pageRounds) * this.pageRounds;
    const piece = this.piece(border);
    return piece ? piece.from + piece.states.length - 1 : border;
  }

  /** @param {number} round @param {number} agent @param {AbortSignal} [signal] */
  async act(round, agent, signal) {
    const name = `${round}/${agent}`;
    const known = this.acts.get(name);
    if (known) return known;
    const act = await this.get(route`/rounds/${round}/agents/${`Agent_${agent}`}`, signal);
    // The newest round changes until it is resolved.
    if (round < this.head.rounds) this.acts.set(name, act);
    if (this.acts.size > ACTS_MAX) this.acts.delete(this.acts.keys().next().value);
    return act;
  }

  scores() {
    return this.get(withQuery("/scores", { points: SCORE_POINTS }));
  }

  /** @param {boolean} seats @param {AbortSignal} signal */
  worth(seats, signal) {
    return this.get(withQuery("/worth", { seats }), signal);
  }

  /** @param {number} round @param {AbortSignal} signal */
  line(round, signal) {
    return this.get(withQuery("/line", { round, rounds: LINE_ROUNDS }), signal);
  }

  /** Reads what is new, and the end of the game. @param {AbortSignal} outer */
  async follow(outer) {
    // Most games are over when they are watched.
    const { follow } = await import("./events.js");
    const own = new AbortController();
    const signal = AbortSignal.any([outer, own.signal]);
    let known = this.head.rounds;
    let isOver = false;
    let problem = null;
    follow({ path: `${this.base}/events`, token: this.token, lastId: String(known) }, {
      signal,
      onEvent: ({ event, data }) => {
        if (event === "round") known = Math.max(known, data.round);
      },
      onState: (state) => this.#setLost(state === "lost"),
    })
      .catch((error) => (problem = error))
      .finally(() => (isOver = true));
    try {
      for (let readAt = Date.now(); !(isOver && known <= this.head.rounds); await sleep(LIVE_MS, signal)) {
        signal.throwIfAborted();
        if (problem) throw problem;
        if (known > this.head.rounds) await this.#catchUp(known, signal);
        if (this.head.status === "waiting" && Date.now() - readAt > WAITING_MS) {
          await this.#readSummary(signal);
          readAt = Date.now();
        }
      }
      if (problem) throw problem;
      await this.#readSummary(signal);
    } finally {
      own.abort();
    }
  }

  /** @param {AbortSignal} signal */
  async #readSummary(signal) {
    this.summary = await this.#persist("", signal);
    this.head = { ...this.head, status: this.summary.status, score: this.summary.score };
    this.#changed();
  }

  /** Reads the newest states. @param {number} known @param {AbortSignal} signal */
  async #catchUp(known, signal) {
    const at = this.head.rounds;
    const from = this.piece(at) && known - at <= this.pageRounds ? at : this.#start(known);
    this.#add(await this.#persist(this.#address(from, false), signal));
  }

  /** @param {string} path @param {AbortSignal} signal */
  #persist(path, signal) {
    return persist(() => this.get(path, signal), { signal, onLost: (isLost) => this.#setLost(isLost) });
  }

  /** @param {boolean} isLost */
  #setLost(isLost) {
    if (this.isLost === isLost) return;
    this.isLost = isLost;
    this.#changed();
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
