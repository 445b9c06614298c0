// The board of a competition, as far as the server shows it, the places of a key's own entrants on it, and all entrants.
import { html, useState } from "../ui.js";
import { route, withQuery } from "../api.js";
import { Interval, isTied, short } from "../parts/chart.js";
import { Download } from "../parts/download.js";
import { Choice, useFilters } from "../parts/filters.js";
import { Items, ListTable } from "../parts/listed.js";
import { useLoaded } from "../parts/load.js";
import { METRICS, metricName } from "../parts/metrics.js";
import { More, eachPage, usePages } from "../parts/pages.js";
import { Waiting } from "../parts/problem.js";
import { seedsOf } from "../parts/rules.js";
import { OnSpareSeeds, failuresText, percent } from "../parts/status.js";
import { Name, Text } from "../parts/text.js";
import { Time } from "../parts/time.js";
import { samplingText } from "../parts/words.js";

/** Pauses between readings of the first rows and of a whole board, and the maximum number of rows in an answer. */
const REFRESH_MS = 15_000;
const WHOLE_MS = 60_000;
const WHOLE_ROWS = 1000;

/** The number of rows that are shown at first, and with each request for more. */
const ROWS = 25;

/** @param {{id: string}} competition */
const boardOf = ({ id }) => route`/api/v1/competitions/${id}/board`;

/**
 * The rows of entrants on a whole board, wherever they stand, and how many have a rank.
 * @param {any} competition @param {any[]} own entrants @param {Record<string, string>} [query] of the board
 */
export function useOwnRows(competition, own, query = {}) {
  const ids = own.map(({ id }) => id);
  const load = async (/** @type {AbortSignal} */ signal) => {
    const all = [];
    let shows = "nothing";
    const read = (/** @type {any} */ page) => ((shows = page.shows), void all.push(...page.items));
    if (ids.length > 0) await eachPage(boardOf(competition), { ...query, limit: WHOLE_ROWS }, signal, read);
    const ranks = all.map(({ rank }) => rank).filter((rank) => rank !== null);
    const shared = (/** @type {any} */ row) => row.rank !== null && ranks.filter((rank) => rank === row.rank).length > 1;
    const rows = all.filter((row) => ids.includes(row.entrant.id)).map((row) => ({ ...row, isTied: shared(row) || Boolean(row.difference && isTied(row)) }));
    return { shows, rows, ranked: ranks.length };
  };
  return useLoaded(load, [competition.id, competition.phase, ids.join(), JSON.stringify(query)], competition.revealed_at ? undefined : WHOLE_MS).value;
}

/** @param {{competition: any, own: any[]}} props own: the entrants of the key of this tab */
export function Standings({ competition, own }) {
  const { values, of } = useFilters(["category", "part"]);
  const { categories, revealed_at } = competition;
  const hasParts = seedsOf(competition).publicSeeds > 0 && (revealed_at || values.part);
  // Seeds of the board can be chosen once they are shown.
  return html`
    ${(categories.length > 0 || hasParts) &&
    html`<div class="buttons" role="search" aria-label="Filters of the standings">
      ${categories.length > 0 && html`<${Choice} label="Category" options=${categories} ...${of("category")} />`}
      ${hasParts && html`<${Choice} label="Board" all="final" options=${[["public", "public, as before the end"]]} ...${of("part")} />`}
    </div>`}
    <${Board} competition=${competition} own=${own} ...${values} />
  `;
}

/** @param {{competition: any, own: any[], category: string, part: string}} props */
function Board({ competition, own, category, part }) {
  const [metric, setMetric] = useState("");
  const query = { category, part, metrics: metric };
  const list = usePages(withQuery(boardOf(competition), { ...query, limit: ROWS }), competition.revealed_at ? undefined : REFRESH_MS);
  const ownRows = useOwnRows(competition, own, query)?.rows ?? [];
  if (!list.value) return html`<${Waiting} of=${list} />`;
  const { items, value: first } = list;
  if (first.shows === "nothing") return html`<p class="empty">The board is hidden until the end.</p>`;
  if (items.length === 0) return html`<p class="empty">${first.category ? "Nobody has entered in this category." : "Nobody has entered."}</p>`;
  const hasAll = first.shows === "all";
  const { seeds, publicSeeds } = seedsOf(competition);
  const isOwn = (/** @type {any} */ { entrant }) => own.some(({ id }) => id === entrant.id);
  // Own rows that are not loaded yet stand below the others, apart from the last of them.
  const below = ownRows.filter((row) => !items.some((shown) => shown.entrant.id === row.entrant.id));
  const look = (/** @type {any} */ row, /** @type {number} */ place) =>
    [row.entrant.status !== "active" && "out", isOwn(row) && "own", place === items.length && "apart"].filter(Boolean).join(" ");
  return html`
    <p class="muted" role="status">
      ${first.category && html`Category <${Text} value=${first.category} />: ranks among its entrants. `}
      ${first.part === "public" && `Public part: ${publicSeeds} of ${seeds} seeds. The rest is for the final board.`}
      ${first.part === "final" && `Final part: ${seeds - publicSeeds} of ${seeds} seeds. The rest is for the board before the end.`}
    </p>
    <p class="muted">
      ${first.frozen_at && html`Frozen: attempts that were over before <${Time} value=${first.frozen_at} both />. `}
      ${!hasAll && "Totals only, until the seeds are revealed. A rank without a total: too few games count to show one."}
      ${hasAll && !competition.revealed_at && "Others see totals only before the end."}
    </p>
    ${hasAll && html`<p class="metric"><${Choice} label="Metric of each task" value=${metric} all="none" onChange=${setMetric}
      options=${Object.entries(METRICS).map(([name, what]) => [name, `${metricName(name)}: ${what}`])} /></p>`}
    <${Items} items=${[...items, ...below]} label="Table of standings" name="standings" header=${1} look=${look} keyOf=${({ entrant }) => entrant.id}
      columns=${columnsOf({ items, isOwn, hasAll, hasCategories: competition.categories.length > 0, metric })} />
    <${More} list=${list} />
    <p class="buttons small"><${Download} href=${withQuery(boardOf(competition), { category, part, format: "csv", metrics: metric })} name="board.csv">This board as CSV<//></p>
    <details class="small">
      <summary>What the columns mean</summary>
      <ul>
        <li>Total: the sum of the means of all tasks, in the attempt that counts.</li>
        <li>Below the row above: how much lower the total is, with an interval of 95 %. An interval that reaches 0 is a tie.</li>
        <li>Invalid, timeouts: shares of answers that could not be read, and of moves whose clock ran out.</li>
        <li>Vouched: an organizer knows that the declared model plays. All other models are declared by the entrant alone.</li>
        <li>An entrant holds all agents of its games, so it can combine what they see.</li>
      </ul>
    </details>
  `;
}

