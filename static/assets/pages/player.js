// A row of a board: all its numbers, and the games behind them.
import { html, useState } from "../ui.js";
import { Problem, request, route, withQuery } from "../api.js";
import { LineChart, short } from "../parts/chart.js";
import { GameGrid } from "../parts/grid.js";
import { useLoaded } from "../parts/load.js";
import { eachPage } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { LongText, Text, visible } from "../parts/text.js";
import { Time } from "../parts/time.js";
import { useTitle } from "../parts/query.js";
import { useScores } from "../parts/runs.js";
import { Metrics } from "../parts/runmetrics.js";
import { Legend, Marks, Score, isTied, samples, scale } from "../parts/rows.js";
import { interval } from "../parts/statistics.js";
import { Status, failuresText, percent } from "../parts/status.js";

/** The number of runs listed. */
const RUNS_MAX = 100;

/** The number of points of a curve. */
const POINTS = 50;

/** @param {{suite: string, row: string, query: URLSearchParams}} props */
export function Page({ suite, row: id, query }) {
  const loaded = useLoaded((signal) => find(suite, id, query, signal), [suite, id]);
  const found = loaded.value;
  useTitle(found?.row && `${visible(found.row.model)} on ${visible(found.board.suite)}`);
  const back = withQuery(`/board/${encodeURIComponent(suite)}`, Object.fromEntries(query));
  if (!found) {
    if (loaded.problem) return html`<h1>Player</h1><${ProblemNote} problem=${loaded.problem} retry=${loaded.reload} />`;
    return html`<h1>Player</h1><p class="muted" role="status">Loading …</p>`;
  }
  if (!found.row) return html`<${NoRow} suite=${suite} back=${back} hasBoard=${found.board !== null} />`;
  const { board, row } = found;
  const total = interval(samples(row, board.tasks));
  return html`
    <h1><${Text} value=${row.model} /></h1>
    <p>
      ${row.rank === null ? "Not ranked, one" : `Rank ${row.rank}`} of ${board.rows} rows on the board ${" "}
      <a href=${back}><${Text} value=${board.suite} /></a>, rules ${board.rules}.${total && html` Total <strong class="number">${short(total.mean)}</strong>${total.low !== null && ` (95 % interval ${short(total.low)} to ${short(total.high)})`}.`}
      ${" "}<${Marks} row=${row} />
    </p>
    ${row.difference && html`<${Behind} board=${board} row=${row} />`}
    ${(!row.run || board.pick === "mean" || row.converted.length > 0) && html`<${Scores} board=${board} row=${row} />`}
    ${row.run ? html`<${Played} row=${row} board=${board} />` : html`<p class="empty">${row.imported ? "These games were read from files." : "These numbers were not measured on this server, so there are no games to look at."} </p>
      ${row.note && html`<p class="muted">Source: <${Text} value=${row.note} /></p>`}`}
    <h2>What the marks say</h2>
    <dl class="facts small"><${Legend} rows=${[row]} /></dl>
  `;
}

/** The difference to the nearest row above that was played here. @param {{board: any, row: any}} props */
function Behind({ board, row }) {
  const { to, mean, low, high, pairs } = row.difference;
  const href = withQuery(`/board/${encodeURIComponent(`${board.suite}@${board.digest}`)}/${encodeURIComponent(to)}`, { rules: board.rules });
  return html`<p>
    It is <strong class="number">${short(mean)}</strong> below <a href=${href}>the nearest row above</a> that was played here, on ${pairs} common seeds
    ${low === null ? " (too few for an interval)." : ` (95 % interval ${short(low)} to ${short(high)}).`}
    ${isTied(row) && html` <strong>≈ Their order is not sure.</strong>`}
  </p>`;
}

/**
 * The row on the board. Null where the board, or the row on it, does not exist.
 * @param {string} suite @param {string} id @param {URLSearchParams} query @param {AbortSignal} signal
 */
