// The audit log.
import { html, useState } from "../ui.js";
import { request } from "../api.js";
import { useLoaded } from "../parts/load.js";
import { More, usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

const REFRESH_MS = 10_000;

/** Pages of what an entry concerns, by the beginning of its id. @type {[string, string][]} */
const PAGES = [["cmp_", "/competitions/"], ["run_", "/runs/"], ["ep_", "/episodes/"]];

export function View() {
  const list = usePages("/api/v1/audit", REFRESH_MS);
  const keys = useLoaded((signal) => request("/api/v1/keys?limit=100", { signal }), []);
  const names = new Map((keys.value?.items ?? []).map((one) => [one.id, one.name]));
  const [action, setAction] = useState("");
  const [text, setText] = useState("");
  const items = list.items;
  const actions = [...new Set(items.map((one) => one.action))].sort();
  const shown = items.filter((one) => (!action || one.action === action) && JSON.stringify(one).toLowerCase().includes(text.toLowerCase()));
  return html`
    <h2>Audit log</h2>
    <p>What organizers did, newest first. It is stored together with what it describes.</p>
    <p class="buttons">
      <label>Action <select value=${action} onChange=${(/** @type {any} */ event) => setAction(event.target.value)}>
        <option value="">all</option>
        ${actions.map((name) => html`<option value=${name}>${name}</option>`)}
      </select></label>
      <label>Find <input type="search" value=${text} placeholder="an id, a name, a reason" onInput=${(/** @type {any} */ event) => setText(event.target.value)} /></label>
      <span class="muted" role="status">${shown.length} of ${items.length} that are loaded</span>
    </p>
    ${list.problem && html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`}
    <div class="scroll" tabindex="0" role="region" aria-label="Table of audit entries">
      <table>
        <thead><tr><th scope="col">When</th><th scope="col">Action</th><th scope="col">By</th><th scope="col">Concerns</th><th scope="col">Detail</th></tr></thead>
        <tbody>
          ${shown.map(
            (one) => html`<tr>
              <td><${Time} value=${one.at} /></td>
              <th scope="row"><code class="nowrap"><${Text} value=${one.action} /></code></th>
              <td><${Text} value=${names.get(one.who) ?? (one.who === "local" ? "on the server's machine" : one.who)} title=${one.who} /></td>
              <td><${Subject} id=${one.subject} /></td>
              <td class="small"><${Detail} detail=${one.detail} /></td>
            </tr>`,
          )}
        </tbody>
      </table>
    </div>
    <${More} list=${list} />
  `;
}

/** @param {{id: string}} props */
function Subject({ id }) {
  const page = PAGES.find(([prefix]) => id.startsWith(prefix))?.[1];
  const text = html`<code class="id"><${Text} value=${id} /></code>`;
  return page ? html`<a href=${page + encodeURIComponent(id)}>${text}</a>` : text;
}

/** @param {{detail: any}} props */
const Detail = ({ detail }) =>
  Object.entries(detail ?? {}).filter(([, value]) => value !== null).map(([name, value]) => html`<div><span class="muted">${name}</span> <${Text} value=${typeof value === "string" ? value : JSON.stringify(value)} /></div>`);
