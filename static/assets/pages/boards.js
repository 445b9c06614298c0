// All boards: a row per suite and rule set, with its leaders.
import { html, useMemo } from "../ui.js";
import { request, withQuery } from "../api.js";
import { PAGE_ITEMS, usePages } from "../parts/pages.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { Together } from "../boards/together.js";
import { Text } from "../parts/text.js";
import { Commands } from "../parts/copy.js";
import { Leaders, arrange, boardHref, useLeaders } from "../parts/boards.js";
import { Time } from "../parts/time.js";

/** The number of leaders shown per board. */
const LEADERS = 3;

export function Page() {
  const builtIn = useLoaded((signal) => request("/api/v1/suites", { signal }), []);
  const runs = usePages(withQuery("/api/v1/runs", { limit: PAGE_ITEMS }));
  const boards = useMemo(() => {
    // Attempts are on the board of their competition.
    const counted = runs.items.filter((run) => run.attempt === null);
    return arrange(builtIn.value?.items ?? [], counted);
  }, [builtIn.value, runs.items.length]);
  const problem = builtIn.problem ?? runs.problem;
  const isLoaded = builtIn.value && runs.value;
  return html`
    <h1>Boards</h1>
    <p class="muted">
      A board compares runs of one suite by one rule set: the same tasks, seeds and settings. ${" "}
      <strong>paper</strong> are the rules of the SwarmBench paper, <strong>reference</strong> those of its public toolkit.
    </p>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${() => (builtIn.reload(), runs.reload())} />`}
    ${isLoaded ? html`<${Boards} boards=${boards} />` : !problem && html`<p class="muted" role="status">Loading …</p>`}
    ${runs.hasMore &&
    html`<p>
      <button type="button" onClick=${runs.loadMore} disabled=${runs.isLoadingMore}>Look for older boards</button> ${" "}
      <span class="muted">Suites of the newest ${runs.items.length} runs are shown.</span>
    </p>`}
    <${Together} />
    <h2>A board of your own</h2>
    <p>A run of any suite makes its board. A suite is a name, tasks, seeds and settings:</p>
    <${Commands} label="Command" what="the command" lines=${[`swarmbench eval --task Pursuit --seeds 0..5 --player all --server ${location.origin}`]} />
  `;
}

/** @param {{boards: {suite: any, newest: string | null}[]}} props */
const Boards = ({ boards }) => html`<div class="scroll" tabindex="0" role="region" aria-label="Boards">
  <table class="boards">
    <thead>
      <tr>
        <th scope="col">Suite</th>
        <th scope="col">Rules</th>
        <th scope="col">Games</th>
        <th scope="col" class="number">Rows</th>
        <th scope="col">Leaders</th>
        <th scope="col">Newest run</th>
      </tr>
    </thead>
    <tbody>
      ${boards.map((board) => html`<${Board} key=${board.suite.digest} ...${board} />`)}
    </tbody>
  </table>
</div>`;

/** @param {{suite: any, newest: string | null}} props */
function Board({ suite, newest }) {
  const leaders = useLeaders(suite, LEADERS);
  const seeds = suite.seeds?.length ?? 0;
  return html`<tr>
    <th scope="row"><a href=${boardHref(suite)}><${Text} value=${suite.name} /></a></th>
    <td>${suite.rules}</td>
    <td>${suite.tasks.length === 1 ? suite.tasks[0] : `${suite.tasks.length} tasks`} × ${seeds === 1 ? "1 seed" : `${seeds} seeds`}</td>
    <td class="number">${leaders.value?.rows ?? "…"}</td>
    <td><${Leaders} of=${leaders} /></td>
    <td><${Time} value=${newest} /></td>
  </tr>`;
}
