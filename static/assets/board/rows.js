// The table of a board.
import { html } from "../ui.js";
import { Text } from "../parts/text.js";
import { short } from "../parts/chart.js";
import { interval } from "../parts/statistics.js";
import { METRICS, metricName } from "../parts/metrics.js";
import { failuresText, percent } from "../parts/status.js";
import { Marks, Score, Settings, isTied, samples, scale } from "../parts/rows.js";

/**
 * @typedef {object} Column
 * @property {string} key what the address calls it
 * @property {string} name
 * @property {string} [about]
 * @property {boolean} [isUp] whether it is sorted from the lowest
 * @property {(row: any) => number | string | null} value by which rows are sorted
 * @property {(row: any) => any} cell
 */

/** @param {{rows: any[], board: any, wanted: {sort: string}, sortBy: (key: string) => void}} props */
export function Rows({ rows, board, wanted, sortBy }) {
  const columns = [...scores(rows, board), ...failures(), ...metrics(board)];
  const isByServer = wanted.sort === board.sort;
  const sorted = isByServer ? rows : order(rows, columns, wanted.sort);
  return html`<div class="scroll" tabindex="0" role="region" aria-label="Rows of the board">
    <table class="board">
      <thead>
        <tr>
          <th scope="col" class="number">Rank</th>
          <${Head} column=${PLAYER} sort=${wanted.sort} sortBy=${sortBy} />
          ${columns.map((column) => html`<${Head} column=${column} sort=${wanted.sort} sortBy=${sortBy} isNumber />`)}
        </tr>
      </thead>
      <tbody>
        ${sorted.map(
          (row, index) => html`<tr key=${row.id} class=${isByServer && (isTied(row) || isSame(row, sorted[index - 1])) ? "tied" : ""}>
            <td class="number"><${Rank} row=${row} /></td>
            <th scope="row" class="player"><${Player} row=${row} board=${board} /></th>
            ${columns.map((column) => html`<td class="number">${column.cell(row)}</td>`)}
          </tr>`,
        )}
      </tbody>
    </table>
  </div>`;
}

/** Whether two rows share a rank. @param {any} row @param {any} before */
const isSame = (row, before) => row.rank !== null && row.rank === before?.rank;

/** @type {Column} */
const PLAYER = { key: "player", name: "Player", isUp: true, value: (row) => row.model.toLowerCase(), cell: () => null };

/** @param {{column: Column, sort: string, sortBy: (key: string) => void, isNumber?: boolean}} props */
const Head = ({ column, sort, sortBy, isNumber }) => {
  const isSorted = sort === column.key;
  return html`<th
    scope="col"
    class=${isNumber ? "number" : ""}
    aria-sort=${isSorted ? (column.isUp ? "ascending" : "descending") : undefined}
    title=${column.about}
  >
    <button type="button" onClick=${() => sortBy(column.key)}>
      ${column.name}<span aria-hidden="true">${isSorted ? (column.isUp ? " ▲" : " ▼") : ""}</span>
    </button>
  </th>`;
};

/** @param {any[]} rows @param {any} board @returns {Column[]} */
function scores(rows, board) {
  /** @type {string[]} */
  const tasks = board.tasks;
  const each = tasks.map((task) => ({ key: task, name: task, tasks: [task] }));
  // The total of a single task is its mean.
  const groups = tasks.length === 1 ? [{ ...each[0], key: "total" }] : [{ key: "total", name: "Total", tasks }, ...each];
  return groups.map(({ key, name, tasks }) => {
    const intervals = new Map(rows.map((row) => [row, interval(samples(row, tasks))]));
    const of = (/** @type {any} */ row) => intervals.get(row) ?? null;
    const range = scale([...intervals.values()]);
    const leader = key === board.sort && rows[0]?.rank ? of(rows[0]) : null;
    return {
      key,
      name,
      value: (row) => of(row)?.mean ?? null,
      cell: (row) => html`<${Score} of=${of(row)} deviation=${tasks.length === 1 ? row.tasks[name]?.deviation : null} range=${range} name=${name} leader=${leader} />`,
    };
  });
}

/** @returns {Column[]} */
const failures = () => [
  {
    key: "invalid",
    name: "Invalid",
    about: "Share of answers that could not be read",
    value: (row) => row.invalid_share,
    cell: (row) => html`<span title=${failuresText(row.failures)}>${percent(row.invalid_share)}</span>`,
  },
  {
    key: "timeouts",
    name: "Timeouts",
    about: "Share of moves whose clock expired",
    value: (row) => row.timeout_share,
    cell: (row) => percent(row.timeout_share),
  },
];

/** @param {any} board @returns {Column[]} */
const metrics = (board) =>
  board.tasks.flatMap((/** @type {string} */ task) =>
    (board.metrics ?? []).map((/** @type {string} */ metric) => {
      const value = (/** @type {any} */ row) => row.metrics?.[task]?.[metric] ?? null;
      return {
        key: `${metric}.${task}`,
        name: board.tasks.length > 1 ? `${metricName(metric)}, ${task}` : metricName(metric),
        about: METRICS[metric],
        value,
        cell: (/** @type {any} */ row) => short(value(row)),
      };
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
  return [...rows].sort((a, b) => {
    const [x, y] = [column.value(a), column.value(b)];
    if (x === null || y === null) return Number(x === null) - Number(y === null);
    return x === y ? 0 : x < y ? -sign : sign;
  });
}

/** @param {{row: any}} props */
function Rank({ row }) {
  if (!isTied(row)) return row.rank ?? "–";
  const { mean, low, high } = row.difference;
  const why = `Not surely behind the row above: ${short(mean)} lower, 95 % interval ${short(low)} to ${short(high)}`;
  return html`<abbr class="tie" title=${why}>≈<span class="unseen">order not sure, </span></abbr> ${row.rank ?? "–"}`;
}

/** @param {{row: any, board: any}} props */
const Player = ({ row, board }) => {
  const suite = `${board.suite}@${board.digest}`;
  const query = row.imported ? "?imported=true&" : "?";
  const href = `/board/${encodeURIComponent(suite)}/${encodeURIComponent(row.id)}${query}rules=${encodeURIComponent(board.rules)}`;
  return html`<a href=${href}><${Text} value=${row.model} /></a> <${Settings} row=${row} /> <${Marks} row=${row} />`;
};
