// Games that were imported from files.
import { html } from "../ui.js";
import { route, withQuery } from "../api.js";
import { alike } from "../parts/chart.js";
import { Choice, Filters, Named, useFilters } from "../parts/filters.js";
import { ListTable } from "../parts/listed.js";
import { PAGE_ITEMS, usePages } from "../parts/pages.js";
import { useTitle } from "../parts/query.js";
import { TASKS } from "../parts/tasks.js";
import { Name, Text } from "../parts/text.js";

export function Page() {
  const filters = useFilters(["task", "model"]);
  const list = usePages(withQuery("/api/v1/imports", { ...filters.values, limit: PAGE_ITEMS }));
  const score = alike(list.items.map((game) => game.score));
  useTitle("Imported games");
  const game = ({ id, task }) =>
    html`<a href=${route`/imports/${id}`}><${Text} value=${task} /><span class="unseen"> ${id}</span></a> <span class="badge">imported</span>`;
  const columns = [
    ["Game", game],
    ["Model", ({ model }) => html`<${Name} value=${model} />`],
    ["#Score", (game) => score(game.score)],
    ["#Rounds", ({ rounds }) => rounds ?? "–"],
    ["#Seed", ({ seed }) => seed ?? "–"],
    ["Run", ({ run_id }) => html`<${Name} value=${run_id} />`],
  ];
  const empty = filters.isFiltered
    ? "No imported game fits these filters. Choose others."
    : html`There are none, or none that can be read without a key. Who runs this server imports games with <code>swarmbench import FOLDER</code>.`;
  return html`
    <h1>Imported games</h1>
    <p>They were read from files of others with <code>swarmbench import</code>. They have no journal, so they cannot be verified.</p>
    <${Filters} filters=${filters}>
      <${Choice} label="Task" options=${TASKS} ...${filters.of("task")} />
      <${Named} label="Model" names=${[...new Set(list.items.map((game) => game.model))]} ...${filters.of("model")} />
      <a href="/episodes">Games of this server</a>
    <//>
    <${ListTable} label="Imported games" list=${list} columns=${columns} header=${-1} empty=${empty} />
  `;
}
