// A row of a board: all its numbers, and the games behind them.
import { html, useState } from "../ui.js";
import { Problem, request, route, withQuery } from "../api.js";
import { Marks, Score, Settings, rowHref, scale, totalOf } from "../parts/boards.js";
import { alike, isTied, short } from "../parts/chart.js";
import { Items } from "../parts/listed.js";
import { useLoaded } from "../parts/load.js";
import { eachPage } from "../parts/pages.js";
import { Waiting } from "../parts/problem.js";
import { useTitle } from "../parts/query.js";
import { About, GameGrid, Metrics, useRun, useScores } from "../parts/run.js";
import { Status, failuresText, percent } from "../parts/status.js";
import { Text, visible } from "../parts/text.js";
import { Time } from "../parts/time.js";
import { samplingText } from "../parts/words.js";

/** The number of runs listed. */
const RUNS_MAX = 100;

const UNMEASURED = "These numbers were not measured on this server, so there are no games to look at.";

/** @param {{suite: string, row: string, query: URLSearchParams}} props */
export function Page({ suite, row: id, query }) {
  const loaded = useLoaded((signal) => find(suite, id, query, signal), [suite, id]);
  const { board, row } = loaded.value ?? { board: null, row: null };
  useTitle(row && `${visible(row.model)} on ${visible(board.suite)}`);
  if (!loaded.value) return html`<h1>Player</h1><${Waiting} of=${loaded} />`;
  const back = withQuery(`/board/${encodeURIComponent(suite)}`, Object.fromEntries(query));
  if (!row) {
    return html`<h1>No such row</h1>
      ${board
        ? html`<p>
            The board <strong><${Text} value=${suite} /></strong> has no such row. The link may be cut off, or the player's runs were voided or
            withdrawn. <a href=${back}>Look at the board</a>.
          </p>`
        : html`<p>This server has no board <strong><${Text} value=${suite} /></strong>. <a href="/boards">All boards</a>.</p>`}`;
  }
  const total = totalOf(row, board.tasks);
  return html`
    <h1><${Text} value=${row.model} /></h1>
    <p>
      ${row.rank === null ? "Not ranked, one" : `Rank ${row.rank}`} of ${board.rows} rows on the board ${" "}
      <a href=${back}><${Text} value=${board.suite} /></a>, rules ${board.rules}.${" "}
      ${total && html`Total <strong class="number">${short(total.mean)}</strong>${total.low !== null && ` (95 % interval ${between(total)})`}. `}
      <${Settings} row=${row} /> <${Marks} row=${row} />
    </p>
    ${row.difference && html`<${Behind} board=${board} row=${row} />`}
    ${(!row.run || board.pick === "mean" || row.converted.length > 0) && html`<${Scores} board=${board} row=${row} />`}
    ${row.run
      ? html`<${Played} row=${row} board=${board} />`
      : html`<p class="empty">${row.imported ? "These games were read from files." : UNMEASURED}</p>
          ${row.note && html`<p class="muted">Source: <${Text} value=${row.note} /></p>`}`}
  `;
}

/** @param {{low: number | null, high: number | null}} interval */
const between = ({ low, high }) => `${short(low)} to ${short(high)}`;

/** The difference to the nearest row above that was played here. */
function Behind({ board, row }) {
  const { to, mean, low, high, pairs } = row.difference;
  return html`<p>
    It is <strong class="number">${short(mean)}</strong> below <a href=${rowHref(board, { id: to })}>the nearest row above</a>${" "}
    that was played here, on ${pairs} common seeds ${low === null ? "(too few for an interval)." : `(95 % interval ${between({ low, high })}).`}
    ${isTied(row) && html` <strong>≈ Their order is not sure.</strong>`}
  </p>`;
}

/**
 * The row on the board. Null where the board, or the row on it, does not exist.
 * @param {string} suite @param {string} id @param {URLSearchParams} query @param {AbortSignal} signal
 */
