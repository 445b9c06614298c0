// Entrants of a competition, and the changes that organizers make to them.
import { html, useRef, useState } from "../ui.js";
import { request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { Secret } from "../parts/copy.js";
import { More } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text, visible } from "../parts/text.js";
import { Time } from "../parts/time.js";
import { Details, termsText } from "./entrant.js";

/** @param {{competition: any, list: ReturnType<typeof import("../parts/pages.js").usePages>}} props */
export function Entrants({ competition, list }) {
  const { id, categories, terms } = competition;
  const [made, setMade] = useState(/** @type {{name: string, key: string} | null} */ (null));
  const [shown, setShown] = useState("");
  const opener = useRef(/** @type {HTMLElement | null} */ (null));
  const one = list.items.find((entrant) => entrant.id === shown);
  const show = (/** @type {string} */ entrant) => (/** @type {any} */ event) => {
    opener.current = event.currentTarget;
    setShown(entrant);
  };
  const close = () => {
    setShown("");
    opener.current?.focus();
  };
  if (list.problem && !list.value) return html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`;
  if (list.value && list.items.length === 0) return html`<p class="empty">Nobody has entered.</p>`;
  return html`<div role="status">
      ${made &&
      html`<${Secret} value=${made.key} label=${`The new key of ${visible(made.name)}`}>
        <p>Give it to the entrant by a way that nobody else reads. It cannot be shown again; the earlier key is not accepted any more.</p>
      <//>`}
    </div>
    ${one && html`<${Details} key=${one.id} competition=${competition} one=${one} done=${list.reload} close=${close} />`}
    <div class="scroll" tabindex="0" role="region" aria-label="Table of entrants">
      <table>
        <thead><tr><th scope="col">Name</th><th scope="col"><span class="unseen">Details</span></th><th scope="col">Model</th>${categories.length > 0 && html`<th scope="col">Category</th>`}${terms && html`<th scope="col">Terms</th>`}<th scope="col">Status</th><th scope="col">Entered</th><th scope="col">Id</th><th scope="col">Change</th></tr></thead>
        <tbody>${list.items.map((one) => html`<${Entrant} key=${one.id} id=${id} one=${one} columns=${{ category: categories.length > 0, terms: terms?.version }} done=${list.reload} show=${show(one.id)} setMade=${setMade} />`)}</tbody>
      </table>
    </div>
    <${More} list=${list} />`;
}

/**
 * @param {{id: string, one: any, columns: {category: boolean, terms?: number}, done: () => void, show: (event: any) => void,
 *   setMade: (made: {name: string, key: string}) => void}} props columns: whether there are categories, and the newest version of the terms
 */
function Entrant({ id, one, columns, done, show, setMade }) {
  const replaceKey = async () => setMade({ name: one.name, ...(await request(route`/api/v1/competitions/${id}/entrants/${one.id}/key`, { method: "POST" })) });
  const change = (/** @type {Record<string, unknown>} */ body) => request(route`/api/v1/competitions/${id}/entrants/${one.id}`, { method: "PATCH", body });
  const of = visible(one.name);
  const name = html`<${Text} value=${one.name} />`;
  return html`<tr>
    <th scope="row"><${Text} value=${one.name} /></th>
    <td><button type="button" aria-label=${`Details of ${of}`} onClick=${show}>Details</button></td>
    <td><${Text} value=${one.model} />${one.vouched && html` <span class="badge">vouched</span>`}</td>
    ${columns.category && html`<td><${Text} value=${one.category} /></td>`}
    ${columns.terms && html`<td>${termsText(one.terms, columns.terms)}</td>`}
    <td>${one.erased && html`<span class="badge">erased</span> `}${one.status}${one.reason && html`<div class="small"><${Text} value=${one.reason} /></div>`}</td>
    <td><${Time} value=${one.registered_at} /></td>
    <td><code class="id">${one.id}</code></td>
    <td>
      <div class="buttons">
        ${(!one.erased || one.vouched) &&
        html`<${ActButton} label=${one.vouched ? "Take back the voucher" : "Vouch"} of=${`for ${of}`} isDangerous=${false} done=${done}
          title=${one.vouched ? html`No longer vouch for ${name}?` : html`Vouch for ${name}?`} act=${() => change({ vouched: !one.vouched })}>
          <p>${one.vouched ? "Boards no longer say" : "Boards say from then on"} that you know that the declared model plays.</p>
        <//>`}
        ${one.status === "active"
          ? html`<${ActButton} label="Withdraw" of=${of} title=${html`Withdraw ${name}?`} reason="optional" done=${done} act=${(/** @type {string} */ reason) => change({ status: "withdrawn", ...(reason && { reason }) })}>
                <p>It cannot start attempts, and stays on the board without a rank. You can readmit it.</p>
              <//>
              <${ActButton} label="Disqualify" of=${of} title=${html`Disqualify ${name}?`} reason="required" done=${done} act=${(/** @type {string} */ reason) => change({ status: "disqualified", reason })}>
                <p>What it plays ends, and it cannot start attempts. It stays on the board without a rank, with the reason. You can readmit it.</p>
              <//>`
          : !one.erased &&
            html`<${ActButton} label="Readmit" of=${of} isDangerous=${false} title=${html`Readmit ${name}?`} done=${done} act=${() => change({ status: "active" })}>
              <p>It has a rank again, and can start attempts while the competition is open.</p>
            <//>`}
        ${!one.erased &&
        html`<${ActButton} label="Replace the key" of=${`of ${of}`} title=${html`Replace the key of ${name}?`} done=${done} act=${replaceKey}>
          <p>For an entrant that has lost its key. The earlier key is not accepted any more, at once and for ever; attempts that run keep their tokens.</p>
          <p class="muted">Only a key that was made when it entered can be replaced here. Who entered with a key of its own gets another one under Keys.</p>
        <//>`}
      </div>
    </td>
  </tr>`;
}
