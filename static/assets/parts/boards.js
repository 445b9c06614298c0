// What lists of boards share.
import { html } from "../ui.js";
import { Problem, request, withQuery } from "../api.js";
import { useLoaded } from "./load.js";
import { short } from "./chart.js";
import { Text } from "./text.js";

/**
 * The suites that were played, newest first, and then the built-in ones; each once.
 * @param {any[]} suites @param {any[]} runs
 */
export function arrange(suites, runs) {
  /** @type {Map<string, {suite: any, newest: string | null}>} */
  const boards = new Map();
  for (const run of runs) {
    if (run.suite.digest && !boards.has(run.suite.digest)) {
      boards.set(run.suite.digest, { suite: run.suite, newest: run.created_at });
    }
  }
  for (const suite of suites) if (!boards.has(suite.digest)) boards.set(suite.digest, { suite, newest: null });
  return [...boards.values()];
}

/** The board of a suite. @param {any} suite */
export const boardHref = (suite) =>
  withQuery(`/board/${encodeURIComponent(suite.digest ? `${suite.name}@${suite.digest}` : suite.name)}`, { rules: suite.rules });

/** The first rows of a board. @param {any} suite @param {number} limit */
export const useLeaders = (suite, limit) =>
  useLoaded(
    (signal) =>
      request(withQuery("/api/v1/leaderboard", { suite: `${suite.name}@${suite.digest}`, rules: suite.rules, limit }), { signal }),
    [suite.digest],
  );

/** @param {{of: ReturnType<typeof useLeaders>}} props */
export const Leaders = ({ of: { value, problem } }) => {
  if (!value) return html`<span class="muted">${problem instanceof Problem && problem.status === 401 ? "only with a key" : "…"}</span>`;
  const ranked = value.items.filter((/** @type {any} */ row) => row.rank !== null);
  if (ranked.length === 0) return html`<span class="muted">${value.rows === 0 ? "no rows yet" : "nobody has played every task"}</span>`;
  return html`<ol class="plain">
    ${ranked.map(
      (/** @type {any} */ row) => html`<li>
        <${Text} value=${row.model} />${row.reference && html` <span class="muted small">paper</span>`} <span class="number muted">${short(row.total)}</span>
      </li>`,
    )}
  </ol>`;
};
