// Models that played together in one swarm.
import { html } from "../ui.js";
import { withQuery } from "../api.js";
import { PAGE_ITEMS, More, usePages } from "../parts/pages.js";
import { Download } from "../parts/download.js";
import { Text } from "../parts/text.js";

export function Together() {
  const list = usePages(withQuery("/api/v1/cross-play", { limit: PAGE_ITEMS }));
  if (list.items.length === 0) return null;
  return html`
    <h2>Played together</h2>
    <p class="muted">
      Pairs of models with seats in the same games. All agents share one score, so it is that of the whole swarm.${" "}
      <${Download} href="/api/v1/cross-play?format=csv" name="together.csv">CSV</${Download}>
    </p>
    <div class="scroll" tabindex="0" role="region" aria-label="Models that played together">
      <table>
        <thead>
          <tr>
            ${["Models", "Task", "Setting"].map((name) => html`<th scope="col">${name}</th>`)}
            <th scope="col" class="number">Games</th>
            <th scope="col" class="number">Mean ± deviation</th>
          </tr>
        </thead>
        <tbody>
          ${list.items.map((pair) => html`<${Pair} pair=${pair} />`)}
        </tbody>
      </table>
    </div>
    <${More} list=${list} />
  `;
}

/** @param {{pair: any}} props */
function Pair({ pair }) {
  const { num_agents: agents, width, height, control } = pair.settings;
  return html`<tr>
    <th scope="row">
      <${Text} value=${pair.models[0]} /> and <${Text} value=${pair.models[1]} />
      ${!pair.vouched && html` <abbr title="In some of the games only its holder says that this was the model.">unconfirmed</abbr>`}
    </th>
    <td>${pair.task}, rules ${pair.rules}</td>
    <td>${agents} agents, ${width} × ${height}, ${control}</td>
    <td class="number">${pair.games}</td>
    <td class="number">${pair.mean.toFixed(2)} <span class="muted small">± ${pair.deviation.toFixed(2)}</span></td>
  </tr>`;
}
