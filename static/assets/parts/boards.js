// The shared part of lists of boards.
import { html } from "../ui.js";
import { Problem, request, route, withQuery } from "../api.js";
import { useLoaded } from "./load.js";
import { short } from "./chart.js";
import { Text } from "./text.js";

/**
 * The suites of finished runs, newest first, then the built-in ones; each once. Attempts are on the board of their
 * competition.
 * @param {any[]} suites @param {any[]} runs
 */
export function arrange(suites, runs) {
  /** @type {Map<string, {suite: any, newest: string | null}>} */
  const boards = new Map();
  for (const run of runs) {
    const isOnBoard = run.status !== "running" && run.attempt === null;
    if (isOnBoard && !boards.has(run.suite.digest)) {
      boards.set(run.suite.digest, { suite: run.suite, newest: run.created_at });
    }
  }
  for (const suite of suites) if (!boards.has(suite.digest)) boards.set(suite.digest, { suite, newest: null });
  return [...boards.values()];
}

/** The board of a suite. @param {any} suite */
export const boardHref = (suite) =>
  withQuery(`/board/${encodeURIComponent(suite.digest ? `${suite.name}@${suite.digest}` : suite.name)}`, { rules: suite.rules });

/** The suite of a run with its board, or the competition of an attempt, which is the name of its suite. @param {{run: any}} props */
export const SuiteLink = ({ run: { suite, attempt } }) =>
  attempt === null
    ? html`<a href=${boardHref(suite)}><${Text} value=${suite.name} /></a>`
    : html`<a href=${route`/competitions/${suite.name}`}>competition</a>, attempt ${attempt}`;

/** The first rows of a board. @param {any} suite @param {number} limit */
export const useLeaders = (suite, limit) =>
  useLoaded(
    (signal) =>
      request(withQuery("/api/v1/leaderboard", { suite: `${suite.name}@${suite.digest}`, rules: suite.rules, limit }), { signal }),
    [suite.digest],
  );

/** @param {{of: ReturnType<typeof useLeaders>}} props */
export const Leaders = ({ of: { value, problem } }) => {
  if (problem) return html`<span class="muted">${problem instanceof Problem && problem.status === 401 ? "only with a key" : "not available"}</span>`;
  if (!value) return html`<span class="muted">…</span>`;
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
