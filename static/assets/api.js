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

/**
 * @param {string} name
 * @param {string | null} value null to forget
 */
export function remember(name, value) {
  try {
    if (value === null) sessionStorage.removeItem(PREFIX + name);
    else sessionStorage.setItem(PREFIX + name, value);
  } catch {
    if (value === null) memory.delete(name);
    else memory.set(name, value);
  }
  for (const listener of listeners) listener(name);
}

/** @type {Set<(name: string) => void>} */
const listeners = new Set();

/**
 * Calls back when a stored value changes. Returns a function that stops this.
 * @param {(name: string) => void} listener
 */
export function onRemembered(listener) {
  listeners.add(listener);
  return () => void listeners.delete(listener);
}

/** Pages that other sites show in a frame send no tokens. */
const isEmbedded = location.pathname.startsWith("/embed/");

/** The key of this tab, if one was entered. */
export const key = () => (isEmbedded ? null : remembered("key"));

/**
 * The token for a game: the game's own, or the key.
 * @param {string} [id]
 */
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

/**
 * Sends a request. Throws a Problem unless it succeeds.
 * @param {string} path
 * @param {Options} [options]
 * @returns {Promise<Response>}
 */
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

/**
 * Sends a request and reads its answer as JSON.
 * @param {string} path
 * @param {Options} [options]
 * @returns {Promise<any>}
 */
export async function request(path, options) {
  const response = await send(path, options);
  return response.status === 204 ? null : response.json();
}

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

const FIRST_PAUSE_MS = 500;
const LONGEST_PAUSE_MS = 15_000;

/** The maximum length of an unfinished event; a longer one ends the stream. */
const EVENT_CHARS_MAX = 16_000_000;

/**
 * Reads Server-Sent Events until `signal` aborts, or `onEvent` returns true. A lost connection is resumed after the last
 * event. An EventSource could not send a token.
 * @param {string} path
 * @param {object} options
 * @param {(event: {event: string, id: string, data: any}) => boolean | void} options.onEvent
 * @param {(state: "open" | "lost", problem?: Problem) => void} [options.onState]
 * @param {AbortSignal} options.signal
 * @param {string | null} [options.token]
 * @param {string} [options.lastId]
 */
export async function stream(path, { onEvent, onState, signal, token, lastId = "" }) {
  let pause = FIRST_PAUSE_MS;
  while (!signal.aborted) {
    try {
      /** @type {Record<string, string>} */
      const headers = lastId ? { "Last-Event-ID": lastId } : {};
      const response = await send(path, { signal, headers, ...(token === undefined ? {} : { token }) });
      onState?.("open");
      for await (const event of events(response)) {
        pause = FIRST_PAUSE_MS;
        if (event.id) lastId = event.id;
        if (onEvent(event)) return;
      }
    } catch (error) {
      if (signal.aborted) return;
      const problem = error instanceof Problem ? error : new Problem(0, { detail: "The connection broke off." });
      // A retry would get the same answer.
      if (problem.status >= 400 && problem.status < 500 && problem.status !== 429) throw problem;
      onState?.("lost", problem);
    }
    await sleep(pause, signal);
    pause = Math.min(pause * 2, LONGEST_PAUSE_MS);
  }
}

/** @param {Response} response */
async function* events(response) {
  const reader = response.body?.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  while (reader) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    for (let end = text.indexOf("\n\n"); end >= 0; end = text.indexOf("\n\n")) {
      const event = { event: "message", id: "", data: "" };
      for (const line of text.slice(0, end).split("\n")) {
        const colon = line.indexOf(":");
        const [name, field] = [line.slice(0, colon), line.slice(colon + 1).replace(/^ /, "")];
        if (name === "event" || name === "id") event[name] = field;
        if (name === "data") event.data += field;
      }
      text = text.slice(end + 2);
      if (event.data) yield { ...event, data: JSON.parse(event.data) };
    }
    if (text.length > EVENT_CHARS_MAX) {
      await reader.cancel();
      return;
    }
  }
}

/**
 * @param {number} ms
 * @param {AbortSignal} [signal]
 * @returns {Promise<void>}
 */
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
