// The board of a suite: scores, and the certainty of the order.
import { html, useMemo } from "../ui.js";
import { withQuery } from "../api.js";
import { Commands } from "../parts/copy.js";
import { usePages, More, PAGE_ITEMS } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text, visible } from "../parts/text.js";
import { Time } from "../parts/time.js";
import { Download } from "../parts/download.js";
import { METRICS, metricName } from "../parts/metrics.js";
import { useQuery, useTitle } from "../parts/query.js";
import { KINDS, Legend, isShown, kindsOf, withKind } from "../parts/rows.js";
import { Rows } from "../board/rows.js";

/** The maximum number of metrics that the server adds to rows. */
const METRICS_MAX = 16;

const PICKS = [
  ["best", "best run"],
  ["last", "last run"],
  ["mean", "mean of all runs"],
];

/** @param {{suite: string}} props */
export function Page({ suite }) {
  const [query, change] = useQuery();
  const wanted = useMemo(() => asked(suite, query), [suite, query]);
  const list = usePages(withQuery("/api/v1/leaderboard", { ...wanted.api, limit: PAGE_ITEMS }));
  const board = list.value;
  useTitle(board && `${visible(board.suite)}, rules ${board.rules}: board`);

  if (list.problem && !board) return html`<${NoBoard} suite=${suite} problem=${list.problem} retry=${list.reload} />`;
  const rows = list.items.filter((row) => isShown(row, wanted.kinds));
  const csv = withQuery("/api/v1/leaderboard", { ...wanted.api, format: "csv" });
  return html`
    <h1>Board <${Text} value=${board?.suite ?? suite} /></h1>
    <p class="muted">
      ${board
        ? html`Rules <strong>${board.rules}</strong>, ${board.tasks.length} ${board.tasks.length === 1 ? "task" : "tasks"}, ${board.rows} ${board.rows === 1 ? "row" : "rows"}.${" "}${newest(list.items) && html`Newest run: <${Time} value=${newest(list.items)} />. `}<span class="mono small">${board.digest}</span>`
        : "Loading …"}
    </p>
    <${Choices} wanted=${wanted} tasks=${board?.tasks ?? []} change=${change} csv=${csv} name=${suite} />
    ${list.problem && html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`}
    ${board &&
    html`
      <p class="unseen" role="status">${rows.length} rows, sorted by ${wanted.sort}.</p>
      ${rows.length > 0
        ? html`<${Rows} rows=${rows} board=${board} wanted=${wanted} sortBy=${(/** @type {string} */ sort) => change({ sort })} />`
        : html`<${Empty} isAll=${list.items.length === 0} suite=${board.suite} />`}
      <${More} list=${list} />
      <${Explained} rows=${rows} pick=${board.pick} method=${board.metrics_method} />
    `}
  `;
}

/** The parameters in the address. @param {string} suite @param {URLSearchParams} query */
function asked(suite, query) {
  const kinds = kindsOf(query.get("kind"));
  const metrics = (query.get("metrics") ?? "").split(",").filter((name) => name in METRICS).slice(0, METRICS_MAX);
  const sort = query.get("sort") || "total";
  const task = query.get("task") ?? "";
  // The page sorts by all other columns itself.
  const byServer = /^[A-Z]/.test(sort) && (!task || task === sort);
  return {
    kinds,
    metrics,
    task,
    sort: /^[A-Z]/.test(sort) && !byServer ? "total" : sort,
    api: {
      suite,
      rules: query.get("rules") ?? "paper",
      task,
      sort: byServer ? sort : null,
      pick: query.get("pick"),
      reference: kinds.has("paper") ? null : false,
      imported: kinds.has("imported") ? true : null,
      metrics: metrics.join(","),
    },
  };
}

/** @param {any[]} rows */
const newest = (rows) => rows.map((row) => row.started_at).filter(Boolean).sort().at(-1);

/**
 * @param {{wanted: ReturnType<typeof asked>, tasks: string[], csv: string, name: string,
 *   change: (changes: Record<string, string | null>) => void}} props
 */
function Choices({ wanted, tasks, change, csv, name }) {
  const all = useMemo(() => new Set(tasks), []);
  for (const task of tasks) all.add(task);
  /** @param {string} metric @param {boolean} isOn */
  const measure = (metric, isOn) =>
    change({ metrics: [...wanted.metrics.filter((one) => one !== metric), ...(isOn ? [metric] : [])].join(",") });
  return html`<div class="choices">
    <div class="buttons">
      <${Choice} label="Task" value=${wanted.task} options=${[["", "all"], ...[...all].map((task) => [task, task])]} set=${(v) => change({ task: v, sort: null })} />
      <${Choice} label="Rules" value=${wanted.api.rules} options=${[["paper", "paper"], ["reference", "reference"]]} set=${(v) => change({ rules: v })} />
      <${Choice} label="Shown of a player" value=${wanted.api.pick ?? "best"} options=${PICKS} set=${(v) => change({ pick: v })} />
      <${Download} href=${csv} name=${`${name}.csv`}>CSV</${Download}>
    </div>
    <fieldset class="plain buttons">
      <legend class="unseen">Rows</legend>
      ${KINDS.map(
        (kind) => html`<label
          ><input type="checkbox" checked=${wanted.kinds.has(kind.name)} onChange=${(e) => change({ kind: withKind(wanted.kinds, kind.name, e.currentTarget.checked) })} />
          ${kind.label}</label
        >`,
      )}
    </fieldset>
    <details>
      <summary>Metrics as columns${wanted.metrics.length > 0 && `: ${wanted.metrics.length}`}</summary>
      <fieldset class="plain metrics">
        <legend class="unseen">Metrics</legend>
        ${Object.entries(METRICS).map(
          ([metric, about]) => html`<label title=${about}
            ><input type="checkbox" checked=${wanted.metrics.includes(metric)}
              disabled=${!wanted.metrics.includes(metric) && wanted.metrics.length >= METRICS_MAX}
              onChange=${(e) => measure(metric, e.currentTarget.checked)} />
            ${metricName(metric)}</label
          >`,
        )}
      </fieldset>
    </details>
  </div>`;
}

/** @param {{label: string, value: string, options: string[][], set: (value: string) => void}} props */
const Choice = ({ label, value, options, set }) =>
  html`<label
    >${label}
    <select value=${value} onChange=${(e) => set(e.currentTarget.value)}>
      ${options.map(([value, name]) => html`<option value=${value}>${visible(name)}</option>`)}
    </select></label
  >`;

/** @param {{isAll: boolean, suite: string}} props */
const Empty = ({ isAll, suite }) =>
  isAll
    ? html`<p class="empty">Nobody has ended a run of this suite yet.</p>
        ${["quick", "standard"].includes(suite) && html`<p>This plays it with built-in players:</p><${Commands} label="Command" what="the command" lines=${[`swarmbench play --suite ${suite} --server ${location.origin}`]} />`}`
    : html`<p class="empty">All rows are hidden. Choose above what to show.</p>`;

/** @param {{rows: any[], pick: string, method?: any}} props */
const Explained = ({ rows, pick, method }) => html`
  <h2>How to read it</h2>
  <dl class="facts legend">
    <dt>6.60 ± 1.36</dt>
    <dd>Mean and standard deviation of the scores over the seeds. The total is the sum of the means. Games that were not played count as 0.</dd>
    <dt>├─●─┤</dt>
    <dd>The mean with its interval of 95 %, by Student's t. All intervals of a column have one scale. The grey band is the interval of the leader: who overlaps with it may be as good.</dd>
    <dt>≈</dt>
    <dd>The order of this row and the nearest one above it that was played here is not sure: the interval of their difference on the same seeds contains 0. Such rows, and rows of one rank, have a bar beside them.</dd>
    <${Legend} rows=${rows} />
  </dl>
  <p class="muted small">
    Each row is ${pick === "mean" ? "the mean of all runs" : `the ${pick} run`} of one player: owner, model, sampling and prompt, as declared.
    ${method && ` Metrics: definition ${method.definition}, revision ${method.metrics_revision}, texts compared by ${method.embedder}.`}
  </p>
`;

/** @param {{suite: string, problem: any, retry: () => void}} props */
function NoBoard({ suite, problem, retry }) {
  if (problem.status !== 400) return html`<h1>Board</h1><${ProblemNote} problem=${problem} retry=${retry} />`;
  return html`
    <h1>No such board</h1>
    <p>This server has no board <strong><${Text} value=${suite} /></strong> that fits this address.</p>
    <p class="muted"><${Text} value=${problem.message} /></p>
    <p><a href=${location.pathname}>The board without choices</a>, or <a href="/boards">all boards</a>.</p>
  `;
}
