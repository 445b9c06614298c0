// Games, which can be started, ended and voided.
import { html } from "../ui.js";
import { request, route, withQuery } from "../api.js";
import { visit } from "../app.js";
import { ActButton } from "../parts/act.js";
import { short } from "../parts/chart.js";
import { More, usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

const REFRESH_MS = 5000;

const STATUSES = ["running", "waiting", "finished", "aborted", "abandoned"];

/** @param {{query: URLSearchParams, isOrganizer: boolean}} props */
export function View({ query, isOrganizer }) {
  const run = query.get("run");
  const shown = query.get("status") ?? (run ? "" : "running");
  const list = usePages(withQuery("/api/v1/episodes", { run, status: shown }), REFRESH_MS);
  const choose = (/** @type {any} */ event) => visit(`${withQuery("/desk", { view: "games", run })}&status=${event.target.value}`);
  return html`
    <h2>Games${run && html` of <code class="id"><${Text} value=${run} /></code>`}</h2>
    <p><label>Status <select value=${shown} onChange=${choose}>
      <option value="">all</option>
      ${STATUSES.map((name) => html`<option value=${name}>${name}</option>`)}
    </select></label> ${run && html`<a href="/desk?view=games">Games of all runs</a>`}</p>
    ${list.problem && html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`}
    ${list.value && list.items.length === 0 && html`<p class="empty">There is none${shown && ` that is ${shown}`}.</p>`}
    ${list.items.length > 0 &&
    html`<div class="scroll" tabindex="0" role="region" aria-label="Table of games">
      <table>
        <thead><tr><th scope="col">Game</th><th scope="col">Status</th><th scope="col" class="number">Round</th><th scope="col" class="number">Score</th><th scope="col">Visible to</th><th scope="col">Created</th><th scope="col">Change</th></tr></thead>
        <tbody>${list.items.map((one) => html`<${Game} key=${one.id} one=${one} isOrganizer=${isOrganizer} done=${list.reload} />`)}</tbody>
      </table>
    </div>`}
    <${More} list=${list} />
  `;
}

/** @param {{one: any, isOrganizer: boolean, done: () => void}} props */
function Game({ one, isOrganizer, done }) {
  const path = route`/api/v1/episodes/${one.id}`;
  const name = html`this game of ${one.task} by <${Text} value=${one.model} />`;
  const of = `${one.task}, ${one.id}`;
  return html`<tr>
    <th scope="row"><a href=${`/episodes/${encodeURIComponent(one.id)}`}>${one.task} · <${Text} value=${one.model} /></a></th>
    <td>${one.status}${one.void_reason && html`<div class="small"><span class="badge">voided</span> <${Text} value=${one.void_reason} /></div>`}</td>
    <td class="number">${one.round}</td>
    <td class="number">${short(one.score)}</td>
    <td>${one.config?.visibility}</td>
    <td><${Time} value=${one.created_at} /></td>
    <td>
      <div class="buttons">
        ${one.status === "waiting" &&
        html`<${ActButton} label="Start" of=${of} isDangerous=${false} done=${done} title="Start it?" act=${() => request(`${path}/start`, { method: "POST" })}>
          <p>Round 0 of ${name} opens, and its clock begins. Seats that nobody holds have to be claimed before.</p>
        <//>`}
        ${["running", "waiting"].includes(one.status) &&
        html`<${ActButton} label="Abort" of=${of} done=${done} title="Abort it?" act=${() => request(path, { method: "DELETE" })}>
          <p>This ends ${name} now. What was played stays, and counts. This cannot be taken back.</p>
        <//>`}
        ${isOrganizer &&
        !one.void_reason &&
        html`<${ActButton} label="Void" of=${of} done=${done} title="Void it?" reason="required" act=${(/** @type {string} */ reason) => request(`${path}/void`, { method: "POST", body: { reason } })}>
          <p>For faults of the server. From then on ${name} counts nowhere. If its run is running, the game is played again. This cannot be taken back.</p>
        <//>`}
      </div>
    </td>
  </tr>`;
}
