// Invitation codes.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { Commands } from "../parts/copy.js";
import { Form } from "../parts/form.js";
import { More, usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text, visible } from "../parts/text.js";
import { Time } from "../parts/time.js";

/** The number of codes shown at first; more on request. */
const PAGE_CODES = 50;

/** @type {import("../parts/form.js").Field[]} */
const FIELDS = [
  { name: "labels", label: "Receivers, one a line", kind: "lines", isRequired: true, placeholder: "team blue\nteam red", help: "Organizers alone see them. Each gets a code, which is valid for one entrant." },
];

/** @param {{id: string, names: Map<string, string>, mayMake: boolean}} props */
export function Codes({ id, names, mayMake }) {
  const [made, setMade] = useState(/** @type {{label: string, code: string}[]} */ ([]));
  const list = usePages(route`/api/v1/competitions/${id}/codes?limit=${PAGE_CODES}`);
  /** @param {any} body */
  const create = async (body) => {
    const { items } = await request(route`/api/v1/competitions/${id}/codes`, { method: "POST", body });
    setMade(items);
    list.reload();
  };
  return html`<h3>Invitation codes</h3>
    ${made.length > 0 &&
    html`<div class="inset" role="status">
      <p><strong>New codes</strong> <span class="badge">shown once</span></p>
      <${Commands} lines=${made.map(({ label, code }) => `${label}\t${code}`)} label="New codes" what="all codes" />
    </div>`}
    ${list.problem && !list.value && html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`}
    ${list.value && list.items.length === 0 && html`<p class="empty">There is none.</p>`}
    ${list.items.length > 0 &&
    html`<div class="scroll" tabindex="0" role="region" aria-label="Table of codes">
      <table>
        <thead><tr><th scope="col">Receiver</th><th scope="col">State</th><th scope="col">Used by</th><th scope="col">Made</th><th scope="col"><span class="unseen">Revoke</span></th></tr></thead>
        <tbody>${list.items.map((one) => html`<${Code} id=${id} one=${one} names=${names} done=${list.reload} />`)}</tbody>
      </table>
    </div>`}
    <${More} list=${list} />
    ${mayMake && html`<${Form} fields=${FIELDS} label="Make codes" send=${create} />`}`;
}

/** @param {{id: string, one: any, names: Map<string, string>, done: () => void}} props */
const Code = ({ id, one, names, done }) => html`<tr>
  <th scope="row"><${Text} value=${one.label} /></th>
  <td>${one.state}${one.revoked_at && html` <${Time} value=${one.revoked_at} />`}</td>
  <td>${one.entrant ? html`<${Text} value=${names.get(one.entrant) ?? one.entrant} />` : html`<span class="muted">–</span>`}</td>
  <td><${Time} value=${one.created_at} /></td>
  <td>
    ${one.state === "unused" &&
    html`<${ActButton} label="Revoke" of=${`codes of ${visible(one.label)}`} title=${html`Revoke the codes of <${Text} value=${one.label} />?`} done=${done}
      act=${() => request(route`/api/v1/competitions/${id}/codes/revoke`, { method: "POST", body: { labels: [one.label] } })}>
      <p>Nobody can enter with them any more: with no unused code that has this label. This cannot be taken back; you can make a new code.</p>
    <//>`}
  </td>
</tr>`;
