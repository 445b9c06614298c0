// The metrics of a run's games, by task, loaded on request.
import { html, useState } from "../ui.js";
import { route } from "../api.js";
import { useLoaded } from "./load.js";
import { eachPage } from "./pages.js";
import { ProblemNote } from "./problem.js";
import { short } from "./chart.js";
import { METRICS, metricName } from "./metrics.js";

/** @param {{id: string, version?: unknown}} props */
export function Metrics({ id, version }) {
  const [isWanted, setIsWanted] = useState(false);
  if (isWanted) return html`<${Table} id=${id} version=${version} />`;
  return html`<p><button type="button" onClick=${() => setIsWanted(true)}>Show metrics</button> <span class="muted">what the swarm said and did, as means over games</span></p>`;
}

/** @param {{id: string, version?: unknown}} props */
function Table({ id, version }) {
  const { value, problem, reload } = useLoaded((signal) => means(id, signal), [id, version]);
  if (!value) {
    return problem ? html`<${ProblemNote} problem=${problem} retry=${reload} what="Metrics" />` : html`<p class="muted" role="status">Measuring …</p>`;
  }
  if (value.tasks.length === 0) return html`<p class="empty">No game has ended yet.</p>`;
  return html`<div class="scroll" tabindex="0" role="region" aria-label="Metrics by task">
    <table>
      <caption>Means over games; definition ${value.method}.</caption>
      <thead>
        <tr><th scope="col">Metric</th>${value.tasks.map((task) => html`<th scope="col" class="number">${task}</th>`)}</tr>
      </thead>
      <tbody>
        ${value.names.map(
          (name) => html`<tr key=${name}>
            <th scope="row" title=${METRICS[name]}>${metricName(name)}</th>
            ${value.tasks.map((task) => html`<td class="number">${short(value.mean(task, name))}</td>`)}
          </tr>`,
        )}
      </tbody>
    </table>
  </div>`;
}

/** Means over all pages of games. @param {string} id @param {AbortSignal} signal */
async function means(id, signal) {
  /** @type {Map<string, Map<string, {sum: number, games: number}>>} */
  const tasks = new Map();
  let method = "";
  await eachPage(route`/api/v1/runs/${id}/metrics`, {}, signal, (page) => {
    method = `${page.definition}, revision ${page.metrics_revision}, texts compared by ${page.embedder}`;
    for (const [task, metrics] of Object.entries(page.tasks)) {
      const of = tasks.get(task) ?? new Map();
      tasks.set(task, of);
      for (const [name, { mean, games }] of Object.entries(metrics)) {
        const { sum, games: before } = of.get(name) ?? { sum: 0, games: 0 };
        of.set(name, { sum: sum + mean * games, games: before + games });
      }
    }
  });
  return {
    method,
    tasks: [...tasks.keys()],
    names: Object.keys(METRICS).filter((name) => [...tasks.values()].some((of) => of.has(name))),
    mean: (/** @type {string} */ task, /** @type {string} */ name) => {
      const found = tasks.get(task)?.get(name);
      return found ? found.sum / found.games : null;
    },
  };
}
