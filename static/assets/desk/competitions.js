// All competitions, for organizers.
import { html } from "../ui.js";
import { More, usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

export function View() {
  const list = usePages("/api/v1/competitions");
  return html`
    <h2>Competitions</h2>
    <p><a href="/desk?view=create">New competition</a></p>
    ${list.problem && html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`}
    ${list.value && list.items.length === 0 && html`<p class="empty">There is none.</p>`}
    ${list.items.length > 0 &&
    html`<div class="scroll" tabindex="0" role="region" aria-label="Table of competitions">
      <table>
        <thead><tr><th scope="col">Name</th><th scope="col">Phase</th><th scope="col">Opens</th><th scope="col">Closes</th><th scope="col">Page</th></tr></thead>
        <tbody>
          ${list.items.map(
            (one) => html`<tr key=${one.id}>
              <th scope="row"><a href=${`/desk?view=competition&id=${encodeURIComponent(one.id)}`}><${Text} value=${one.name} /></a></th>
              <td>${one.phase}</td>
              <td><${Time} value=${one.opens_at} /></td>
              <td><${Time} value=${one.closes_at} /></td>
              <td><a href=${`/competitions/${encodeURIComponent(one.id)}`}>as others see it</a></td>
            </tr>`,
          )}
        </tbody>
      </table>
    </div>`}
    <${More} list=${list} />
  `;
}
