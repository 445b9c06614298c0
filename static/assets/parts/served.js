// A game of the server, read in pages.
import { Problem, request, route, sleep, stream, tokenOf, withQuery } from "../api.js";
import { collectMarks, join } from "./pieces.js";

/** @import { Game, Head, Piece, State } from "./game.js" */

/** The number of rounds per request. The server sends fewer of large games. */
const PAGE_ROUNDS = 100;

/** The maximum number of cached pages; the oldest one is evicted. */
const PAGES_MAX = 24;

/** The maximum number of cached acts. */
const ACTS_MAX = 64;

/** The number of points of the score curve. */
const SCORE_POINTS = 400;

/** The number of rounds that the reference plays on. */
const LINE_ROUNDS = 10;

/** The interval between reads of a running game. */
const LIVE_PAUSE_MS = 500;

/** The interval between reads of a game that waits for its players. */
const WAITING_MS = 5000;

/** The pause after a failed read of a running game. */
const RETRY_MS = 2000;

/** A game whose players are visible to the reader, but not its rounds. */
export class HiddenGame extends Error {
  /** @param {any} summary */
  constructor(summary) {
    super("what happens in this game can be read after its end");
    this.summary = summary;
  }
}

/** @implements {Game} */
export class ServedGame {
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
    const [summary, page] = await Promise.all([
      this.get("", signal),
      this.get(this.#address(0, true), signal).catch((error) => error),
    ]);
    if (page instanceof Problem && page.status === 403) throw new HiddenGame(summary);
    if (page instanceof Error) throw page;
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
      // The first page stays: every visitor begins there.
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

  /**
   * @param {number} round
   * @param {number} agent
   * @param {AbortSignal} [signal]
   */
  async act(round, agent, signal) {
    // The newest round changes until it is resolved.
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

  /** @param {boolean} seats @param {AbortSignal} signal */
  worth(seats, signal) {
    return this.get(withQuery("/worth", { seats }), signal);
  }

  /** @param {number} round @param {AbortSignal} signal */
  line(round, signal) {
    return this.get(withQuery("/line", { round, rounds: LINE_ROUNDS }), signal);
  }

  /** @param {AbortSignal} signal */
  async follow(signal) {
    const own = new AbortController();
    try {
      await this.#follow(AbortSignal.any([signal, own.signal]));
    } finally {
      own.abort();
    }
  }

  /** @param {AbortSignal} signal */
  async #follow(signal) {
    let known = this.head.rounds;
    let isOver = false;
    let problem = null;
    stream(withQuery(`${this.base}/events`, { after: known }), {
      signal,
      token: this.token,
      onEvent: ({ event, data }) => {
        if (event === "round") known = Math.max(known, data.round);
        return event === "finished";
      },
      onState: (state) => this.#setLost(state === "lost"),
    })
      .catch((error) => (problem = error))
      .finally(() => (isOver = true));

    let readAt = Date.now();
    while (!signal.aborted && !(isOver && known <= this.head.rounds)) {
      if (problem) throw problem;
      if (known > this.head.rounds) await this.#catchUp(known, signal);
      if (this.head.status === "waiting" && Date.now() - readAt > WAITING_MS) {
        await this.#readSummary(signal);
        readAt = Date.now();
      }
      await sleep(LIVE_PAUSE_MS, signal);
    }
    if (signal.aborted) return;
    if (problem) throw problem;
    await this.#readSummary(signal);
  }

  /** @param {AbortSignal} signal */
  async #readSummary(signal) {
    this.summary = await this.#persist(() => this.get("", signal), signal);
    this.head = { ...this.head, status: this.summary.status, score: this.summary.score };
    this.changed();
  }

  /** Reads the newest states. @param {number} known @param {AbortSignal} signal */
  async #catchUp(known, signal) {
    const at = this.head.rounds;
    const from = this.piece(at) && known - at <= this.pageRounds ? at : this.#start(known);
    const page = await this.#persist(() => this.get(this.#address(from, false), signal), signal);
    this.#setHead(page);
    this.#add(page);
  }

  /**
   * Retries while the server does not answer or is busy; throws refusals.
   * @param {() => Promise<any>} read
   * @param {AbortSignal} signal
   */
  async #persist(read, signal) {
    for (;;) {
      try {
        const answer = await read();
        this.#setLost(false);
        return answer;
      } catch (error) {
        const isRefused = error instanceof Problem && error.status >= 400 && error.status < 500 && error.status !== 429;
        if (isRefused || signal.aborted) throw error;
        this.#setLost(true);
        await sleep(RETRY_MS, signal);
      }
    }
  }

  /** @param {boolean} isLost */
  #setLost(isLost) {
    if (this.isLost === isLost) return;
    this.isLost = isLost;
    this.changed();
  }
}
