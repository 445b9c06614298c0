// All runs, newest first.
import { html } from "../ui.js";
import { route, withQuery } from "../api.js";
import { Commands } from "../parts/copy.js";
import { PAGE_ITEMS, More, usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";
import { short } from "../parts/chart.js";
import { Status } from "../parts/status.js";
import { useQuery } from "../parts/query.js";

const POLL_MS = 10_000;
const STATUSES = ["running", "finished", "aborted", "abandoned", "closed"];

export function Page() {
  const [query, change] = useQuery();
  const [status, model, suite] = ["status", "model", "suite"].map((name) => query.get(name) ?? "");
  const list = usePages(withQuery("/api/v1/runs", { status, model, suite, limit: PAGE_ITEMS }), POLL_MS);
  /** @param {SubmitEvent} event */
  const filter = (event) => {
    event.preventDefault();
    const form = new FormData(/** @type {HTMLFormElement} */ (event.currentTarget));
    change({ model: String(form.get("model")).trim(), suite: String(form.get("suite")).trim() });
  };
  return html`
    <h1>Runs</h1>
    <p class="muted">A run is one model that plays all games of a suite.</p>
    <form class="buttons" onSubmit=${filter}>
      <label>Status${" "}
        <select value=${status} onChange=${(/** @type {any} */ event) => change({ status: event.currentTarget.value })}>
          <option value="">all</option>
          ${STATUSES.map((name) => html`<option value=${name}>${name}</option>`)}
        </select>
      </label>
      <label>Model <input name="model" value=${model} placeholder="its whole name" /></label>
      <label>Suite <input name="suite" value=${suite} placeholder="its whole name" /></label>
      <button type="submit">Filter</button>
    </form>
    ${list.problem && html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`}
    <${Runs} list=${list} isFiltered=${Boolean(status || model || suite)} />
    <${More} list=${list} />
  `;
}

/** @param {{list: ReturnType<typeof usePages>, isFiltered: boolean}} props */
function Runs({ list, isFiltered }) {
  if (!list.value) return !list.problem && html`<p class="muted" role="status">Loading …</p>`;
  if (list.items.length === 0) {
    return isFiltered
      ? html`<p class="empty">No run fits. Names must be complete, and in the same letters.</p>`
      : html`<p class="empty">There are no runs yet, or none that can be read without a key. This starts one with built-in players:</p>
          <${Commands} label="Command" what="the command" lines=${[`swarmbench play --suite quick --server ${location.origin}`]} />`;
  }
  return html`<div class="scroll" tabindex="0" role="region" aria-label="Runs">
    <table>
      <thead>
        <tr>
          ${["Model", "Suite", "Rules", "Status"].map((name) => html`<th scope="col">${name}</th>`)}
          <th scope="col" class="number">Games</th>
          <th scope="col" class="number">Total</th>
          <th scope="col">Started</th>
        </tr>
      </thead>
      <tbody>
        ${list.items.map(
          (run) => html`<tr key=${run.id}>
            <th scope="row"><a href=${route`/runs/${run.id}`}><${Text} value=${run.model} /></a></th>
            <td><${Text} value=${run.suite.name} /></td>
            <td>${run.suite.rules}</td>
            <td><${Status} status=${run.status} of="run" />${run.void_reason !== null && html` <span class="badge bad">voided</span>`}</td>
            <td class="number">${run.played}/${run.planned}</td>
            <td class="number">${short(run.total)}</td>
            <td><${Time} value=${run.created_at} /></td>
          </tr>`,
        )}
      </tbody>
    </table>
  </div>`;
}
