// The board of a suite: scores, and the certainty of the order.
import { html, useMemo } from "../ui.js";
import { withQuery } from "../api.js";
import { Rows, hasCost } from "../board/rows.js";
import { KINDS, Legend, isShown, kindsOf, withKind } from "../parts/boards.js";
import { Commands } from "../parts/copy.js";
import { Download } from "../parts/download.js";
import { Check, Choice } from "../parts/filters.js";
import { Folded } from "../parts/load.js";
import { METRICS, metricName } from "../parts/metrics.js";
import { More, PAGE_ITEMS, usePages, useReadOn } from "../parts/pages.js";
import { ProblemNote, Waiting } from "../parts/problem.js";
import { useQuery, useTitle } from "../parts/query.js";
import { Text, visible } from "../parts/text.js";
import { Time } from "../parts/time.js";

/** The maximum number of metrics that the server adds to rows. */
const METRICS_MAX = 16;

/** The maximum number of rows that are read to be sorted by a column that the server does not rank by. */
const SORTED_MAX = 2_000;

const PICKS = [["best", "best run"], ["last", "last run"], ["mean", "mean of all runs"]];

/** @param {{suite: string}} props */
export function Page({ suite }) {
  const [query, change] = useQuery();
  const wanted = useMemo(() => asked(suite, query), [suite, query]);
  const list = usePages(withQuery("/api/v1/leaderboard", { ...wanted.api, limit: PAGE_ITEMS }));
  const { value: board, problem, items, hasMore } = list;
  // Rows that are sorted here are all read first.
  const isSortedHere = board && wanted.sort !== board.sort;
  const readsOn = useReadOn(list, isSortedHere && items.length < SORTED_MAX);
  useTitle(board && `${visible(board.suite)}, rules ${board.rules}: board`);

  if (problem && !board) return html`<${NoBoard} suite=${suite} list=${list} />`;
  const rows = items.filter((row) => isShown(row, wanted.kinds));
  return html`
    <h1>Board <${Text} value=${board?.suite ?? suite} /></h1>
    <p class="muted">${board ? html`<${Facts} board=${board} rows=${items} />` : "Loading …"}</p>
    <${Choices} wanted=${wanted} tasks=${board?.tasks ?? []} change=${change} />
    ${problem && html`<${ProblemNote} problem=${problem} retry=${list.reload} />`}
    ${board &&
    html`
      <p class="unseen" role="status">${rows.length} rows, sorted by ${wanted.sort}.</p>
      ${isSortedHere &&
      hasMore &&
      html`<p class="muted" role="status">
        ${readsOn ? `Reading all ${board.rows} rows to sort them …` : `Sorted are the first ${items.length} of ${board.rows} rows.`}
      </p>`}
      ${rows.length > 0
        ? html`<${Rows} rows=${rows} board=${board} sort=${wanted.sort} sortBy=${(sort) => change({ sort })} />`
        : html`<${Empty} isAll=${items.length === 0} suite=${board.suite} />`}
      <${More} list=${list} />
      ${rows.filter(hasCost).length > 1 && html`<${Folded} summary="Score against cost" read=${() => import("../board/costs.js")} name="Costs" props=${{ rows, board }} />`}
      ${rows.length > 0 && html`<${Explained} rows=${rows} pick=${board.pick} method=${board.metrics_method} />`}
    `}
  `;
}

/** The parameters in the address. @param {string} suite @param {URLSearchParams} query */
function asked(suite, query) {
  const kinds = kindsOf(query.get("kind"));
  const metrics = (query.get("metrics") ?? "").split(",").filter((name) => name in METRICS).slice(0, METRICS_MAX);
  const task = query.get("task") ?? "";
  const sort = query.get("sort") || "total";
  // The server sorts by tasks, and the page by all other columns.
  const isTask = /^[A-Z]/.test(sort);
  const byServer = isTask && (!task || task === sort);
  const api = {
    suite,
    rules: query.get("rules") ?? "paper",
    task,
    sort: byServer ? sort : null,
    pick: query.get("pick"),
    reference: kinds.has("paper") ? null : false,
    imported: kinds.has("imported") ? true : null,
    metrics: metrics.join(","),
  };
  return { kinds, metrics, task, sort: isTask && !byServer ? "total" : sort, api };
}

/** @param {{board: any, rows: any[]}} props */
function Facts({ board: { rules, tasks, rows: count, digest }, rows }) {
  const newest = rows.map((row) => row.started_at).filter(Boolean).sort().at(-1);
  const counts = `${tasks.length} ${tasks.length === 1 ? "task" : "tasks"}, ${count} ${count === 1 ? "row" : "rows"}.`;
  return html`Rules <strong>${rules}</strong>, ${counts}${" "}
    ${newest && html`Newest run: <${Time} value=${newest} />. `}<span class="mono small">${digest}</span>`;
}

