// A seat as its holder's browser plays it: observations and acts. A seat token has one agent; a swarm token has
// several, of one game or of all games of a run, which are played in turn.
import { useEffect, useRef, useState } from "../ui.js";
import { Problem, persist, request, sleep, withQuery } from "../api.js";

/** The maximum time that the server may hold a request back. */
const WAIT_S = 25;
/** The interval between looks at a game that has not started. */
const START_MS = 2000;
/** The interval between checks for games that others ended, while a person decides for one of several seats. */
const LOOK_MS = 5000;
/** After the end of a clock the server needs a moment to open the next round. */
const CLOCK_GRACE_MS = 300;

/**
 * @typedef {object} Seat
 * @property {any} obs the observation that is shown; null before the first
 * @property {number} seenAt when it came, for clocks (`performance.now()`)
 * @property {"loading" | "waiting" | "choose" | "sending" | "sent" | "over" | "failed"} phase
 * @property {any} receipt of the last act; that of an earlier round stays until the next
 * @property {boolean} isLost whether the server did not answer lately
 * @property {Problem | null} problem why the last act was not taken, or why all is over
 */

/** @type {Seat} */
const EMPTY = { obs: null, seenAt: 0, phase: "loading", receipt: null, isLost: false, problem: null };

const ENDED = ["finished", "aborted", "abandoned"];

/** @param {string} token */
export const hasManySeats = (token) => token.startsWith("swarm_");

/** Plays with a token while the page is open. @param {string} token @returns {Seat & {act: (choice: Choice) => void}} */
export function useSeat(token) {
  const [seat, setSeat] = useState(EMPTY);
  const session = useRef(/** @type {Session | null} */ (null));
  useEffect(() => {
    const aborted = new AbortController();
    session.current = new Session(token, aborted.signal, setSeat);
    session.current.play();
    return () => aborted.abort();
  }, [token]);
  return { ...seat, act: (choice) => void session.current?.act(choice) };
}

/** @typedef {{action: string, message?: string, to?: string}} Choice */

class Session {
  /** @param {string} token @param {AbortSignal} signal @param {(seat: Seat) => void} onChange */
  constructor(token, signal, onChange) {
    this.token = token;
    this.signal = signal;
    this.onChange = onChange;
    this.seat = EMPTY;
    this.look = hasManySeats(token) ? () => this.lookAtSwarm() : () => this.lookAtSeat();
    this.resume = () => {};
  }

  /** @param {Partial<Seat>} change */
  set(change) {
    if (this.signal.aborted) return;
    this.seat = { ...this.seat, ...change };
    this.onChange(this.seat);
  }

  /** Polls until all games are over. */
  async play() {
    try {
      while (this.seat.phase !== "over") await this.persist(this.look);
    } catch (problem) {
      this.set({ phase: "failed", problem: /** @type {Problem} */ (problem) });
    }
  }

  /** @template T @param {() => Promise<T>} ask @param {() => boolean} [goesOn] */
  persist(ask, goesOn) {
    return persist(ask, { signal: this.signal, goesOn, onLost: (isLost) => isLost !== this.seat.isLost && this.set({ isLost }) });
  }

  show(obs) {
    const phase = phaseOf(obs);
    const isSame = sameRound(obs, this.seat.obs);
    // An act under way decides the next step itself.
    if (isSame && this.seat.phase === "sending") return;
    this.set({ obs, seenAt: performance.now(), phase, ...(isSame ? {} : { problem: null }) });
  }

  async lookAtSeat() {
    const { obs, isLost } = this.seat;
    // After a lost connection the clock is read at once.
    const query = obs?.status === "running" && !isLost ? { after: obs.round, wait: WAIT_S } : {};
    const seen = await this.ask(withQuery("/obs", query));
    this.show(seen);
    if (seen.status === "waiting") await sleep(START_MS, this.signal);
  }

  async lookAtSwarm() {
    const answer = await this.ask(withQuery("/swarm/obs", { limit: 1, wait: this.seat.obs ? WAIT_S : START_MS / 1000 }));
    const [obs] = answer.observations;
    if (answer.finished) return this.set({ phase: "over" });
    if (!obs) return this.set({ phase: this.seat.obs ? "sent" : "waiting" });
    this.show(obs);
    await this.acted(obs);
  }

  /** Until this seat has acted, its clock is over, or it is time to see whether the game was ended. @param {any} obs */
  async acted(obs) {
    const over = new AbortController();
    this.resume = () => over.abort();
    await sleep(Math.min(LOOK_MS, (obs.remaining_ms ?? LOOK_MS) + CLOCK_GRACE_MS), AbortSignal.any([over.signal, this.signal]));
  }

  /** @param {string} path @param {object} [body] of a post */
  ask(path, body) {
    return request(path, { method: body && "POST", body, token: this.token, signal: this.signal });
  }

  /** Sends an act, and repeats it until there is an answer. @param {Choice} choice */
  async act(choice) {
    const { obs, phase } = this.seat;
    if (phase !== "choose") return;
    this.set({ phase: "sending", problem: null });
    try {
      const receipt = await this.persist(() => this.send(obs, choice), () => sameRound(obs, this.seat.obs));
      // The next round may arrive before the receipt.
      if (receipt) this.set({ receipt, phase: sameRound(obs, this.seat.obs) ? "sent" : this.seat.phase });
      this.resume();
    } catch (problem) {
      this.refused(obs, /** @type {Problem} */ (problem));
    }
  }

  /** @param {any} obs @param {Choice} choice */
  async send(obs, choice) {
    const act = { round: obs.round, ...choice };
    if (!hasManySeats(this.token)) return this.ask("/act", act);
    const [receipt] = (await this.ask("/swarm/act", { acts: [{ episode: obs.episode, agent: obs.agent, ...act }] })).receipts;
    if (receipt.code) throw new Problem(receipt.status, receipt);
    return receipt;
  }

  /** @param {any} obs @param {Problem} problem */
  refused(obs, problem) {
    if (problem.status === 401) return this.set({ phase: "failed", problem });
    const isAnswered = problem.code === "already_acted";
    if (sameRound(obs, this.seat.obs)) this.set({ problem, phase: isAnswered ? "sent" : "choose" });
    this.resume();
  }
}

function phaseOf(obs) {
  if (ENDED.includes(obs.status)) return "over";
  if (obs.status === "waiting") return "waiting";
  return obs.acted || !obs.alive ? "sent" : "choose";
}

export const sameRound = (a, b) => a && b && a.episode === b.episode && a.agent === b.agent && a.round === b.round;
