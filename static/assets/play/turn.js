// The page of a seat while its game is played: the observation, messages, history, clock and controls.
import { html, useEffect, useState } from "../ui.js";
import { Controls, signOf } from "./controls.js";
import { sameRound } from "./seat.js";
import { Sight, meaningOfMark, outcome, surroundings } from "./sight.js";
import { Text } from "../parts/text.js";

const TICK_MS = 200;
const SOON_S = 10;

/**
 * @param {{seat: any, config: any, onAct: (choice: any) => void}} props
 *   `config` is the game's, null where it is not known yet
 */
export function Turn({ seat, config, onAct }) {
  const { obs, phase } = seat;
  const receipt = sameRound(seat.receipt, obs) ? seat.receipt : null;
  const [chosen, setChosen] = useState(/** @type {string | null} */ (null));
  const shown = receipt?.action ?? chosen;
  const count = config?.num_agents ?? 0;
  const isCommander = config?.control === "centralized" && obs.agent === "Agent_0";
  const receivers = isCommander ? Array.from({ length: count - 1 }, (_, index) => `Agent_${index + 1}`) : [];
  return html`<div class="turn">
    <section class="sees" aria-label="What your agent sees">
      ${obs.view
        ? html`<${Sight} view=${obs.view} agent=${obs.agent} isMarked=${ownMark(obs)} action=${shown} sign=${signOf(shown)} label="What your agent sees" />`
        : html`<p class="escaped">Your agent has left the map. It sees nothing, and takes no further part. The others play on.</p>`}
      <${Own} obs=${obs} />
    </section>
    <section class="does" aria-label="What your agent hears and does">
      <${Heard} obs=${obs} />
      ${obs.alive && html`<${Controls} obs=${obs} phase=${phase} receipt=${seat.receipt} receivers=${receivers} onChoose=${setChosen} onSend=${onAct} />`}
      <${Sent} seat=${seat} receipt=${receipt} />
    </section>
    <${Memory} obs=${obs} />
  </div>`;
}

/** Whether the agent's own light is on, or it carries food. @param {any} obs */
const ownMark = (obs) => Boolean(obs.light_on ?? obs.carrying_food);

/** @param {{obs: any}} props */
const Own = ({ obs }) => html`<p class="own">
  ${obs.position && html`Row <b class="number">${obs.position.i}</b>, column <b class="number">${obs.position.j}</b>.`}
  ${obs.light_on !== undefined && obs.light_on !== null && html` Your light is <b>${obs.light_on ? "on" : "off"}</b>.`}
  ${obs.carrying_food !== undefined && obs.carrying_food !== null && html` You carry <b>${obs.carrying_food ? "food" : "nothing"}</b>.`}
</p>`;

/** @param {{obs: any}} props */
const Heard = ({ obs }) => html`<h2>Heard <span class="muted">(messages do not name their senders)</span></h2>
  ${obs.messages.length === 0
    ? html`<p class="muted">Nothing.</p>`
    : html`<ul class="heard">
        ${obs.messages.map((/** @type {string} */ message) => html`<li><${Text} value=${message} /></li>`)}
      </ul>`}`;

/** The result of this round's act. @param {{seat: any, receipt: any}} props */
function Sent({ seat, receipt }) {
  const { obs, phase, isLost, problem } = seat;
  const others = receipt?.waiting_for;
  return html`<p class="sent" role="status">
    ${isLost && html`<span class="bad">The server does not answer. It is asked again by itself; nothing is lost. </span>`}
    ${problem && html`<span class="bad">${refusal(problem)} </span>`}
    ${phase === "sending" && "Sending …"}
    ${phase === "sent" &&
    receipt &&
    html`Sent: <b>${receipt.action}</b>${receipt.message && html` and “<${Text} value=${receipt.message} />”`}.
    ${others > 0 ? ` Waiting for ${others} other${others === 1 ? "" : "s"}.` : ""}`}
    ${phase === "sent" && !receipt && obs.alive && "You have acted in this round. Waiting for the others."}
  </p>`;
}

/** @param {any} problem */
function refusal(problem) {
  if (problem.code === "round_over") return "The round ended before your act came: you did nothing in it.";
  if (problem.code === "already_acted") return "This seat has answered this round already, from another tab or program.";
  if (problem.code === "episode_over") return "The game ended before your act came.";
  return html`Your act was not taken: <${Text} value=${problem.message} />.`;
}

/** The agent's memory: the history in its observation. @param {{obs: any}} props */
function Memory({ obs }) {
  if (obs.history.length === 0) return null;
  const views = new Map(obs.past_views.map((/** @type {any} */ past) => [past.round, past]));
  return html`<section class="memory" aria-label="What your agent remembers">
    <h2>Your last rounds</h2>
    <ol reversed start=${obs.history.at(0).round}>
      ${obs.history.map(
        (/** @type {any} */ past) => html`<li key=${past.round}>
          <p>
            Round ${past.round}: <b>${past.action ?? "no action"}</b>${past.message && html`<br />“<${Text} value=${past.message} />”`}
          </p>
          ${views.has(past.round) &&
          html`<${Sight} view=${views.get(past.round)} agent=${obs.agent} action=${past.action} sign=${signOf(past.action)} label=${`What it saw in round ${past.round}`} />`}
        </li>`,
      )}
    </ol>
  </section>`;
}

/**
 * The remaining time: first the round's, then the bank's.
 * @param {{obs: any, seenAt: number, isOpen: boolean}} props
 */
export function Clock({ obs, seenAt, isOpen }) {
  const [now, setNow] = useState(performance.now());
  const runs = isOpen && obs.remaining_ms !== null;
  useEffect(() => {
    if (!runs) return;
    const timer = setInterval(() => setNow(performance.now()), TICK_MS);
    return () => clearInterval(timer);
  }, [runs]);
  if (!runs) return null;
  const left = Math.max(0, obs.remaining_ms - Math.max(0, now - seenAt));
  const bank = Math.min(obs.bank_ms ?? 0, left);
  const seconds = Math.ceil((left - bank) / 1000);
  const inBank = bank > 0 ? `${seconds > 0 ? " + " : ""}${Math.ceil(bank / 1000)} s of the bank` : "";
  const isSoon = left <= SOON_S * 1000;
  return html`<span class=${isSoon ? "bad" : ""}>
    <b class="number">${seconds > 0 || !inBank ? `${seconds} s` : ""}${inBank}</b> left
    <span class="unseen" role="status">${isSoon && left > 0 ? `Less than ${SOON_S} seconds are left.` : ""}</span>
  </span>`;
}

/** A round for screen readers. @param {any} obs @param {any} config */
export function spoken(obs, config) {
  const heard = obs.messages.length;
  const parts = [`Round ${obs.round} of ${obs.max_round}. Score ${obs.score}.`, outcome(obs)];
  if (obs.view) parts.push(surroundings(obs.view, meaningOfMark(obs.task.name, config?.rules)));
  if (heard > 0) parts.push(`${heard} message${heard === 1 ? "" : "s"} heard.`);
  return parts.filter(Boolean).join(" ");
}
