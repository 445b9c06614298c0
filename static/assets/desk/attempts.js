// Attempts of all entrants.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { short } from "../parts/chart.js";
import { Secret } from "../parts/copy.js";
import { More, usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { OnSpareSeeds, roundsText } from "../parts/status.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

const REFRESH_MS = 5000;

/** @typedef {{name: string, attempt: number, games: number, seen: {games_opened: number, rounds: number, warning: string}}} Seen */

/** @param {{competition: any, names: Map<string, string>}} props */
export function Attempts({ competition, names }) {
  const { id } = competition;
  const list = usePages(route`/api/v1/competitions/${id}/attempts`, REFRESH_MS);
  const [token, setToken] = useState(/** @type {string | null} */ (null));
  const [seen, setSeen] = useState(/** @type {Seen | null} */ (null));
  if (list.problem && !list.value) return html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`;
  if (list.value && list.items.length === 0) return html`<p class="empty">Nobody has started an attempt.</p>`;
  return html`
    ${token && html`<div role="status"><${Secret} value=${token} label="The new token of the attempt"><p>Give it to the entrant alone.</p><//></div>`}
    <div role="status">${seen && html`<${SeenNote} ...${seen} />`}</div>
    <div class="scroll" tabindex="0" role="region" aria-label="Table of attempts">
      <table>
        <thead>
          <tr><th scope="col">Entrant</th><th scope="col" class="number">Attempt</th><th scope="col">Status</th><th scope="col">Games</th><th scope="col" class="number">Total</th><th scope="col">Started</th><th scope="col">Run</th><th scope="col">Change</th></tr>
        </thead>
        <tbody>
          ${list.items.map(
            (one) => html`<${Attempt} key=${one.run} competition=${competition} one=${one} name=${names.get(one.entrant) ?? one.entrant} done=${list.reload} setToken=${setToken} setSeen=${setSeen} />`,
          )}
        </tbody>
      </table>
    </div>
    <${More} list=${list} />
  `;
}

/** The entrant's knowledge of seeds on which it will play again. @param {Seen} props */
const SeenNote = ({ name, attempt, games, seen }) => html`<div class="problem">
  <p>
    <strong>Warning: <${Text} value=${name} /> has seen seeds of attempt ${attempt}.</strong> ${seen.games_opened} of ${games} games were opened, and
    ${roundsText(seen.rounds)} played.
  </p>
  <p><${Text} value=${seen.warning} /></p>
</div>`;

/** The consequences for the seeds. @param {number} spares */
const voidedText = (spares) =>
  spares > 0
    ? "The entrant may start it again, as long as the competition is open: on spare seeds, or, if it has used all of them, on the same ones within its window."
    : "This competition has no spare seeds. The entrant may start it again as long as its window is open, on the same seeds, of which it may have seen some.";

/** @param {{competition: any, one: any, name: string, done: () => void, setToken: (token: string) => void, setSeen: (seen: Seen | null) => void}} props */
function Attempt({ competition, one, name, done, setToken, setSeen }) {
  const voidIt = async (/** @type {string} */ reason) => {
    const path = route`/api/v1/competitions/${competition.id}/attempts/${one.run}/void`;
    const { seen } = await request(path, { method: "POST", body: { reason } });
    setSeen(seen ? { name, attempt: one.attempt, games: one.games, seen } : null);
  };
  const of = `attempt ${one.attempt}`;
  const renew = async () => setToken((await request(route`/api/v1/runs/${one.run}/token`, { method: "POST" })).swarm_token);
  return html`<tr>
    <th scope="row"><${Text} value=${name} /></th>
    <td class="number">${one.attempt}${one.on_spare_seeds && html` <${OnSpareSeeds} />`}</td>
    <td>${one.status}${one.voided && html`<div class="small"><span class="badge">voided</span> <${Text} value=${one.voided} /></div>`}</td>
    <td><progress value=${one.games_ended} max=${one.games} aria-label="Games that have ended"></progress> <span class="number">${one.games_ended} of ${one.games}</span></td>
    <td class="number">${short(one.total)}</td>
    <td><${Time} value=${one.created_at} /></td>
    <td><a href=${`/runs/${encodeURIComponent(one.run)}`}>run</a> <a href=${`/desk?view=games&run=${encodeURIComponent(one.run)}`}>games</a></td>
    <td>
      <div class="buttons">
        ${!one.voided &&
        html`<${ActButton} label="Void" of=${of} reason="required" done=${done} title=${html`Void attempt ${one.attempt} of <${Text} value=${name} />?`}
          act=${voidIt}>
          <p>For faults of the server. It ends, and does not count. ${voidedText(competition.spares)} This cannot be taken back.</p>
        <//>`}
        ${one.status === "running" &&
        html`<${ActButton} label="Abort" of=${of} done=${done} title=${html`Abort attempt ${one.attempt} of <${Text} value=${name} />?`}
            act=${() => request(route`/api/v1/runs/${one.run}`, { method: "DELETE" })}>
            <p>It ends now, and counts with what it has: games that were not played count as 0. To let it be played again, void it instead.</p>
          <//>
          <${ActButton} label="New token" of=${`for ${of}`} title=${html`Replace the token of <${Text} value=${name} />?`} act=${renew}>
            <p>The earlier one is revoked at once. The entrant can do the same with its key.</p>
          <//>`}
      </div>
    </td>
  </tr>`;
}
