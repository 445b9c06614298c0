// Running runs, which can be ended.
import { html, useState } from "../ui.js";
import { request, route, withQuery } from "../api.js";
import { visit } from "../app.js";
import { ActButton } from "../parts/act.js";
import { Secret } from "../parts/copy.js";
import { More, usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

const REFRESH_MS = 5000;

const STATUSES = ["running", "finished", "aborted", "abandoned", "closed"];

/** @param {{query: URLSearchParams}} props */
export function View({ query }) {
  const shown = query.get("status") ?? "running";
  const list = usePages(withQuery("/api/v1/runs", { status: shown }), REFRESH_MS);
  const [token, setToken] = useState(/** @type {string | null} */ (null));
  return html`
    <h2>Runs</h2>
    <p><label>Status <select value=${shown} onChange=${(/** @type {any} */ event) => visit(`/desk?view=runs&status=${event.target.value}`)}>
      <option value="">all</option>
      ${STATUSES.map((name) => html`<option value=${name}>${name}</option>`)}
    </select></label></p>
    ${token && html`<div role="status"><${Secret} value=${token} label="The new token of the run" /></div>`}
    ${list.problem && html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`}
    ${list.value && list.items.length === 0 && html`<p class="empty">There is none${shown && ` that is ${shown}`}.</p>`}
    ${list.items.length > 0 &&
    html`<div class="scroll" tabindex="0" role="region" aria-label="Table of runs">
      <table>
        <thead><tr><th scope="col">Model</th><th scope="col">Suite</th><th scope="col">Status</th><th scope="col">Games</th><th scope="col">Visible to</th><th scope="col">Created</th><th scope="col">Change</th></tr></thead>
        <tbody>${list.items.map((one) => html`<${Run} key=${one.id} one=${one} done=${list.reload} setToken=${setToken} />`)}</tbody>
      </table>
    </div>`}
    <${More} list=${list} />
  `;
}

/** @param {{one: any, done: () => void, setToken: (token: string) => void}} props */
function Run({ one, done, setToken }) {
  const path = route`/api/v1/runs/${one.id}`;
  const name = html`the run of <${Text} value=${one.model} /> in <${Text} value=${one.suite.name} />`;
  const renew = async () => setToken((await request(`${path}/token`, { method: "POST" })).swarm_token);
  return html`<tr>
    <th scope="row"><a href=${`/runs/${encodeURIComponent(one.id)}`}><${Text} value=${one.model} /></a></th>
    <td>${one.attempt ? html`attempt ${one.attempt} in <a href=${`/desk?view=competition&id=${encodeURIComponent(one.suite.name)}`}>a competition</a>` : html`<${Text} value=${one.suite.name} />`}</td>
    <td>${one.status}${one.waits_for && html`<div class="small">waits for <code><${Text} value=${one.waits_for.name ?? one.waits_for} /></code></div>`}</td>
    <td><a href=${`/desk?view=games&run=${encodeURIComponent(one.id)}`} class="number">${one.played} of ${one.planned}</a></td>
    <td>${one.visibility}</td>
    <td><${Time} value=${one.created_at} /></td>
    <td>
      ${one.status === "running" &&
      html`<div class="buttons">
        <${ActButton} label="Abort" of=${one.id} done=${done} title="Abort it?" act=${() => request(path, { method: "DELETE" })}>
          <p>This ends ${name} and its open games now. What was played stays, and counts. This cannot be taken back.</p>
        <//>
        ${!one.player &&
        html`<${ActButton} label="New token" of=${`for ${one.id}`} title="Replace its token?" act=${renew}>
          <p>The token of ${name} is revoked at once: a player that uses it stops until it has the new one.</p>
        <//>`}
      </div>`}
    </td>
  </tr>`;
}
