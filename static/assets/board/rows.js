// The table of a board.
import { html } from "../ui.js";
import { Marks, PARTS, Score, Settings, Sign, rowHref, scale, totalOf } from "../parts/boards.js";
import { dollars, isTied, short } from "../parts/chart.js";
import { METRICS, metricName } from "../parts/metrics.js";
import { failuresText, percent } from "../parts/status.js";
import { SortHead, Table } from "../parts/table.js";
import { Text } from "../parts/text.js";

/**
 * A column; `key`: what the address calls it; `isUp`: whether it is sorted from the lowest; `value`: by which rows are sorted.
 * @typedef {{key: string, name: string, about?: string, isUp?: boolean, value: (row: any) => number | string | null, cell: (row: any) => any}} Column
 */

/**
 * Rows in parts by who plays: models, people, rule-based players.
 * @param {{rows: any[], board: any, sort: string, sortBy: (key: string) => void}} props
 */
export function Rows({ rows, board, sort, sortBy }) {
  const parts = PARTS.map(({ has, ...part }) => ({ ...part, rows: rows.filter(has) })).filter((part) => part.rows.length > 0);
  const hasCosts = rows.some(hasCost);
  const heads = [PLAYER, ...columnsOf(rows, board, hasCosts)].map(
    ({ key, name, isUp, about }) =>
      html`<${SortHead} name=${name} by=${key} isUp=${isUp} isNumber=${key !== PLAYER.key} about=${about} sort=${sort} onSort=${sortBy} />`,
  );
  return html`<${Table} label="Rows of the board" name="board" heads=${["#Rank", ...heads]}>
    ${parts.map(({ name, label, rows }) => {
      const isNamed = parts.length > 1 || name !== "models";
      return html`<tbody key=${name}>
        ${isNamed && html`<tr class="part"><th scope="rowgroup" colspan=${heads.length + 1}>${label}</th></tr>`}
        <${Part} rows=${rows} board=${board} sort=${sort} hasCosts=${hasCosts} />
      </tbody>`;
    })}
  <//>`;
}

/** @param {{rows: any[], board: any, sort: string, hasCosts: boolean}} props */
function Part({ rows, board, sort, hasCosts }) {
  const columns = columnsOf(rows, board, hasCosts);
  const isByServer = sort === board.sort;
  const sorted = isByServer ? rows : order(rows, columns, sort);
  // Rows whose order is not sure, and those that share a rank, stand together.
  const isTiedTo = (row, above) => (isTied(row) && row.difference.to === above.id) || (row.rank !== null && row.rank === above.rank);
  return sorted.map(
    (row, index) => html`<tr key=${row.id} class=${isByServer && index > 0 && isTiedTo(row, sorted[index - 1]) ? "tied" : ""}>
      <td class="number"><${Rank} row=${row} /></td>
      <th scope="row" class="player">
        <a href=${rowHref(board, row)}><${Text} value=${row.model} /></a> <${Settings} row=${row} /> <${Marks} row=${row} />
      </th>
      ${columns.map(({ cell }) => html`<td class="number">${cell(row)}</td>`)}
    </tr>`,
  );
}

/** @type {Column} */
const PLAYER = { key: "player", name: "Player", isUp: true, value: (row) => row.model.toLowerCase(), cell: () => null };

/**
 * The columns with a value for each row. Scores of these rows have one scale.
 * @param {any[]} rows @param {any} board @param {boolean} hasCosts @returns {Column[]}
 */
const columnsOf = (rows, board, hasCosts) => [...scores(rows, board), ...(hasCosts ? [COST] : []), ...FAILURES, ...metrics(board)];

/** Whether the cost of a row is known, at least in part. @param {any} row */
export const hasCost = ({ cost_usd = null }) => cost_usd !== null;

/** @type {Column} */
const COST = {
  key: "cost",
  name: "$ a game",
  about: "Mean cost of a game in US dollars; ≥ where the cost of some answers is unknown",
  isUp: true,
  value: ({ cost_usd = null }) => cost_usd,
  cell: ({ cost_usd = null, costs_are_whole }) => (cost_usd === null ? "–" : `${costs_are_whole ? "" : "≥ "}${dollars(cost_usd)}`),
};

/** @param {any[]} rows @param {any} board @returns {Column[]} */
function scores(rows, board) {
  const each = board.tasks.map((task) => ({ key: task, name: task, tasks: [task] }));
  // The total of a single task is its mean.
  const groups = each.length === 1 ? [{ ...each[0], key: "total" }] : [{ key: "total", name: "Total", tasks: board.tasks }, ...each];
  return groups.map(({ key, name, tasks }) => {
    const totals = new Map(rows.map((row) => [row, totalOf(row, tasks)]));
    const range = scale([...totals.values()]);
    const leader = key === board.sort && rows[0]?.rank ? totals.get(rows[0]) : null;
    const shared = { range, name, leader, hasBounds: key === "total" };
    const deviation = (row) => (tasks.length === 1 ? row.tasks[name]?.deviation : null);
    const cell = (row) => html`<${Score} of=${totals.get(row)} deviation=${deviation(row)} ...${shared} />`;
    return { key, name, value: (row) => totals.get(row)?.mean ?? null, cell };
  });
}

/** @type {Column[]} */
const FAILURES = [
  {
    key: "invalid",
    name: "Invalid",
    about: "Share of answers that could not be read",
    value: (row) => row.invalid_share,
    cell: ({ failures, invalid_share }) => {
      const why = failuresText(failures);
      return why ? html`<${Sign} about=${why}>${percent(invalid_share)}<//>` : percent(invalid_share);
    },
  },
  { key: "timeouts", name: "Timeouts", about: "Share of moves whose clock expired", value: (row) => row.timeout_share,
    cell: (row) => percent(row.timeout_share) },
];

/** @param {any} board @returns {Column[]} */
const metrics = ({ tasks, metrics }) =>
  tasks.flatMap((task) =>
    (metrics ?? []).map((metric) => {
      const value = (row) => row.metrics?.[task]?.[metric] ?? null;
      const name = tasks.length > 1 ? `${metricName(metric)}, ${task}` : metricName(metric);
      return { key: `${metric}.${task}`, name, about: METRICS[metric], value, cell: (row) => short(value(row)) };
    }),
  );

/**
 * Sorts rows by a column; rows without a value come last.
 * @param {any[]} rows @param {Column[]} columns @param {string} key
 */
function order(rows, columns, key) {
  const column = [PLAYER, ...columns].find((one) => one.key === key);
  if (!column) return rows;
  const sign = column.isUp ? 1 : -1;
  return rows.toSorted((a, b) => {
    const [x, y] = [column.value(a), column.value(b)];
    if (x === null || y === null) return Number(x === null) - Number(y === null);
    return x === y ? 0 : x < y ? -sign : sign;
  });
}

function Rank({ row }) {
  if (!isTied(row)) return row.rank ?? "–";
  const { mean, low, high } = row.difference;
  const why = `Not surely behind the nearest row above that was played here: ${short(mean)} lower, 95 % interval ${short(low)} to ${short(high)}.`;
  return html`<${Sign} about=${why}>≈<span class="unseen">order not sure, </span><//> ${row.rank ?? "–"}`;
}
