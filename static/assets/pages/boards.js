// All boards: a row per suite and rule set, with its leaders.
import { html, useMemo } from "../ui.js";
import { request, withQuery } from "../api.js";
import { Leaders, Sign, arrange, boardHref, useLeaders } from "../parts/boards.js";
import { Commands } from "../parts/copy.js";
import { Download } from "../parts/download.js";
import { Items } from "../parts/listed.js";
import { useLoaded } from "../parts/load.js";
import { More, PAGE_ITEMS, usePages } from "../parts/pages.js";
import { Waiting } from "../parts/problem.js";
import { Table } from "../parts/table.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

/** The number of leaders shown per board. */
const LEADERS = 3;

export function Page() {
  const builtIn = useLoaded((signal) => request("/api/v1/suites", { signal }), []);
  const runs = usePages(withQuery("/api/v1/runs", { limit: PAGE_ITEMS }));
  const boards = useMemo(() => arrange(builtIn.value?.items ?? [], runs.items), [builtIn.value, runs.items.length]);
  return html`
    <h1>Boards</h1>
    <p class="muted">
      A board compares runs of one suite by one rule set: the same tasks, seeds and settings. ${" "}
      <strong>paper</strong> are the rules of the SwarmBench paper, <strong>reference</strong> those of its public toolkit.
    </p>
    ${builtIn.value && runs.value
      ? html`<${Table} label="Boards" name="boards" heads=${["Suite", "Rules", "Leaders", "Games", "#Rows", "Newest run"]}>
          <tbody>${boards.map((board) => html`<${Board} key=${board.suite.digest} ...${board} />`)}</tbody>
        <//>`
      : html`<${Waiting} of=${{ problem: builtIn.problem ?? runs.problem, reload: () => (builtIn.reload(), runs.reload()) }} />`}
    ${runs.hasMore &&
    html`<p>
      <button type="button" onClick=${runs.loadMore} disabled=${runs.isLoadingMore}>Look for older boards</button> ${" "}
      <span class="muted">Suites of the newest ${runs.items.length} runs are shown.</span>
    </p>`}
    <${Together} />
    <h2>A board of your own</h2>
    <p>A run of any suite makes its board. A suite is a name, tasks, seeds and settings:</p>
    <${Commands} label="Command" what="the command"
      lines=${[`swarmbench eval --task Pursuit --seeds 0..5 --player all --server ${location.origin}`]} />
  `;
}

/** @param {{suite: any, newest: string | null}} props */
function Board({ suite, newest }) {
  const leaders = useLeaders(suite, LEADERS);
  const [tasks, seeds] = [suite.tasks, suite.seeds?.length ?? 0];
  return html`<tr>
    <th scope="row"><a href=${boardHref(suite)}><${Text} value=${suite.name} /></a></th>
    <td>${suite.rules}</td>
    <td><${Leaders} of=${leaders} /></td>
    <td>${tasks.length === 1 ? tasks[0] : `${tasks.length} tasks`} × ${seeds === 1 ? "1 seed" : `${seeds} seeds`}</td>
    <td class="number">${leaders.value?.rows ?? "…"}</td>
    <td><${Time} value=${newest} /></td>
  </tr>`;
}

/** Models that played together in one swarm. */
function Together() {
  const list = usePages(withQuery("/api/v1/cross-play", { limit: PAGE_ITEMS }));
  if (list.items.length === 0) return null;
  const models = ({ models: [one, other], vouched }) => html`<${Text} value=${one} /> and <${Text} value=${other} />
    ${!vouched && html` <${Sign} about="In some of the games only its holder says that this was the model.">unconfirmed<//>`}`;
  const setting = ({ settings: { num_agents, width, height, control } }) => `${num_agents} agents, ${width} × ${height}, ${control}`;
  const columns = [
    ["Models", models],
    ["Task", ({ task, rules }) => `${task}, rules ${rules}`],
    ["Setting", setting],
    ["#Games", ({ games }) => games],
    ["#Mean ± deviation", ({ mean, deviation }) => html`${mean.toFixed(2)} <span class="muted small">± ${deviation.toFixed(2)}</span>`],
  ];
  return html`
    <h2>Played together</h2>
    <p class="muted">
      Pairs of models with seats in the same games. All agents share one score, so it is that of the whole swarm.${" "}
      <${Download} href="/api/v1/cross-play?format=csv" name="together.csv">CSV<//>
    </p>
    <${Items} label="Models that played together" columns=${columns} items=${list.items} />
    <${More} list=${list} />
  `;
}
