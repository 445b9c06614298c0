// Games that were imported from files.
import { html } from "../ui.js";
import { route, withQuery } from "../api.js";
import { short } from "../parts/chart.js";
import { Choice, Exact } from "../parts/filters.js";
import { More, usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { useQuery, useTitle } from "../parts/query.js";
import { TASKS } from "../parts/tasks.js";
import { Text } from "../parts/text.js";

/** The number of games per page. */
const PAGE_ITEMS = 50;

export function Page() {
  const [query, change] = useQuery();
  const [task, model] = [query.get("task") ?? "", query.get("model") ?? ""];
  const list = usePages(withQuery("/api/v1/imports", { task, model, limit: PAGE_ITEMS }));
  const games = list.value && list.items;
  useTitle("Imported games");
  return html`
    <h1>Imported games</h1>
    <p>They were read from files of others with <code>swarmbench import</code>. They have no journal, so they cannot be verified.</p>
    <div class="buttons" role="search" aria-label="Filters">
      <${Choice} label="Task" value=${task} options=${TASKS} onChange=${(/** @type {string} */ value) => change({ task: value })} />
      <${Exact} label="Model" value=${model} onChange=${(/** @type {string} */ value) => change({ model: value })} />
      <a href="/episodes">Games of this server</a>
    </div>
    ${list.problem && html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`}
    ${!games && !list.problem && html`<p class="muted" role="status">Loading …</p>`}
    ${games?.length === 0 && html`<p class="empty">There are none, or none that can be read without a key. Who runs this server imports games with <code>swarmbench import FOLDER</code>.</p>`}
    ${games && games.length > 0 && html`<${Imports} games=${games} />`}
    <${More} list=${list} />
  `;
}

/** @param {{games: any[]}} props */
const Imports = ({ games }) => html`<div class="scroll" tabindex="0" role="region" aria-label="Imported games">
  <table>
    <thead>
      <tr>
        <th scope="col">Game</th><th scope="col">Model</th><th scope="col">Run</th><th scope="col" class="number">Seed</th>
        <th scope="col" class="number">Score</th><th scope="col" class="number">Rounds</th>
      </tr>
    </thead>
    <tbody>
      ${games.map(
        (game) => html`<tr key=${game.id}>
          <td><a href=${route`/imports/${game.id}`}><${Text} value=${game.task} /><span class="unseen"> ${game.id}</span></a></td>
          <td><${Text} value=${game.model} /></td>
          <td><${Text} value=${game.run_id} /></td>
          <td class="number">${game.seed ?? "–"}</td>
          <td class="number">${short(game.score)}</td>
          <td class="number">${game.rounds ?? "–"}</td>
        </tr>`,
      )}
    </tbody>
  </table>
</div>`;
