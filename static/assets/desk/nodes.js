// The servers that play on the same database.
import { html } from "../ui.js";
import { request } from "../api.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

const EVERY_MS = 2000;

/** The silence after which others take over a server's games. */
const TAKEN_OVER_AFTER_MS = 6000;

/** The maximum offset of a clock. */
const CLOCK_OFF_MAX_MS = 500;

export function View() {
  const { value, problem, reload } = useLoaded((signal) => request("/api/v1/nodes", { signal }), [], EVERY_MS);
  if (!value) return problem ? html`<${ProblemNote} problem=${problem} retry=${reload} />` : html`<p class="muted" role="status">Loading …</p>`;
  const { cluster, items } = value;
  const faults = items.flatMap(faultsOf);
  return html`
    <h2>Servers</h2>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    <p>
      ${cluster
        ? "These servers play on the same database. Each game is played by one of them, and any of them answers. When one dies, the others take its games over."
        : "This server has its database to itself. With PostgreSQL several servers can share one."}
    </p>
    ${faults.length > 0 && html`<ul role="status">${faults.map((fault) => html`<li class="bad"><${Text} value=${fault} /></li>`)}</ul>`}
    <div class="scroll" tabindex="0" role="region" aria-label="Table of servers">
      <table>
        <thead>
          <tr>
            <th scope="col">Server</th><th scope="col">State</th><th scope="col">Plays</th><th scope="col">In memory</th>
            <th scope="col">Seen</th><th scope="col">Clock</th><th scope="col">Address for servers</th><th scope="col">Version</th><th scope="col">Started</th>
          </tr>
        </thead>
        <tbody>
          ${items.map(
            (one) => html`<tr key=${one.id}>
              <th scope="row"><${Text} value=${one.name} />${one.is_this && html` <span class="muted">(answers this page)</span>`}</th>
              <td class=${one.connected ? "" : "bad"}>${stateOf(one, cluster)}</td>
              <td class="number">${one.places}</td>
              <td class="number">${one.episodes}</td>
              <td class="number">${cluster ? `${(one.seen_ms_ago / 1000).toFixed(1)} s ago` : "–"}</td>
              <td class="number">${cluster ? `${one.clock_offset_ms > 0 ? "+" : ""}${one.clock_offset_ms} ms` : "–"}</td>
              <td>${one.address ? html`<code><${Text} value=${one.address} /></code>` : "–"}</td>
              <td><${Text} value=${one.version} /></td>
              <td><${Time} value=${one.started_at} /></td>
            </tr>`,
          )}
        </tbody>
      </table>
    </div>
    <p class="muted">Plays: games without a run, runs and competitions. Clock: how far it is ahead of the database's.</p>
  `;
}

/** @param {any} one @param {boolean} cluster */
function stateOf(one, cluster) {
  if (!one.connected) return "not connected to the database";
  if (one.ready) return cluster ? "takes games" : "ready";
  return cluster ? "takes no games: it starts, stops, or only forwards" : "starts";
}

/** Warnings for the operator. @param {any} one */
function faultsOf(one) {
  const faults = [];
  if (one.seen_ms_ago > TAKEN_OVER_AFTER_MS) faults.push(`${one.name} was not seen for ${Math.round(one.seen_ms_ago / 1000)} s, and is taken over.`);
  if (Math.abs(one.clock_offset_ms) > CLOCK_OFF_MAX_MS) {
    faults.push(`The clock of ${one.name} is ${one.clock_offset_ms} ms off: synchronize it with that of the database.`);
  }
  return faults;
}