/**
 * @param {{items: any[], isOwn: (row: any) => boolean, hasAll: boolean, hasCategories: boolean, metric: string}} board hasAll: it shows more
 *   than totals
 */
function columnsOf({ items, isOwn, hasAll, hasCategories, metric }) {
  const tasks = hasAll ? (items.find((row) => row.tasks.length > 0)?.tasks.map(({ task }) => task) ?? []) : [];
  const scale = scaleOf(items);
  const total = (/** @type {any} */ row) => html`${hasAll && row.run ? html`<a href=${route`/runs/${row.run}`}>${short(row.total)}</a>` : short(row.total)}
    ${row.on_spare_seeds && html`<div><${OnSpareSeeds} /></div>`}`;
  return [
    ["#Rank", (row) => row.rank ?? "–"],
    ["Entrant and model", (row) => html`<${Player} entrant=${row.entrant} isOwn=${isOwn(row)} />`],
    ["#Total", total],
    hasCategories && ["Category", (row) => html`<${Text} value=${row.entrant.category} />`],
    ...tasks.map((task) => [`#${task}`, (row) => short(row.tasks.find((one) => one.task === task)?.mean)]),
    ...(metric ? tasks.map((task) => [`#${metricName(metric)}, ${task}`, (row) => short(row.metrics?.[task]?.[metric])]) : []),
    hasAll && ["Below the row above, 95 %", (row) => html`<${Below} difference=${row.difference} scale=${scale} />`],
    ["#Invalid", (row) => html`<span title=${row.run ? failuresText(row.failures) : ""}>${percent(row.run ? row.invalid_share : null)}</span>`],
    ["#Timeouts", (row) => percent(row.run ? row.timeout_share : null)],
    ["#Attempts", (row) => html`${row.attempts}${row.voided_attempts > 0 && ` (${row.voided_attempts} voided)`}`],
  ];
}

/** @param {{entrant: any, isOwn: boolean}} props */
const Player = ({ entrant: { name, model, status, reason, vouched }, isOwn }) => html`<${Name} value=${name} />
  ${isOwn && html` <span class="badge">yours</span>`}${vouched && html` <span class="badge">vouched</span>`}
  <div class="small muted"><${Name} value=${model} /></div>
  ${status !== "active" && html`<div class="small"><span class="badge">${status}</span> ${reason && html`<${Text} value=${reason} />`}</div>`}`;

/** All intervals are drawn on one scale. @param {any[]} rows @returns {[number, number]} */
function scaleOf(rows) {
  const known = rows.map((row) => row.difference).filter((one) => one?.low !== undefined && one?.low !== null);
  const low = Math.min(0, ...known.map((one) => one.low));
  const high = Math.max(0, ...known.map((one) => one.high));
  return low === high ? [-1, 1] : [low, high];
}

/** @param {{difference: any, scale: [number, number]}} props */
function Below({ difference, scale }) {
  if (!difference) return "–";
  const { mean, low, high } = difference;
  if (low === undefined || low === null) return html`${short(mean)} <span class="muted small">too few seeds for an interval</span>`;
  const label = `${short(mean)}, from ${short(low)} to ${short(high)}`;
  return html`<${Interval} mean=${mean} low=${low} high=${high} range=${scale} label=${label} />${low < 0 && html` <span class="badge">tie</span>`}`;
}

/** All entrants. @param {{list: ReturnType<typeof usePages>, hasCategories: boolean, own: any[]}} props own: those of the key of this tab */
export function Entrants({ list, hasCategories, own }) {
  const name = (/** @type {any} */ one) => html`<${Name} value=${one.name} />
    ${own.some(({ id }) => id === one.id) && html` <span class="badge">yours</span>`}
    ${one.status !== "active" && html` <span class="badge">${one.status}</span>`}`;
  return html`<${ListTable} list=${list} label="Table of entrants" empty="Nobody has entered." look=${(one) => one.status !== "active" && "out"} columns=${[
    ["Name", name],
    hasCategories && ["Category", (one) => html`<${Text} value=${one.category} />`],
    ["Model, as declared", (one) => html`<${Name} value=${one.model} />${one.vouched && html` <span class="badge">vouched</span>`}`],
    ["Sampling", (one) => samplingText(one) || "–"],
    ["Prompt", (one) => (one.prompt_template ? html`its own, <code>${one.prompt_template}</code>` : "built-in")],
    ["Entered", (one) => html`<${Time} value=${one.registered_at} />`],
  ]} />`;
}
