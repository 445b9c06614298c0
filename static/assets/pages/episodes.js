// All games that the reader may see, running ones first.
import { html, useState } from "../ui.js";
import { route, withQuery } from "../api.js";
import { short } from "../parts/chart.js";
import { Choice, Exact } from "../parts/filters.js";
import { More, usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { useQuery, useTitle } from "../parts/query.js";
import { TASKS } from "../parts/tasks.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

const STATUSES = ["waiting", "running", "finished", "aborted", "abandoned"];

/** The interval between reads of running games. */
const LIVE_MS = 5000;

/** The number of games that are compared. */
const COMPARED = 2;

/** The number of games per page. */
const PAGE_ITEMS = 50;

/** The filters of the address. */
const FILTERS = ["task", "status", "model", "run"];

export function Page() {
  const [query, change] = useQuery();
  const filters = Object.fromEntries(FILTERS.map((name) => [name, query.get(name) ?? ""]));
  const [chosen, setChosen] = useState(/** @type {string[]} */ ([]));
  useTitle("Games");
  /** @param {string} id */
  const choose = (id) => setChosen((chosen) => (chosen.includes(id) ? chosen.filter((one) => one !== id) : [...chosen, id].slice(-COMPARED)));
  const isOfAll = filters.status === "";
  return html`
    <h1>Games</h1>
    <div class="buttons" role="search" aria-label="Filters">
      <${Choice} label="Task" value=${filters.task} options=${TASKS} onChange=${(/** @type {string} */ value) => change({ task: value })} />
      <${Choice} label="Status" value=${filters.status} options=${STATUSES} onChange=${(/** @type {string} */ value) => change({ status: value })} />
      <${Exact} label="Model" value=${filters.model} onChange=${(/** @type {string} */ value) => change({ model: value })} />
      <a href="/imports">Imported games</a>
    </div>
    <p class="buttons" aria-live="polite">
      ${chosen.length === COMPARED
        ? html`<a href=${withQuery("/compare", { a: chosen[0], b: chosen[1] })}>Compare the two chosen games</a> <button type="button" class="quiet" onClick=${() => setChosen([])}>Choose others</button>`
        : html`<span class="muted">${chosen.length ? "Choose one more to compare the two." : "Choose two to compare them."}</span>`}
    </p>
    ${isOfAll && html`<${Live} filters=${filters} chosen=${chosen} onChoose=${choose} />`}
    <${All} filters=${filters} chosen=${chosen} onChoose=${choose} />
  `;
}

/** @typedef {{filters: Record<string, string>, chosen: string[], onChoose: (id: string) => void}} Props */

/** Games that run now; nothing where there are none. @param {Props} props */
function Live({ filters, chosen, onChoose }) {
  const list = usePages(withQuery("/api/v1/episodes", { ...filters, status: "running", limit: PAGE_ITEMS }), LIVE_MS);
  if (!list.items.length) return null;
  return html`<h2>Live</h2><${Games} games=${list.items} label="Live games" chosen=${chosen} onChoose=${onChoose} /><${More} list=${list} />`;
}

/** @param {Props} props */
function All({ filters, chosen, onChoose }) {
  const isOfAll = filters.status === "";
  const address = withQuery("/api/v1/episodes", { ...filters, limit: PAGE_ITEMS });
  const list = usePages(address, isOfAll || filters.status === "running" ? LIVE_MS : undefined);
  const games = list.value && list.items.filter((game) => !isOfAll || game.status !== "running");
  return html`
    <h2>${isOfAll ? "Ended and waiting" : filters.status}</h2>
    ${list.problem && html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`}
    ${!games && !list.problem && html`<p class="muted" role="status">Loading …</p>`}
    ${games && games.length === 0 && !list.hasMore && html`<${Empty} isFiltered=${Object.values(filters).some(Boolean)} />`}
    ${games && games.length > 0 && html`<${Games} games=${games} label="Games" chosen=${chosen} onChoose=${onChoose} />`}
    <${More} list=${list} />
  `;
}

/** @param {{isFiltered: boolean}} props */
const Empty = ({ isFiltered }) =>
  isFiltered
    ? html`<p class="empty">No game fits these filters. Choose others.</p>`
    : html`<p class="empty">No game has ended yet, or none that can be read without a key. <a href="/play">Play one</a>, or start one with <code>swarmbench play --task Pursuit</code>.</p>`;

/** @param {{games: any[], label: string, chosen: string[], onChoose: (id: string) => void}} props */
const Games = ({ games, label, chosen, onChoose }) => html`<div class="scroll" tabindex="0" role="region" aria-label=${label}>
  <table>
    <thead>
      <tr>
        <th scope="col">Compare</th><th scope="col">Game</th><th scope="col">Model</th><th scope="col" class="number">Seed</th>
        <th scope="col" class="number">Score</th><th scope="col" class="number">Round</th><th scope="col">Status</th><th scope="col">Created</th>
      </tr>
    </thead>
    <tbody>
      ${games.map(
        (game) => html`<tr key=${game.id}>
          <td><input type="checkbox" aria-label=${`Compare ${game.task} ${game.id}`} checked=${chosen.includes(game.id)} onChange=${() => onChoose(game.id)} /></td>
          <td><a href=${route`/episodes/${game.id}`}>${game.task}<span class="unseen"> ${game.id}</span></a></td>
          <td><${Text} value=${game.model} /></td>
          <td class="number">${game.config?.seed ?? "–"}</td>
          <td class="number">${short(game.score)}</td>
          <td class="number">${game.round}/${game.config?.max_round ?? "–"}</td>
          <td>${game.void_reason ? "voided" : game.status}</td>
          <td><${Time} value=${game.created_at} /></td>
        </tr>`,
      )}
    </tbody>
  </table>
</div>`;