async function find(suite, id, query, signal) {
  /** @type {{board: any, row: any}} */
  const found = { board: null, row: null };
  const asked = { suite, rules: query.get("rules"), pick: query.get("pick"), imported: query.get("imported") };
  try {
    await eachPage("/api/v1/leaderboard", asked, signal, (board) => {
      found.board = board;
      found.row = board.items.find((/** @type {any} */ row) => row.id === id) ?? null;
      return found.row !== null;
    });
  } catch (problem) {
    if (!(problem instanceof Problem) || problem.status !== 400) throw problem;
  }
  return found;
}

/** @param {{suite: string, back: string, hasBoard: boolean}} props */
const NoRow = ({ suite, back, hasBoard }) => html`
  <h1>No such row</h1>
  ${hasBoard
    ? html`<p>
        The board <strong><${Text} value=${suite} /></strong> has no such row. The link may be cut off, or the player's runs were voided
        or withdrawn. <a href=${back}>Look at the board</a>.
      </p>`
    : html`<p>This server has no board <strong><${Text} value=${suite} /></strong>. <a href="/boards">All boards</a>.</p>`}
`;

/** @param {{board: any, row: any}} props */
function Scores({ board, row }) {
  const total = board.tasks.length > 1 ? [["Total", board.tasks]] : [];
  const lines = [...board.tasks.map((/** @type {string} */ task) => [task, [task]]), ...total];
  return html`<div class="scroll" tabindex="0" role="region" aria-label="Scores by task">
    <table>
      <thead>
        <tr>
          <th scope="col">Task</th>
          <th scope="col" class="number">Mean ± deviation, 95 % interval</th>
          <th scope="col" class="number">Games</th>
        </tr>
      </thead>
      <tbody>
        ${lines.map(([name, tasks]) => {
          const of = interval(samples(row, tasks));
          const task = row.tasks[name];
          return html`<tr key=${name}>
            <th scope="row">${name}</th>
            <td class="number"><${Score} of=${of} deviation=${task?.deviation} range=${scale([of])} name=${name} /></td>
            <td class="number">${task ? `${task.games ?? "–"}${task.planned === null ? "" : ` of ${task.planned}`}` : ""}</td>
          </tr>`;
        })}
      </tbody>
    </table>
  </div>`;
}

/** The runs of the row, and the games of the one that is shown. @param {{board: any, row: any}} props */
function Played({ board, row }) {
  const [id, setId] = useState(row.run);
  const why = failuresText(row.failures);
  const run = useLoaded((signal) => request(route`/api/v1/runs/${id}`, { signal }), [id]);
  const scores = useScores(id, "");
  return html`
    <p class="muted">
      Answers that could not be read: ${percent(row.invalid_share)}${why && ` (${why})`}. Clocks that expired: ${percent(row.timeout_share)}.
      ${row.runs > 1 && ` The row is the ${board.pick === "mean" ? "mean" : board.pick} of ${row.runs} runs.`}
    </p>
    <${Runs} board=${board} row=${row} shown=${id} show=${setId} />
    ${run.problem && html`<${ProblemNote} problem=${run.problem} retry=${run.reload} what="The run" />`}
    ${run.value &&
    html`
      <h2>Games of <a href=${route`/runs/${id}`}>this run</a></h2>
      <${GameGrid} run=${run.value} scores=${scores} />
      <h2>Score curves</h2>
      <${Curves} games=${run.value.games} scores=${scores} />
      <h2>Metrics</h2>
      <${Metrics} key=${id} id=${id} />
      <${Declared} run=${run.value} row=${row} />
    `}
  `;
}

