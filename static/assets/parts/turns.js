// Server-Sent Events, read for a turn: while others wait for a connection, a stream is left after a moment and resumed later.
import { persist, send, sleep } from "../api.js";

/** The duration of a turn once the server answers. What was missed meanwhile comes at once when a stream begins. */
const TURN_MS = 500;

/** The maximum duration of a turn in which it does not. */
const UNANSWERED_MS = 10_000;

/** The pauses before a stream that ended early is opened again: it grows while no event comes. */
const [FIRST_PAUSE_MS, LONGEST_PAUSE_MS] = [500, 15_000];

/** The maximum length of an unfinished event; a longer one ends the stream. */
const EVENT_CHARS_MAX = 16_000_000;

/**
 * @typedef {{path: string, token: string | null, lastId: string}} Topic events of a path, as a token may read them, after one of them
 *
 * @typedef {object} Handlers
 * @property {AbortSignal} signal
 * @property {(event: {event: string, id: string, data: any}) => void} onEvent a joined stream begins with its newest event
 * @property {(state: "open" | "lost") => void} onState
 */

/**
 * Reads events until the last one, the signal aborts, or the turn is over and must end. Returns whether it was the last one; throws
 * refusals. An EventSource could not send a token.
 * @param {Topic} topic `lastId` is kept up to date
 * @param {Handlers & {mustEnd: () => boolean}} handlers
 */
export async function turn(topic, { signal: outer, mustEnd, onEvent, onState }) {
  const own = new AbortController();
  const signal = AbortSignal.any([outer, own.signal]);
  let endsAt = Date.now() + UNANSWERED_MS;
  const timer = setInterval(() => Date.now() >= endsAt && mustEnd() && own.abort(), TURN_MS / 5);
  let pause = FIRST_PAUSE_MS;
  const read = async () => {
    /** @type {Record<string, string>} */
    const headers = topic.lastId ? { "Last-Event-ID": topic.lastId } : {};
    const response = await send(topic.path, { signal, headers, token: topic.token });
    endsAt = Date.now() + TURN_MS;
    onState("open");
    for await (const event of events(response)) {
      pause = FIRST_PAUSE_MS;
      if (event.id) topic.lastId = event.id;
      onEvent(event);
      if (event.event === "finished") return true;
    }
    return false;
  };
  try {
    for (; ; pause = Math.min(pause * 2, LONGEST_PAUSE_MS)) {
      if (await persist(read, { signal, onLost: (isLost) => isLost && onState("lost") })) return true;
      await sleep(pause, signal);
    }
  } catch (error) {
    if (signal.aborted) return false;
    throw error;
  } finally {
    clearInterval(timer);
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
    if (text.length > EVENT_CHARS_MAX) return void (await reader.cancel());
  }
}
