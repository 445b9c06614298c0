// Actions of a run's creator.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { Commands, Secret } from "../parts/copy.js";

/** @param {{run: any, changed: () => void}} props */
export function Actions({ run, changed }) {
  const [token, setToken] = useState("");
  const isRunning = run.status === "running";
  if (!isRunning && run.player) return null;
  const replace = async () => setToken((await request(route`/api/v1/runs/${run.id}/token`, { method: "POST" })).swarm_token);
  const abort = () => request(route`/api/v1/runs/${run.id}`, { method: "DELETE" });
  return html`
    <h2>For its creator</h2>
    <p class="muted">On a server with keys, enter the key with which the run was created. Only then do these work.${run.attempt !== null && " Only organizers can abort an attempt of a competition."}</p>
    <div class="buttons">
      ${!run.player &&
      html`<${ActButton} label="Replace the token" title="Replace the token of this run?" isDangerous=${false} act=${replace}>
        <p>The earlier token stops working at once. A client that plays with it is refused until it has the new one.</p>
      </${ActButton}>`}
      ${isRunning &&
      html`<${ActButton} label="Abort the run" title="Abort this run?" act=${abort} done=${changed}>
        <p>The run and its open games end. Games that were never played count as 0. This cannot be undone.</p>
      </${ActButton}>`}
    </div>
    ${token &&
    html`<${Secret} value=${token} label="New token of the run">
      <p>
        The earlier one is revoked. Built-in players resume the run with it, in the environment variable${" "}
        <code>SWARMBENCH_RUN_TOKEN</code>:
      </p>
      <${Commands} label="Resume the run" what="the command" lines=${[`swarmbench play --run ${run.id} --server ${location.origin}`]} />
    </${Secret}>`}
  `;
}
