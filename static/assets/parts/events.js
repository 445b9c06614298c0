// Events of the server, which all tabs of a browser share; where a browser cannot, a tab asks for them now and then.
import { Problem, sleep } from "../api.js";
import { turn } from "./turns.js";

/** @import { Handlers, Topic } from "./turns.js" */

/** The interval between two signs of life to the shared worker. */
const ALIVE_MS = 30_000;

/** The pause between two turns of a tab without a shared worker, during which it leaves its connection to others. */
const PAUSE_MS = 3_000;

const { href } = new URL("../streams.js", import.meta.url);

/** The address of the worker, as pages with trusted types want it: their one policy makes no other address of it. */
const ADDRESS = /** @type {any} */ (globalThis).trustedTypes?.createPolicy("streams", { createScriptURL: () => href }).createScriptURL("") ?? href;

/** Whether the browser has shared workers, and this one runs. */
let isShared = "SharedWorker" in globalThis;

/** The shared worker; null where the browser refuses one, as in a frame without an origin. */
function opened() {
  try {
    return new SharedWorker(ADDRESS, { type: "module" });
  } catch {
    return null;
  }
}

/**
 * Follows events by the shared worker, to which each topic of a tab has a port. Resolves to false if the worker cannot run.
 * @param {Topic} topic
 * @param {Handlers} handlers
 */
async function share(topic, { signal, onEvent, onState }) {
  const worker = opened();
  if (!worker) return false;
  const { port } = worker;
  const join = () => port.postMessage(topic);
  const leave = () => port.postMessage(null);
  const own = new AbortController();
  const timer = setInterval(join, ALIVE_MS);
  addEventListener("pagehide", leave, { signal: own.signal });
  // A page that comes back from the browser's memory follows on.
  addEventListener("pageshow", ({ persisted }) => persisted && join(), { signal: own.signal });
  try {
    return await new Promise((resolve, reject) => {
      if (signal.aborted) return resolve(true);
      signal.addEventListener("abort", () => resolve(true));
      worker.onerror = () => resolve((isShared = false));
      port.onmessage = ({ data: { event, state, isOver, problem } }) => {
        if (event?.id) topic.lastId = event.id;
        if (event) onEvent(event);
        if (state) onState(state);
        if (problem) reject(new Problem(problem.status, problem));
        else if (isOver) resolve(true);
      };
      join();
    });
  } finally {
    own.abort();
    clearInterval(timer);
    leave();
    port.close();
  }
}

/**
 * Follows events until the last one, or until the signal aborts; a lost connection is resumed after the last event. Throws refusals.
 * @param {Topic} topic
 * @param {Handlers} handlers
 */
export async function follow(topic, handlers) {
  const { signal } = handlers;
  if (isShared && (await share(topic, handlers))) return;
  while (!signal.aborted && !(await turn(topic, { ...handlers, mustEnd: () => true }))) await sleep(PAUSE_MS, signal);
}