/** @param {{board: any, row: any, shown: string, show: (id: string) => void}} props */
function Runs({ board, row, shown, show }) {
  const { value } = useLoaded(
    (signal) => request(withQuery("/api/v1/runs", { model: row.model, suite: board.suite, limit: RUNS_MAX }), { signal }),
    [row.id],
  );
  const runs = (value?.items ?? []).filter((/** @type {any} */ run) => isOf(run, board, row));
  if (runs.length < 2) return null;
  return html`<h2>Runs with this model and these settings</h2>
    <ul>
      ${runs.map(
        (/** @type {any} */ run) => html`<li>
          <button type="button" class="quiet" aria-pressed=${run.id === shown} onClick=${() => show(run.id)}><${Time} value=${run.created_at} /></button>
          <${Status} status=${run.status} of="run" /> <span class="number">${short(run.total)}</span> <a href=${route`/runs/${run.id}`}>run</a>
          ${run.id === row.run && html` <span class="muted small">named by the row</span>`}
        </li>`,
      )}
    </ul>`;
}

/** Whether a run has the settings of a row. @param {any} run @param {any} board @param {any} row */
const isOf = (run, board, row) =>
  run.suite.digest === board.digest &&
  run.temperature === row.temperature &&
  run.top_p === row.top_p &&
  (run.template_digest ?? "").startsWith(row.prompt_template ?? "") &&
  Boolean(run.template_digest) === Boolean(row.prompt_template);

/** The mean of the games of each task, round by round, between the lowest and the highest. @param {{games: any[], scores: import("../parts/runs.js").Scores}} props */
function Curves({ games, scores }) {
  const tasks = [...new Set(games.map((game) => game.task))];
  if (scores.size === 0) return html`<p class="empty">There are no curves to show.</p>`;
  return html`<div class="curves">
    ${tasks.map((task) => {
      const known = games.flatMap((game) => (game.task === task && game.void_reason === null && scores.get(game.episode)) || []);
      if (known.length === 0) return null;
      const { every, series } = summary(known);
      const label = `Score in ${known.length} games of ${task}: mean, lowest and highest by round; at the end ${series.map((one) => `${one.name} ${short(one.values.at(-1))}`).join(", ")}`;
      return html`<section key=${task} aria-label=${task}>
        <h3>${task}</h3>
        <${LineChart} series=${known.length > 1 ? series : series.slice(0, 1)} label=${label} width=${380} height=${150} every=${every} />
      </section>`;
    })}
  </div>`;
}

/** @param {{rounds: number, every: number, scores: number[]}[]} games */
function summary(games) {
  const rounds = Math.max(...games.map((game) => game.rounds), 1);
  const every = Math.max(1, Math.ceil(rounds / POINTS));
  const count = Math.floor(rounds / every) + 1;
  /** A game that ended keeps its score. @type {number[][]} */
  const columns = Array.from({ length: count }, (_, index) =>
    games.map((game) => game.scores[Math.min(Math.round((index * every) / game.every), game.scores.length - 1)]),
  );
  const mean = columns.map((scores) => scores.reduce((sum, score) => sum + score, 0) / scores.length);
  return {
    every,
    series: [
      { name: "mean", values: mean },
      { name: "lowest", values: columns.map((scores) => Math.min(...scores)) },
      { name: "highest", values: columns.map((scores) => Math.max(...scores)) },
    ],
  };
}

/** @param {{run: any, row: any}} props */
const Declared = ({ run, row }) => html`
  <h2>As declared</h2>
  <dl class="facts">
    <dt>Owner</dt><dd>${row.owner ? html`<${Text} value=${row.owner} />` : "no key"}</dd>
    <dt>Temperature</dt><dd>${row.temperature ?? "not declared"}</dd>
    <dt>Top p</dt><dd>${row.top_p ?? "not declared"}</dd>
    <dt>Prompt</dt><dd>${row.prompt_template ? html`own template <code>${row.prompt_template}</code>` : "built-in template"}</dd>
  </dl>
  ${Object.keys(run.agent_meta).length > 0 && html`<details><summary>Other declared facts</summary><${LongText} value=${JSON.stringify(run.agent_meta, null, 2)} label="Declared facts about the player" /></details>`}
`;