/** @param {{wanted: ReturnType<typeof asked>, tasks: string[], change: (changes: Record<string, string | null>) => void}} props */
function Choices({ wanted: { api, kinds, metrics, task }, tasks, change }) {
  // A board of one task names no other ones.
  const all = useMemo(() => new Set(tasks), []);
  for (const task of tasks) all.add(task);
  /** @param {string} metric @param {boolean} isOn */
  const measure = (metric, isOn) => change({ metrics: [...metrics.filter((one) => one !== metric), ...(isOn ? [metric] : [])].join(",") });
  const csv = withQuery("/api/v1/leaderboard", { ...api, format: "csv" });
  return html`<div class="choices">
    <div class="buttons">
      <${Choice} label="Task" value=${task} options=${[...all]} onChange=${(task) => change({ task, sort: null })} />
      <${Choice} label="Rules" value=${api.rules} options=${["paper", "reference"]} all=${null} onChange=${(rules) => change({ rules })} />
      <${Choice} label="Shown of a player" value=${api.pick ?? "best"} options=${PICKS} all=${null} onChange=${(pick) => change({ pick })} />
      <${Download} href=${csv} name=${`${api.suite}.csv`}>CSV<//>
    </div>
    <fieldset class="plain buttons">
      <legend class="unseen">Rows</legend>
      ${KINDS.map(({ name, label }) => html`
        <${Check} label=${label} value=${kinds.has(name)} onChange=${(isOn) => change({ kind: withKind(kinds, name, isOn) })} />`)}
    </fieldset>
    <details>
      <summary>Metrics as columns${metrics.length > 0 && `: ${metrics.length}`}</summary>
      <fieldset class="plain metrics">
        <legend class="unseen">Metrics</legend>
        ${Object.entries(METRICS).map(([metric, about]) => {
          const isOn = metrics.includes(metric);
          return html`<label title=${about}>
            <input type="checkbox" checked=${isOn} disabled=${!isOn && metrics.length >= METRICS_MAX} onChange=${() => measure(metric, !isOn)} />
            ${metricName(metric)}
          </label>`;
        })}
      </fieldset>
    </details>
  </div>`;
}

/** @param {{isAll: boolean, suite: string}} props */
function Empty({ isAll, suite }) {
  if (!isAll) return html`<p class="empty">No rows of the chosen kinds. Choose above what to show.</p>`;
  return html`<p class="empty">Nobody has ended a run of this suite yet.</p>
    ${["quick", "standard"].includes(suite) &&
    html`<p>This plays it with built-in players:</p>
      <${Commands} label="Command" what="the command" lines=${[`swarmbench play --suite ${suite} --server ${location.origin}`]} />`}`;
}

/** @param {{rows: any[], pick: string, method?: any}} props */
const Explained = ({ rows, pick, method }) => html`
  <h2>How to read it</h2>
  <dl class="facts legend">
    <dt>6.60 ± 1.36</dt>
    <dd>Mean and standard deviation of the scores over the seeds. The total is the sum of the means. Games that were not played count as 0.</dd>
    <dt>├─●─┤</dt>
    <dd>
      The mean with its interval of 95 %, by Student's t. Models, people and rule-based players each have scales of their own. The grey band is the
      interval of the best row there: who overlaps with it may be as good. Ranks count the rows of all.
    </dd>
    <dt>≈</dt>
    <dd>
      The order of this row and the nearest one above it that was played here is not sure: the interval of their difference on the same seeds
      contains 0. Such rows, and rows of one rank, have a bar beside them. Press a sign to read what it says.
    </dd>
    <${Legend} rows=${rows} />
  </dl>
  <p class="muted small">
    Each row is ${pick === "mean" ? "the mean of all runs" : `the ${pick} run`} of one player: owner, model, sampling and prompt, as declared.
    ${method && ` Metrics: definition ${method.definition}, revision ${method.metrics_revision}, texts compared by ${method.embedder}.`}
  </p>
`;

/** @param {{suite: string, list: {problem: any, reload: () => void}}} props */
function NoBoard({ suite, list }) {
  if (list.problem.status !== 400) return html`<h1>Board</h1><${Waiting} of=${list} />`;
  return html`
    <h1>No such board</h1>
    <p>This server has no board <strong><${Text} value=${suite} /></strong> that fits this address.</p>
    <p class="muted"><${Text} value=${list.problem.message} /></p>
    <p><a href=${location.pathname}>The board without choices</a>, or <a href="/boards">all boards</a>.</p>
  `;
}
