// A run and its score curves, kept up to date while it is running.
import { useCallback, useEffect, useRef, useState } from "../ui.js";
import { Problem, request, route, stream } from "../api.js";
import { useLoaded } from "./load.js";
import { eachPage } from "./pages.js";

/** The interval between reads of a running run: its events have no rounds and scores of open games. */
const POLL_MS = 5000;

/** The time within which events lead to one request. */
const SETTLE_MS = 2000;

/** The number of points of a game's score curve. */
const POINTS = 50;

/** @param {string} id */
export function useRun(id) {
  const [isRunning, setIsRunning] = useState(false);
  const loaded = useLoaded((signal) => request(route`/api/v1/runs/${id}`, { signal }), [id], isRunning ? POLL_MS : undefined);
  const status = loaded.value?.status;
  useEffect(() => setIsRunning(status === "running"), [status]);
  const soon = useSettled(loaded.reload);
  const [isLost, setIsLost] = useState(false);
  useEffect(() => {
    if (status !== "running") return;
    const aborted = new AbortController();
    stream(route`/api/v1/runs/${id}/events`, {
      signal: aborted.signal,
      onState: (state) => setIsLost(state === "lost"),
      onEvent: ({ event }) => {
        soon();
        return event === "finished";
      },
    }).catch((problem) => {
      if (problem instanceof Problem) loaded.reload();
    });
    return () => aborted.abort();
  }, [id, status]);
  return { ...loaded, isLost };
}

/** Calls back once after several calls. @param {() => void} call */
function useSettled(call) {
  const timer = useRef(0);
  useEffect(() => () => clearTimeout(timer.current), []);
  return useCallback(() => {
    clearTimeout(timer.current);
    timer.current = setTimeout(call, SETTLE_MS);
  }, [call]);
}

/** @typedef {Map<string, {rounds: number, every: number, scores: number[]}>} Scores score curves by episode */

/**
 * The score curves of a run's games; empty where the server has none to show.
 * @param {string | null | undefined} id
 * @param {unknown} version they are read again when it changes
 * @returns {Scores}
 */
export function useScores(id, version) {
  const { value } = useLoaded(
    async (signal) => {
      /** @type {Scores} */
      const scores = new Map();
      if (!id) return scores;
      await eachPage(route`/api/v1/runs/${id}/scores`, { points: POINTS }, signal, (page) => {
        for (const item of page.items) scores.set(item.episode, item);
      });
      return scores;
    },
    [id, version],
  );
  return value ?? new Map();
}
