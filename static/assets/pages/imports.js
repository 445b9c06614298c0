// Games that were imported from files.
import { html, useEffect } from "../ui.js";
import { route } from "../api.js";
import { short } from "../parts/chart.js";
import { Choice, Exact, MoreButton, TASKS, useFilters, useList } from "../parts/more.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";

/** @param {{query: URLSearchParams}} props */
export function Page({ query }) {
  const [filters, set] = useFilters(query, ["task", "model"]);
  const list = useList("/api/v1/imports", filters);
  useEffect(() => void (document.title = "Imported games · swarmbench"), []);
  return html`
    <h1>Imported games</h1>
    <p>They were read from files of others with <code>swarmbench import</code>. They have no journal, so they cannot be verified.</p>
    <div class="buttons" role="search" aria-label="Filters">
      <${Choice} label="Task" value=${filters.task} options=${TASKS} onChange=${(/** @type {string} */ value) => set("task", value)} />
      <${Exact} label="Model" value=${filters.model} onChange=${(/** @type {string} */ value) => set("model", value)} />
      <a href="/episodes">Games of this server</a>
    </div>
    ${list.problem && html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`}
    ${!list.items && !list.problem && html`<p class="muted" role="status">Loading …</p>`}
    ${list.items?.length === 0 && html`<p class="empty">There are none, or none that can be read without a key. Who runs this server imports games with <code>swarmbench import FOLDER</code>.</p>`}
    ${list.items && list.items.length > 0 && html`<${Imports} games=${list.items} />`}
    <${MoreButton} list=${list} />
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
