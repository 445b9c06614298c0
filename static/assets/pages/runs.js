// All runs, newest first.
import { html } from "../ui.js";
import { request, route, withQuery } from "../api.js";
import { SuiteLink } from "../parts/boards.js";
import { alike } from "../parts/chart.js";
import { Copyable } from "../parts/copy.js";
import { Choice, Filters, Model, Named, useFilters } from "../parts/filters.js";
import { ListTable } from "../parts/listed.js";
import { useLoaded } from "../parts/load.js";
import { PAGE_ITEMS, usePages } from "../parts/pages.js";
import { useTitle } from "../parts/query.js";
import { Status } from "../parts/status.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

const POLL_MS = 10_000;
const STATUSES = ["running", "finished", "aborted", "abandoned", "closed"];

export function Page() {
  const filters = useFilters(["status", "model", "suite"]);
  const list = usePages(withQuery("/api/v1/runs", { ...filters.values, limit: PAGE_ITEMS }), POLL_MS);
  const builtIn = useLoaded((signal) => request("/api/v1/suites", { signal }), []);
  const suites = [...new Set([...(builtIn.value?.items ?? []), ...list.items.map((run) => run.suite)].map((suite) => suite.name))];
  const total = alike(list.items.map((run) => run.total));
  useTitle("Runs");
  const columns = [
    ["Model", ({ id, model }) => html`<a href=${route`/runs/${id}`}><${Text} value=${model} /></a>`],
    ["Suite", (run) => html`<${SuiteLink} run=${run} />`],
    ["#Total", (run) => total(run.total)],
    ["Status", (run) => html`<${Status} status=${run.status} of="run" />${run.void_reason !== null && html` <span class="badge bad">voided</span>`}`],
    ["#Games", ({ played, planned }) => `${played}/${planned}`],
    ["Rules", ({ suite }) => suite.rules],
    ["Started", (run) => html`<${Time} value=${run.created_at} />`],
  ];
  const empty = filters.isFiltered
    ? "No run fits. Names must be complete, and in the same letters."
    : html`There are no runs yet, or none that can be read without a key. This starts one with built-in players:${" "}
        <${Copyable} label="the command" value=${`swarmbench play --suite quick --server ${location.origin}`} />`;
  return html`
    <h1>Runs</h1>
    <p class="muted">A run is one model, or a team, that plays all games of a suite.</p>
    <${Filters} filters=${filters}>
      <${Choice} label="Status" options=${STATUSES} ...${filters.of("status")} />
      <${Model} ...${filters.of("model")} />
      <${Named} label="Suite" names=${suites} ...${filters.of("suite")} />
    <//>
    <${ListTable} label="Runs" list=${list} columns=${columns} empty=${empty} />
  `;
}
