// Requests to the server. Keys and tokens are kept for one tab, and sent in one header only.

/** An unsuccessful answer, or no answer. */
export class Problem extends Error {
  /**
   * @param {number} status the status of the answer; 0 where none came
   * @param {{code?: string, detail?: string, round?: number, retry_after_ms?: number,
   *   fields?: {field: string, problem: string}[], limit?: {name: string, value: number}}} body
   */
  constructor(status, body) {
    super(body.detail ?? `the server answered ${status}`);
    this.status = status;
    this.code = body.code ?? (status === 0 ? "offline" : "unknown");
    this.detail = this.message;
    this.round = body.round;
    this.fields = body.fields ?? [];
    this.limit = body.limit;
    this.retryAfterMs = body.retry_after_ms;
  }
}

const PREFIX = "swarmbench:";

/** The storage of a tab until it is closed; only memory if the browser has no storage. */
const memory = new Map();

/** @param {string} name */
export function remembered(name) {
  try {
    return sessionStorage.getItem(PREFIX + name);
  } catch {
    return memory.get(name) ?? null;
  }
}

/** @param {string} name @param {string | null} value null to forget */
export function remember(name, value) {
  try {
    if (value === null) sessionStorage.removeItem(PREFIX + name);
    else sessionStorage.setItem(PREFIX + name, value);
  } catch {
    memory.set(name, value);
  }
  for (const listener of listeners) listener(name);
}

/** @type {Set<(name: string) => void>} */
const listeners = new Set();

/** Calls back when a stored value changes. Returns a function that stops this. @param {(name: string) => void} listener */
export function onRemembered(listener) {
  listeners.add(listener);
  return () => void listeners.delete(listener);
}

/** Pages that other sites show in a frame send no tokens. */
const isEmbedded = location.pathname.startsWith("/embed/");

/** The key of this tab, if one was entered. */
export const key = () => (isEmbedded ? null : remembered("key"));

/** The token for a game: the game's own, or the key. @param {string} [id] */
export const tokenOf = (id) => (isEmbedded ? null : ((id && remembered(`token:${id}`)) ?? key()));

/**
 * @typedef {object} Options
 * @property {string} [method]
 * @property {unknown} [body] sent as JSON
 * @property {string | null} [token] in the place of the tab's key; null for none
 * @property {AbortSignal} [signal]
 * @property {string} [idempotencyKey]
 * @property {Record<string, string>} [headers]
 */

/** Sends a request. Throws a Problem unless it succeeds. @param {string} path @param {Options} [options] @returns {Promise<Response>} */
export async function send(path, options = {}) {
  const { method = "GET", body, token = key(), signal, idempotencyKey, headers = {} } = options;
  const sent = new Headers(headers);
  if (token) sent.set("Authorization", `Bearer ${token}`);
  if (body !== undefined) sent.set("Content-Type", "application/json");
  if (idempotencyKey) sent.set("Idempotency-Key", idempotencyKey);
  let response;
  try {
    response = await fetch(path, {
      method,
      headers: sent,
      body: body === undefined ? undefined : JSON.stringify(body),
      signal,
      cache: "no-store",
      credentials: "omit",
    });
  } catch (error) {
    if (signal?.aborted) throw error;
    throw new Problem(0, { detail: "The server does not answer." });
  }
  if (response.ok) return response;
  throw new Problem(response.status, await response.json().catch(() => ({})));
}

/** Sends a request and reads its answer as JSON. @param {string} path @param {Options} [options] @returns {Promise<any>} */
export async function request(path, options) {
  const response = await send(path, options);
  return response.status === 204 ? null : response.json();
}

/** A random text, so that a repeated request does not do its work twice. */
export const onceKey = () => [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");

/**
 * The path of a route with its values escaped: route`/api/v1/runs/${id}`.
 * @param {TemplateStringsArray} parts
 * @param {...(string | number)} values
 */
export const route = (parts, ...values) =>
  String.raw({ raw: parts }, ...values.map((value) => encodeURIComponent(value)));

/**
 * Adds a query to a path, without undefined, null and empty values.
 * @param {string} path
 * @param {Record<string, string | number | boolean | null | undefined>} query
 */
export function withQuery(path, query) {
  const given = Object.entries(query).filter(([, value]) => value !== undefined && value !== null && value !== "");
  if (given.length === 0) return path;
  return `${path}?${new URLSearchParams(given.map(([name, value]) => [name, String(value)]))}`;
}

const [FIRST_PAUSE_MS, LONGEST_PAUSE_MS] = [500, 8_000];

/**
 * Repeats a request while the server does not answer or is busy; throws what it refuses. Null if it need not go on.
 * @template T
 * @param {() => Promise<T>} ask
 * @param {{signal: AbortSignal, onLost: (isLost: boolean) => void, goesOn?: () => boolean}} options
 * @returns {Promise<T | null>}
 */
export async function persist(ask, { signal, onLost, goesOn = () => true }) {
  for (let pause = FIRST_PAUSE_MS; goesOn(); pause = Math.min(pause * 2, LONGEST_PAUSE_MS)) {
    signal.throwIfAborted();
    try {
      const answer = await ask();
      onLost(false);
      return answer;
    } catch (error) {
      signal.throwIfAborted();
      // An answer that broke off is no answer.
      const problem = error instanceof Problem ? error : new Problem(0, { detail: String(error) });
      if (problem.status >= 400 && problem.status < 500 && problem.status !== 429) throw problem;
      onLost(true);
      await sleep(Math.max(pause, problem.retryAfterMs ?? 0), signal);
    }
  }
  return null;
}

/** @param {number} ms @param {AbortSignal} [signal] @returns {Promise<void>} */
export const sleep = (ms, signal) =>
  new Promise((resolve) => {
    if (signal?.aborted) return resolve();
    const done = () => {
      clearTimeout(timer);
      signal?.removeEventListener("abort", done);
      resolve();
    };
    const timer = setTimeout(done, ms);
    signal?.addEventListener("abort", done);
  });
