// Games of all kinds, by the routes that everybody uses.
import { dice } from "./dice.mjs";

/** @typedef {import("./program.mjs").Program} Program */

/**
 * A game of built-in players, played to its end.
 * @param {Program} program
 * @param {object} settings as in `POST /api/v1/episodes`
 * @returns {Promise<string>} its id
 */
export async function hosted(program, settings) {
  const { id } = await program.post("/api/v1/episodes", { player: "default", visibility: "public", ...settings });
  await ended(program, id);
  return id;
}

/** Waits until a game is over: its events end then. @param {Program} program @param {string} id */
export const ended = (program, id) => program.get(`/api/v1/episodes/${id}/events`, { text: true });

/**
 * Plays seats by the swarm token that holds them, until the game is over, or `rounds` are played.
 * @param {Program} program
 * @param {string} token
 * @param {(observation: any) => object | null} decide the fields of an act; null to let the clock run out
 * @param {number} [rounds]
 */
export async function play(program, token, decide, rounds = Infinity) {
  let cursor = "";
  for (;;) {
    const after = cursor && `&after=${encodeURIComponent(cursor)}`;
    const seen = await program.get(`/swarm/obs?wait=20&limit=1024${after}`, { token });
    if (seen.finished) return;
    cursor = seen.cursor;
    const open = seen.observations.filter(({ round }) => round < rounds);
    const acts = open.flatMap((observation) => {
      const act = decide(observation);
      const { episode, agent, round } = observation;
      return act ? [{ episode, agent, round, ...act }] : [];
    });
    await send(program, token, acts);
    if (seen.observations.length > 0 && open.length === 0) return;
  }
}

/** Problems of acts that come after their round. */
const LATE = ["round_over", "episode_over"];

/**
 * Sends acts, and repeats acts that came too fast: long ones have a rate limit.
 * @param {import("./program.mjs").Program} program
 * @param {string} token
 * @param {any[]} acts
 */
async function send(program, token, acts) {
  while (acts.length > 0) {
    const { receipts } = await program.post("/swarm/act", { acts }, { token });
    const problems = receipts.map((receipt, index) => ({ ...receipt, act: acts[index] })).filter(({ code }) => code);
    const fast = problems.filter(({ code }) => code === "rate_limited");
    const other = problems.find(({ code }) => code !== "rate_limited" && !LATE.includes(code));
    if (other) throw new Error(`${other.code}: ${other.detail}`);
    acts = fast.map(({ act }) => act);
    const pause = Math.max(0, ...fast.map(({ retry_after_ms: ms }) => ms));
    await new Promise((resolve) => setTimeout(resolve, pause));
  }
}

const SAYINGS = ["I go up", "prey at (3,4)", "close from the left", "wait for me", "all here"];

/**
 * Answers like a language model: with a text, reasons, and a cost. Some answers are invalid, and in some rounds nobody speaks,
 * or all say the same.
 * @param {number} seed
 */
export function talkative(seed) {
  const draw = dice(seed);
  return ({ actions, round, agent }) => {
    const action = actions[draw(actions.length)];
    const said = round % 7 === 5 ? "all here" : SAYINGS[draw(SAYINGS.length)];
    const message = round % 7 === 6 ? "" : `\nMSG: ${said}`;
    return {
      response: draw(30) === 0 ? "I cannot decide." : `I look around.\nACTION: ${action}${message}`,
      reasoning: `Round ${round}: ${agent} compares ${actions.length} actions and takes ${action}.`,
      usage: { prompt_tokens: 600 + draw(80), completion_tokens: 20 + draw(40), latency_ms: 300 + draw(900) },
    };
  };
}

/**
 * A game of players that answer like language models, played to its end, or for some rounds.
 * @param {Program} program
 * @param {object} settings
 * @param {{decide?: (observation: any) => object | null, rounds?: number}} [options]
 * @returns {Promise<{id: string, token: string}>}
 */
export async function spoken(program, settings, { decide = talkative(27), rounds } = {}) {
  const created = await program.post("/api/v1/episodes", { visibility: "public", ...settings });
  await play(program, created.swarm_token, decide, rounds);
  return { id: created.id, token: created.swarm_token };
}

/**
 * A run of a suite by built-in players, played to its end.
 * @param {Program} program
 * @param {object} request as in `POST /api/v1/runs`
 */
export async function run(program, request) {
  const { id } = await program.post("/api/v1/runs", { player: "default", visibility: "public", parallel: 8, ...request });
  await program.get(`/api/v1/runs/${id}/events`, { text: true });
  return id;
}

/**
 * A suite that is played fast.
 * @param {object} [settings]
 */
export const smallSuite = (settings = {}) => ({
  name: "small",
  tasks: ["Pursuit", "Foraging"],
  seeds: [27, 42, 57],
  settings: { num_agents: 6, max_round: 20, ...settings },
});

/** @typedef {(observation: any) => object | null} Act */

/**
 * A run whose players answer like language models, played to its end; a team plays by a token of each holder.
 * @param {Program} program
 * @param {object} request as in `POST /api/v1/runs`
 * @param {(holder: number, id: string) => Act | Promise<Act>} decides what each holder decides
 * @returns {Promise<{id: string, token: string}>}
 */
export async function spokenRun(program, request, decides) {
  const { id, swarm_token: token, holder_tokens: others } = await program.post("/api/v1/runs", { visibility: "public", parallel: 8, ...request });
  const tokens = token ? [token] : others.map((/** @type {{swarm_token: string}} */ { swarm_token }) => swarm_token);
  await Promise.all(tokens.map(async (/** @type {string} */ token, /** @type {number} */ holder) => play(program, token, await decides(holder, id))));
  return { id, token };
}

/**
 * The same acts with what an endpoint reports of its tokens, and with a cost in billionths of a dollar where one is given.
 * @param {(observation: any) => any} decide
 * @param {number | ((observation: any) => number | undefined)} [cost]
 */
export const priced = (decide, cost) => (/** @type {any} */ observation) => {
  const act = decide(observation);
  const own = typeof cost === "function" ? cost(observation) : cost;
  const usage = { ...act.usage, first_token_ms: 90, cached_tokens: 512, reasoning_tokens: 12, ...(own !== undefined && { cost_nano_usd: own }) };
  return { ...act, usage };
};

const HOUR_MS = 3_600_000;

/**
 * A competition that is open now.
 * @param {Program} program with keys
 * @param {object} [definition]
 */
export function competition(program, definition = {}) {
  const now = Date.now();
  return program.post("/api/v1/competitions", {
    name: "Spring cup",
    description: "Two tasks on layouts that nobody knows.",
    opens_at: new Date(now - HOUR_MS).toISOString(),
    closes_at: new Date(now + 24 * HOUR_MS).toISOString(),
    suite: { tasks: ["Pursuit", "Foraging"], seeds: 1, settings: { num_agents: 4, max_round: 10 } },
    clocks: { round_deadline_s: 60 },
    ...definition,
  });
}