async function find(suite, id, query, signal) {
  const found = { board: /** @type {any} */ (null), row: /** @type {any} */ (null) };
  const asked = { suite, rules: query.get("rules"), pick: query.get("pick"), imported: query.get("imported") };
  try {
    await eachPage("/api/v1/leaderboard", asked, signal, (board) => {
      found.board = board;
      found.row = board.items.find((row) => row.id === id) ?? null;
      return found.row !== null;
    });
  } catch (problem) {
    if (!(problem instanceof Problem) || problem.status !== 400) throw problem;
  }
  return found;
}

function Scores({ board, row }) {
  const lines = board.tasks.map((name) => ({ name, tasks: [name], ...row.tasks[name] }));
  if (lines.length > 1) lines.push({ name: "Total", tasks: board.tasks });
  const score = ({ name, tasks, deviation }) => {
    const of = totalOf(row, tasks);
    return html`<${Score} of=${of} deviation=${deviation} range=${scale([of])} name=${name} hasBounds />`;
  };
  const count = ({ tasks, games, planned }) => (tasks.length > 1 ? "" : `${games ?? "–"}${typeof planned === "number" ? ` of ${planned}` : ""}`);
  return html`<${Items} label="Scores by task" items=${lines} keyOf=${({ name }) => name}
    columns=${[["Task", ({ name }) => name], ["#Mean ± deviation, 95 % interval", score], ["#Games", count]]} />`;
}

/** The runs of the row, and the games of the one that is shown. */
function Played({ board, row }) {
  const [id, setId] = useState(row.run);
  const run = useRun(id);
  const scores = useScores(id);
  const why = failuresText(row.failures);
  return html`
    <p class="muted">
      Answers that could not be read: ${percent(row.invalid_share)}${why && ` (${why})`}. Clocks that expired: ${percent(row.timeout_share)}.
      ${row.runs > 1 && ` The row is the ${board.pick} of ${row.runs} runs.`}
    </p>
    <${Runs} board=${board} row=${row} shown=${id} show=${setId} />
    ${run.problem && html`<${Waiting} of=${run} what="The run" />`}
    ${run.value &&
    html`
      <h2>Games of <a href=${route`/runs/${id}`}>this run</a></h2>
      <${GameGrid} run=${run.value} scores=${scores} />
      <h2>Metrics</h2>
      <${Metrics} key=${id} id=${id} />
      <${About} run=${run.value} />
    `}
  `;
}

/** @param {{board: any, row: any, shown: string, show: (id: string) => void}} props */
function Runs({ board, row, shown, show }) {
  const address = withQuery("/api/v1/runs", { model: row.model, suite: board.suite, limit: RUNS_MAX });
  const { value } = useLoaded((signal) => request(address, { signal }), [address]);
  const runs = (value?.items ?? []).filter((run) => isOf(run, board, row));
  const total = alike(runs.map((run) => run.total));
  if (runs.length < 2) return null;
  return html`<h2>Runs with this model and these settings</h2>
    <ul>
      ${runs.map(({ id, created_at, status, ...run }) => html`<li>
        <button type="button" class="quiet" aria-pressed=${id === shown} onClick=${() => show(id)}><${Time} value=${created_at} /></button>
        <${Status} status=${status} of="run" /> <span class="number">${total(run.total)}</span> <a href=${route`/runs/${id}`}>run</a>
        ${id === row.run && html` <span class="muted small">named by the row</span>`}
      </li>`)}
    </ul>`;
}

/** Whether a run has the settings of a row. */
const isOf = (run, board, row) =>
  run.suite.digest === board.digest &&
  samplingText(run) === samplingText(row) &&
  run.prompt === (row.prompt ?? "none") &&
  playersOf(run) === playersOf(row);

/** What distinguishes teams of one name. @param {{holders?: any[]}} team */
const playersOf = ({ holders = [] }) =>
  JSON.stringify(holders.map(({ name, model, seats, prompt, ...holder }) => [name, model, seats, prompt, samplingText(holder)]));
