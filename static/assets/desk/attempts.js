// Attempts of all entrants.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { short } from "../parts/chart.js";
import { Secret } from "../parts/copy.js";
import { More, usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

const REFRESH_MS = 5000;

/** @param {{id: string, entrants: any[]}} props */
export function Attempts({ id, entrants }) {
  const list = usePages(route`/api/v1/competitions/${id}/attempts`, REFRESH_MS);
  const [token, setToken] = useState(/** @type {string | null} */ (null));
  const names = new Map(entrants.map((one) => [one.id, one.name]));
  if (list.problem && !list.value) return html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`;
  if (list.value && list.items.length === 0) return html`<p class="empty">Nobody has started an attempt.</p>`;
  return html`
    ${token && html`<div role="status"><${Secret} value=${token} label="The new token of the attempt"><p>Give it to the entrant alone.</p><//></div>`}
    <div class="scroll" tabindex="0" role="region" aria-label="Table of attempts">
      <table>
        <thead>
          <tr><th scope="col">Entrant</th><th scope="col" class="number">Attempt</th><th scope="col">Status</th><th scope="col">Games</th><th scope="col" class="number">Total</th><th scope="col">Started</th><th scope="col">Run</th><th scope="col">Change</th></tr>
        </thead>
        <tbody>
          ${list.items.map(
            (one) => html`<${Attempt} key=${one.run} id=${id} one=${one} name=${names.get(one.entrant) ?? one.entrant} done=${list.reload} setToken=${setToken} />`,
          )}
        </tbody>
      </table>
    </div>
    <${More} list=${list} />
  `;
}

/** @param {{id: string, one: any, name: string, done: () => void, setToken: (token: string) => void}} props */
function Attempt({ id, one, name, done, setToken }) {
  const of = `attempt ${one.attempt}`;
  const renew = async () => setToken((await request(route`/api/v1/runs/${one.run}/token`, { method: "POST" })).swarm_token);
  return html`<tr>
    <th scope="row"><${Text} value=${name} /></th>
    <td class="number">${one.attempt}</td>
    <td>${one.status}${one.voided && html`<div class="small"><span class="badge">voided</span> <${Text} value=${one.voided} /></div>`}</td>
    <td><progress value=${one.games_ended} max=${one.games} aria-label="Games that have ended"></progress> <span class="number">${one.games_ended} of ${one.games}</span></td>
    <td class="number">${short(one.total)}</td>
    <td><${Time} value=${one.created_at} /></td>
    <td><a href=${`/runs/${encodeURIComponent(one.run)}`}>run</a> <a href=${`/desk?view=games&run=${encodeURIComponent(one.run)}`}>games</a></td>
    <td>
      <div class="buttons">
        ${!one.voided &&
        html`<${ActButton} label="Void" of=${of} reason="required" done=${done} title=${html`Void attempt ${one.attempt} of <${Text} value=${name} />?`}
          act=${(/** @type {string} */ reason) => request(route`/api/v1/competitions/${id}/attempts/${one.run}/void`, { method: "POST", body: { reason } })}>
          <p>
            For faults of the server. It ends, and does not count. The entrant may start it again on the same seeds as long as its
            window is open. This cannot be taken back.
          </p>
        <//>`}
        ${one.status === "running" &&
        html`<${ActButton} label="Abort" of=${of} done=${done} title=${html`Abort attempt ${one.attempt} of <${Text} value=${name} />?`}
            act=${() => request(route`/api/v1/runs/${one.run}`, { method: "DELETE" })}>
            <p>It ends now, and counts with what it has: games that were not played count as 0. To let it be played again, void it instead.</p>
          <//>
          <${ActButton} label="New token" of=${`for ${of}`} title=${html`Replace the token of <${Text} value=${name} />?`} act=${renew}>
            <p>The earlier one is revoked at once. The entrant can do the same with its key.</p>
          <//>`}
      </div>
    </td>
  </tr>`;
}
