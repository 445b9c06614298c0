// The entrants of a competition.
import { html } from "../ui.js";
import { More } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

/** @param {{list: ReturnType<typeof import("../parts/pages.js").usePages>, hasCategories: boolean}} props */
export function Entrants({ list, hasCategories }) {
  if (list.problem && !list.value) return html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`;
  if (!list.value) return html`<p class="muted" role="status">Loading …</p>`;
  if (list.items.length === 0) return html`<p class="empty">Nobody has entered.</p>`;
  return html`<div class="scroll" tabindex="0" role="region" aria-label="Table of entrants">
      <table>
        <thead>
          <tr><th scope="col">Name</th>${hasCategories && html`<th scope="col">Category</th>`}<th scope="col">Model, as declared</th><th scope="col">Sampling</th><th scope="col">Prompt</th><th scope="col">Entered</th></tr>
        </thead>
        <tbody>
          ${list.items.map(
            (one) => html`<tr key=${one.id} class=${one.status === "active" ? "" : "out"}>
              <th scope="row"><${Text} value=${one.name} />${one.status !== "active" && html` <span class="badge">${one.status}</span>`}</th>
              ${hasCategories && html`<td><${Text} value=${one.category} /></td>`}
              <td><${Text} value=${one.model} />${one.vouched && html` <span class="badge">vouched</span>`}</td>
              <td>${samplingOf(one)}</td>
              <td>${one.prompt_template ? html`its own, <code>${one.prompt_template}</code>` : "built-in"}</td>
              <td><${Time} value=${one.registered_at} /></td>
            </tr>`,
          )}
        </tbody>
      </table>
    </div>
    <${More} list=${list} />`;
}

/** @param {{temperature?: number | null, top_p?: number | null}} entrant */
const samplingOf = ({ temperature, top_p }) =>
  [
    [temperature, "temperature"],
    [top_p, "top-p"],
  ]
    .filter(([value]) => value !== null && value !== undefined)
    .map(([value, name]) => `${name} ${value}`)
    .join(", ") || "–";
