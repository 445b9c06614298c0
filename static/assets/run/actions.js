// What the creator of a run can do with it.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { Commands, Secret } from "../parts/copy.js";
import { ProblemNote } from "../parts/problem.js";

/** @param {{run: any, changed: () => void}} props */
export function Actions({ run, changed }) {
  const [asked, setAsked] = useState("");
  const [token, setToken] = useState("");
  const [problem, setProblem] = useState(/** @type {Error | null} */ (null));
  const isRunning = run.status === "running";
  if (!isRunning && run.player) return null;

  /** @param {() => Promise<void>} act */
  const attempt = async (act) => {
    setAsked("");
    setProblem(null);
    try {
      await act();
    } catch (error) {
      setProblem(/** @type {Error} */ (error));
    }
  };
  const replace = () =>
    attempt(async () => setToken((await request(route`/api/v1/runs/${run.id}/token`, { method: "POST" })).swarm_token));
  const abort = () =>
    attempt(async () => {
      await request(route`/api/v1/runs/${run.id}`, { method: "DELETE" });
      changed();
    });

  return html`
    <h2>For its creator</h2>
    <p class="muted">On a server with keys, enter the key with which the run was created. Only then do these work.</p>
    <p class="buttons">
      ${!run.player && html`<button type="button" onClick=${() => setAsked("token")}>Replace the token</button>`}
      ${isRunning && html`<button type="button" class="danger" onClick=${() => setAsked("abort")}>Abort the run</button>`}
    </p>
    ${asked === "token" &&
    html`<${Sure} yes="Replace it" no=${() => setAsked("")} onYes=${replace}>The earlier token stops working at once. A client that plays with it is refused until it has the new one.</${Sure}>`}
    ${asked === "abort" &&
    html`<${Sure} yes="Abort it" no=${() => setAsked("")} onYes=${abort}>The run and its open games end. Games that were never played count as 0. This cannot be undone.</${Sure}>`}
    ${token &&
    html`<${Secret} value=${token} label="New token of the run">
      <p>The earlier one is revoked. Built-in players resume the run with it, in the environment variable <code>SWARMBENCH_RUN_TOKEN</code>:</p>
      <${Commands} label="Resume the run" what="the command" lines=${[`swarmbench play --run ${run.id} --server ${location.origin}`]} />
    </${Secret}>`}
    ${problem && html`<${ProblemNote} problem=${problem} />`}
  `;
}

/** @param {{yes: string, no: () => void, onYes: () => void, children?: unknown}} props */
const Sure = ({ yes, no, onYes, children }) => html`<div role="group" aria-label="Are you sure?">
  <p>${children}</p>
  <p class="buttons">
    <button type="button" class="danger" onClick=${onYes} autofocus>${yes}</button>
    <button type="button" onClick=${no}>Cancel</button>
  </p>
</div>`;
