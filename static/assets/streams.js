// The event streams of all tabs of a browser, in a shared worker. Over HTTP/1.1 a browser has six connections to a server, and
// each stream holds one: tabs that follow the same events share a stream, and more streams than a few take turns.
import { turn } from "./parts/turns.js";

/** The maximum number of streams that are open at once. */
const OPEN_MAX = 3;

/** Readers that are not heard of for so long are gone: browsers wake a hidden tab once a minute. */
const SILENT_MS = 200_000;

/**
 * @typedef {object} Stream
 * @property {import("./parts/turns.js").Topic} topic
 * @property {Map<MessagePort, number>} readers with the time at which each was heard of
 * @property {any} newest the last event
 * @property {"open" | "lost"} state
 * @property {AbortController | null} open
 */

/** @type {Map<string, Stream>} by token and path, those that wait for their turn in order */
const streams = new Map();

/** @param {Stream} stream @param {object} message */
function tell(stream, message) {
  for (const port of stream.readers.keys()) port.postMessage(message);
}

/** Opens streams while there is room. */
function arrange() {
  let count = [...streams.values()].filter(({ open }) => open).length;
  for (const [name, stream] of streams) {
    if (stream.open) continue;
    if (count++ >= OPEN_MAX) return;
    void read(name, stream);
  }
}

/** Reads a stream until its end, or until its turn is over because others wait. @param {string} name @param {Stream} stream */
async function read(name, stream) {
  stream.open = new AbortController();
  const reading = turn(stream.topic, {
    signal: stream.open.signal,
    mustEnd: () => streams.size > OPEN_MAX,
    onEvent: (event) => tell(stream, { event: (stream.newest = event) }),
    onState: (state) => tell(stream, { state: (stream.state = state) }),
  });
  const { isOver, problem } = await reading.then((isOver) => ({ isOver, problem: null }), (problem) => ({ isOver: true, problem: { ...problem } }));
  stream.open = null;
  // A stream without readers was taken out, and another one may have its name.
  if (streams.get(name) === stream) {
    streams.delete(name);
    if (isOver) tell(stream, { isOver, problem });
    else streams.set(name, stream);
  }
  arrange();
}

/** @param {MessagePort} port @param {import("./parts/turns.js").Topic} topic */
function join(port, topic) {
  const name = `${topic.token ?? ""} ${topic.path}`;
  const stream = streams.get(name) ?? { topic, readers: new Map(), newest: null, state: "open", open: null };
  const isNew = !stream.readers.has(port);
  streams.set(name, stream);
  stream.readers.set(port, Date.now());
  if (isNew && stream.newest) port.postMessage({ event: stream.newest });
  if (isNew && stream.state === "lost") port.postMessage({ state: "lost" });
  arrange();
}

/** @param {MessagePort} port */
function leave(port) {
  for (const [name, { readers, open }] of streams) {
    if (!readers.delete(port) || readers.size > 0) continue;
    streams.delete(name);
    open?.abort();
  }
  arrange();
}

/** A port follows the topic that it sends, now and then as a sign of life, or leaves by nothing. */
/** @type {any} */ (self).onconnect = (/** @type {MessageEvent} */ { ports: [port] }) => {
  port.onmessage = ({ data: topic }) => (topic ? join(port, topic) : leave(port));
};

setInterval(() => {
  for (const { readers } of streams.values()) {
    for (const [port, seenAt] of readers) if (Date.now() - seenAt > SILENT_MS) leave(port);
  }
}, SILENT_MS / 4);
