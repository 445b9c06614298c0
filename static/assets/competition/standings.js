// The board of a competition, as far as the server shows it.
import { html, useState } from "../ui.js";
import { route, withQuery } from "../api.js";
import { Interval, short } from "../parts/chart.js";
import { Download } from "../parts/download.js";
import { Choice } from "../parts/filters.js";
import { METRICS, metricName } from "../parts/metrics.js";
import { More, usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { useQuery } from "../parts/query.js";
import { seedsOf } from "../parts/rules.js";
import { OnSpareSeeds, failuresText } from "../parts/status.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

const REFRESH_MS = 15_000;

/** @param {{competition: any}} props */
export function Standings({ competition }) {
  const [query, change] = useQuery();
  const asked = { category: query.get("category") ?? "", part: query.get("part") ?? "" };
  return html`<${Filters} competition=${competition} ...${asked} change=${change} /><${Board} competition=${competition} ...${asked} />`;
}

/** Chooses the entrants of the board, and its seeds once these are shown. @param {{competition: any, category: string, part: string, change: (changes: Record<string, string>) => void}} props */
function Filters({ competition, category, part, change }) {
  const { categories, revealed_at } = competition;
  const { publicSeeds } = seedsOf(competition);
  const hasParts = publicSeeds > 0 && (revealed_at || part);
  if (categories.length === 0 && !hasParts) return null;
  return html`<div class="buttons" role="search" aria-label="Filters of the standings">
    ${categories.length > 0 && html`<${Choice} label="Category" value=${category} options=${categories} onChange=${(/** @type {string} */ category) => change({ category })} />`}
    ${hasParts &&
    html`<label>
      Board${" "}
      <select value=${part === "public" ? part : ""} onChange=${(/** @type {any} */ event) => change({ part: event.target.value })}>
        <option value="">final</option><option value="public">public, as before the end</option>
      </select>
    </label>`}
  </div>`;
}

/** The seeds of a board. @param {string} part @param {any} competition */
function partText(part, competition) {
  const { seeds, publicSeeds } = seedsOf(competition);
  const others = seeds - publicSeeds;
  if (part === "public") return `Public part: ${publicSeeds} of ${seeds} seeds. The rest is for the final board.`;
  if (part === "final") return `Final part: ${others} of ${seeds} seeds. The rest is for the board before the end.`;
  return "";
}

/** @param {{competition: any, category: string, part: string}} props */
function Board({ competition, category, part }) {
  const [metric, setMetric] = useState("");
  const base = route`/api/v1/competitions/${competition.id}/board`;
  const list = usePages(withQuery(base, { category, part, metrics: metric }), competition.revealed_at ? undefined : REFRESH_MS);
  if (!list.value) {
    return list.problem ? html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />` : html`<p class="muted" role="status">Loading …</p>`;
  }
  const { items, value: first } = list;
  const csv = withQuery(base, { category, part, format: "csv", metrics: metric });
  if (first.shows === "nothing") return html`<p class="empty">The board is hidden until the end.</p>`;
  if (items.length === 0) return html`<p class="empty">${first.category ? "Nobody has entered in this category." : "Nobody has entered."}</p>`;
  const hasAll = first.shows === "all";
  const hasCategories = competition.categories.length > 0;
  const tasks = hasAll ? (items.find((row) => row.tasks.length > 0)?.tasks.map(({ task }) => task) ?? []) : [];
  return html`
    <p class="muted" role="status">
      ${first.category && html`Category <${Text} value=${first.category} />: ranks among its entrants. `}
      ${partText(first.part, competition)}
    </p>
    <p class="muted">
      ${first.frozen_at && html`Frozen: attempts that were over before <${Time} value=${first.frozen_at} both />. `}
      ${!hasAll && "Totals only, until the seeds are revealed. A rank without a total: too few games count to show one."}
      ${hasAll && !competition.revealed_at && "Only organizers see this board before the end."}
    </p>
    ${hasAll &&
    html`<p>
      <label class="metric">
        Metric of each task
        <select value=${metric} onChange=${(/** @type {any} */ event) => setMetric(event.target.value)}>
          <option value="">none</option>
          ${Object.entries(METRICS).map(([name, what]) => html`<option value=${name}>${metricName(name)}: ${what}</option>`)}
        </select>
      </label>
    </p>`}
    <div class="scroll" tabindex="0" role="region" aria-label="Table of standings">
      <table class="standings">
        <thead>
          <tr>
            <th scope="col" class="number">Rank</th><th scope="col">Entrant</th>${hasCategories && html`<th scope="col">Category</th>`}<th scope="col">Model</th>
            <th scope="col" class="number">Total</th>
            ${tasks.map((task) => html`<th scope="col" class="number">${task}</th>`)}
            ${metric && tasks.map((task) => html`<th scope="col" class="number">${metricName(metric)}, ${task}</th>`)}
            ${hasAll && html`<th scope="col">Below the row above, 95 %</th>`}
            <th scope="col" class="number">Invalid</th><th scope="col" class="number">Timeouts</th><th scope="col" class="number">Attempts</th>
          </tr>
        </thead>
        <tbody>${items.map((row) => html`<${Row} key=${row.entrant.id} row=${row} tasks=${tasks} metric=${metric} hasAll=${hasAll} hasCategories=${hasCategories} scale=${scaleOf(items)} />`)}</tbody>
      </table>
    </div>
    <${More} list=${list} />
    <p class="buttons small"><${Download} href=${csv} name="board.csv">This board as CSV<//></p>
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

/** All intervals are drawn on one scale. @param {any[]} rows @returns {[number, number]} */
function scaleOf(rows) {
  const known = rows.map((row) => row.difference).filter((one) => one?.low !== undefined && one?.low !== null);
  const low = Math.min(0, ...known.map((one) => one.low));
  const high = Math.max(0, ...known.map((one) => one.high));
  return low === high ? [-1, 1] : [low, high];
}

/** @param {number | null} share */
const percent = (share) => (share === null ? "–" : `${(share * 100).toFixed(1)} %`);

/** @param {{difference: any, scale: [number, number]}} props */
function Below({ difference, scale }) {
  if (!difference) return "–";
  const { mean, low, high } = difference;
  if (low === undefined || low === null) return html`${short(mean)} <span class="muted small">too few seeds for an interval</span>`;
  const label = `${short(mean)}, from ${short(low)} to ${short(high)}`;
  return html`<${Interval} mean=${mean} low=${low} high=${high} range=${scale} label=${label} />${low < 0 && html` <span class="badge">tie</span>`}`;
}

/** @param {{row: any, tasks: string[], metric: string, hasAll: boolean, hasCategories: boolean, scale: [number, number]}} props */
function Row({ row, tasks, metric, hasAll, hasCategories, scale }) {
  const { entrant, difference } = row;
  const isOut = entrant.status !== "active";
  const meanOf = (/** @type {string} */ name) => row.tasks.find(({ task }) => task === name)?.mean;
  return html`<tr class=${isOut ? "out" : ""}>
    <td class="number">${row.rank ?? "–"}</td>
    <th scope="row">
      <${Text} value=${entrant.name} />${entrant.vouched && html` <span class="badge">vouched</span>`}
      ${isOut && html`<div class="small"><span class="badge">${entrant.status}</span> ${entrant.reason && html`<${Text} value=${entrant.reason} />`}</div>`}
    </th>
    ${hasCategories && html`<td><${Text} value=${entrant.category} /></td>`}
    <td><${Text} value=${entrant.model} /></td>
    <td class="number">${hasAll && row.run ? html`<a href=${route`/runs/${row.run}`}>${short(row.total)}</a>` : short(row.total)}${row.on_spare_seeds && html`<div><${OnSpareSeeds} /></div>`}</td>
    ${tasks.map((task) => html`<td class="number">${short(meanOf(task))}</td>`)}
    ${metric && tasks.map((task) => html`<td class="number">${short(row.metrics?.[task]?.[metric])}</td>`)}
    ${hasAll &&
    html`<td><${Below} difference=${difference} scale=${scale} /></td>`}
    <td class="number" title=${row.run ? failuresText(row.failures) : ""}>${percent(row.run ? row.invalid_share : null)}</td>
    <td class="number">${percent(row.run ? row.timeout_share : null)}</td>
    <td class="number">${row.attempts}${row.voided_attempts > 0 && ` (${row.voided_attempts} voided)`}</td>
  </tr>`;
}
