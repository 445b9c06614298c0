// Entrants of a competition, and what an organizer changes about them.
import { html } from "../ui.js";
import { request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { More } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text, visible } from "../parts/text.js";
import { Time } from "../parts/time.js";

/** @param {{id: string, list: ReturnType<typeof import("../parts/pages.js").usePages>}} props */
export function Entrants({ id, list }) {
  if (list.problem && !list.value) return html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`;
  if (list.value && list.items.length === 0) return html`<p class="empty">Nobody has entered.</p>`;
  return html`<div class="scroll" tabindex="0" role="region" aria-label="Table of entrants">
      <table>
        <thead><tr><th scope="col">Name</th><th scope="col">Model</th><th scope="col">Status</th><th scope="col">Entered</th><th scope="col">Id</th><th scope="col">Change</th></tr></thead>
        <tbody>${list.items.map((one) => html`<${Entrant} key=${one.id} id=${id} one=${one} done=${list.reload} />`)}</tbody>
      </table>
    </div>
    <${More} list=${list} />`;
}

/** @param {{id: string, one: any, done: () => void}} props */
function Entrant({ id, one, done }) {
  const change = (/** @type {Record<string, unknown>} */ body) => request(route`/api/v1/competitions/${id}/entrants/${one.id}`, { method: "PATCH", body });
  const of = visible(one.name);
  const name = html`<${Text} value=${one.name} />`;
  return html`<tr>
    <th scope="row"><${Text} value=${one.name} /></th>
    <td><${Text} value=${one.model} />${one.vouched && html` <span class="badge">vouched</span>`}</td>
    <td>${one.status}${one.reason && html`<div class="small"><${Text} value=${one.reason} /></div>`}</td>
    <td><${Time} value=${one.registered_at} /></td>
    <td><code class="id">${one.id}</code></td>
    <td>
      <div class="buttons">
        <${ActButton} label=${one.vouched ? "Take back the voucher" : "Vouch"} of=${`for ${of}`} isDangerous=${false} done=${done}
          title=${one.vouched ? html`No longer vouch for ${name}?` : html`Vouch for ${name}?`} act=${() => change({ vouched: !one.vouched })}>
          <p>${one.vouched ? "Boards no longer say" : "Boards say from then on"} that you know that the declared model plays.</p>
        <//>
        ${one.status === "active"
          ? html`<${ActButton} label="Withdraw" of=${of} title=${html`Withdraw ${name}?`} reason="optional" done=${done} act=${(/** @type {string} */ reason) => change({ status: "withdrawn", ...(reason && { reason }) })}>
                <p>It cannot start attempts, and stays on the board without a rank. You can readmit it.</p>
              <//>
              <${ActButton} label="Disqualify" of=${of} title=${html`Disqualify ${name}?`} reason="required" done=${done} act=${(/** @type {string} */ reason) => change({ status: "disqualified", reason })}>
                <p>It cannot start attempts, and stays on the board without a rank, with the reason. You can readmit it.</p>
              <//>`
          : html`<${ActButton} label="Readmit" of=${of} isDangerous=${false} title=${html`Readmit ${name}?`} done=${done} act=${() => change({ status: "active" })}>
              <p>It has a rank again, and can start attempts while the competition is open.</p>
            <//>`}
      </div>
    </td>
  </tr>`;
}
