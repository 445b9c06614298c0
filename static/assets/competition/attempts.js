// The attempts of the holder of a key.
import { html, useRef, useState } from "../ui.js";
import { Problem, request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { short } from "../parts/chart.js";
import { Commands, Secret } from "../parts/copy.js";
import { More } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { OnSpareSeeds } from "../parts/status.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

/** @param {{competition: any, list: ReturnType<typeof import("../parts/pages.js").usePages>, entrants: any[]}} props */
export function Attempts({ competition, list, entrants }) {
  const [token, setToken] = useState(/** @type {{run: string, swarm_token: string} | null} */ (null));
  /** @param {string} run */
  const renew = async (run) => {
    const answer = await request(route`/api/v1/runs/${run}/token`, { method: "POST" });
    setToken({ run, swarm_token: answer.swarm_token });
  };
  if (list.problem && !list.value) return html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`;
  const items = list.items;
  const names = new Map(entrants.map((one) => [one.id, one.name]));
  return html`
    ${competition.phase === "open" &&
    html`<${Start}
      competition=${competition}
      entrants=${[...new Set(items.map(({ entrant }) => entrant))]}
      started=${(/** @type {any} */ answer) => {
        setToken(answer);
        list.reload();
      }}
    />`}
    ${token && html`<${HowToPlay} run=${token.run} token=${token.swarm_token} />`}
    ${items.length === 0 && list.value && html`<p class="empty">The key of this tab has no attempts here.</p>`}
    ${items.length > 0 &&
    html`<div class="scroll" tabindex="0" role="region" aria-label="Table of my attempts">
      <table>
        <thead>
          <tr><th scope="col">Attempt</th><th scope="col">Entrant</th><th scope="col">Status</th><th scope="col">Games</th><th scope="col" class="number">Total</th><th scope="col">Tasks</th><th scope="col">Started</th><th scope="col"><span class="unseen">Token</span></th></tr>
        </thead>
        <tbody>${items.map((one) => html`<${Attempt} key=${one.run} attempt=${one} name=${names.get(one.entrant) ?? one.entrant} renew=${renew} />`)}</tbody>
      </table>
    </div>`}
    <${More} list=${list} />
  `;
}

/** @param {{attempt: any, name: string, renew: (run: string) => Promise<void>}} props */
const Attempt = ({ attempt, name, renew }) => html`<tr>
  <th scope="row">${attempt.attempt}${attempt.on_spare_seeds && html` <${OnSpareSeeds} />`}</th>
  <td><${Text} value=${name} /></td>
  <td>
    ${attempt.status}${attempt.voided && html`<div class="small"><span class="badge">voided</span> <${Text} value=${attempt.voided} /> It may be started again.</div>`}
  </td>
  <td>
    <progress value=${attempt.games_ended} max=${attempt.games} aria-label="Games that have ended"></progress>
    <a class="number" href=${route`/runs/${attempt.run}`}>${attempt.games_ended} of ${attempt.games}</a>
  </td>
  <td class="number">${attempt.status === "running" ? "after its end" : short(attempt.total)}</td>
  <td>${attempt.tasks?.map((task) => html`<div class="small"><${Text} value=${task.task} /> <span class="number">${short(task.mean)}</span></div>`)}</td>
  <td><${Time} value=${attempt.created_at} /></td>
  <td>
    ${attempt.status === "running" &&
    html`<${ActButton} label="New token" of=${`for attempt ${attempt.attempt}`} title="Replace the token of this attempt?" act=${() => renew(attempt.run)}>
      <p>The earlier token is revoked at once: a player that uses it stops. Its games continue, and their clocks run.</p>
    <//>`}
  </td>
</tr>`;

/** @param {{competition: any, entrants: string[], started: (answer: any) => void}} props */
function Start({ competition, entrants, started }) {
  const [entrant, setEntrant] = useState("");
  const [needsEntrant, setNeedsEntrant] = useState(false);
  // A retry after a lost answer is the same start.
  const start = useRef(newName());
  const send = async () => {
    try {
      const body = entrant ? { entrant } : {};
      const path = route`/api/v1/competitions/${competition.id}/attempts`;
      started(await request(path, { method: "POST", body, idempotencyKey: start.current }));
      start.current = newName();
    } catch (error) {
      if (error instanceof Problem && error.fields.some(({ field }) => field === "entrant")) setNeedsEntrant(true);
      throw error;
    }
  };
  const last = competition.attempts.at(-1);
  return html`<div class="buttons">
    ${(needsEntrant || entrants.length > 1) &&
    html`<label>For the entrant <input list="own-entrants" value=${entrant} placeholder="ent_…" onInput=${(/** @type {any} */ event) => setEntrant(event.target.value.trim())} /></label>
      <datalist id="own-entrants">${entrants.map((id) => html`<option value=${id}></option>`)}</datalist>`}
    <${ActButton} label="Start the next attempt" title="Start the next attempt?" isDangerous=${false} act=${send}>
      <p>
        Its clocks begin at once: a round that is not answered times out. Have your player ready. An attempt cannot be taken back,
        and games that are not played count as 0.
      </p>
      <p>No round of the last attempt begins after <${Time} value=${last?.closes_at} both />.</p>
    <//>
  </div>`;
}

/** A unique name of a start. */
const newName = () => Array.from(crypto.getRandomValues(new Uint32Array(4)), (part) => part.toString(36)).join("-");

/** @param {{run: string, token: string, label?: string}} props */
export const HowToPlay = ({ run, token, label = "The token of this attempt" }) => html`<div role="status">
  <${Secret} value=${token} label=${label}>
    <p>
      It plays all agents of all its games: look with <code>GET /swarm/obs</code>, act with <code>POST /swarm/act</code>${" "}
      (<a href="/docs">API</a>). To see it work, a built-in player plays with these lines. Put the token in the place of the dots.
    </p>
    <${Commands}
      label="How to play"
      lines=${[`export SWARMBENCH_RUN_TOKEN=…`, `swarmbench play --server ${location.origin} --run ${run}`]}
    />
    <p class="muted">The same in any language:</p>
    <${Commands}
      label="The same with curl"
      lines=${[
        `curl "${location.origin}/swarm/obs?wait=30" -H "Authorization: Bearer $SWARMBENCH_RUN_TOKEN"`,
        `curl "${location.origin}/swarm/act" -H "Authorization: Bearer $SWARMBENCH_RUN_TOKEN" -H "Content-Type: application/json" \\`,
        `  -d '{"acts": [{"episode": "ep_…", "agent": "Agent_0", "round": 0, "action": "STAY"}]}'`,
      ]}
    />
  <//>
</div>`;
