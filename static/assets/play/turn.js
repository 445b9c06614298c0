// The page of a seat while its game is played: the window, the pad, messages, history and clock.
import { html, submits, useEffect, useEvery, useRef, useState } from "../ui.js";
import { remember, remembered } from "../api.js";
import { useKeys } from "../game/keys.js";
import { ACTIONS, agentOf, letterOf } from "../parts/actions.js";
import { ownSign } from "../parts/cell.js";
import { CODES_HELP, Meaning } from "../parts/codes.js";
import { Text } from "../parts/text.js";
import { AgentWindow } from "../parts/window.js";
import { sameRound } from "./seat.js";
import { outcome, rulesOf } from "./words.js";

const TICK_MS = 200;
const SOON_S = 10;

/** The second press of a double click is not meant for a round that came between both. */
const DOUBLE_MS = 400;

/** The maximum length of a message, in code points. */
const MESSAGE_CHARS_MAX = 120;

/** @param {{seat: any, config: any, onAct: (choice: any) => void}} props config: the game's, null where it is not known yet */
export function Turn({ seat, config, onAct }) {
  const { obs } = seat;
  const receipt = sameRound(seat.receipt, obs) ? seat.receipt : null;
  const rules = rulesOf(obs, config);
  const count = config?.num_agents ?? 0;
  const isCommander = config?.control === "centralized" && obs.agent === "Agent_0";
  const receivers = isCommander ? Array.from({ length: count - 1 }, (_, index) => `Agent_${index + 1}`) : [];
  // What changes its height from round to round stands below the pad, which stays where it is.
  return html`<div class="turn">
    <section class="sees" aria-label="What your agent sees">
      ${obs.view
        ? html`<${AgentWindow} cells=${obs.view.cells} rules=${rules} agent=${agentOf(obs)} sign=${ownSign(obs)} action=${receipt?.action} label="What your agent sees" />`
        : html`<p class="escaped">Your agent has left the map. It sees nothing, and takes no further part. The others play on.</p>`}
    </section>
    <section class="does" aria-label="What your agent hears and does">
      ${obs.alive && html`<${Pad} key=${obs.agent} seat=${seat} receipt=${receipt} receivers=${receivers} onAct=${onAct} />`}
      <${Sent} seat=${seat} receipt=${receipt} />
      <p class="own">${outcome(obs)} <${Own} obs=${obs} /></p>
      <${Heard} messages=${obs.messages} />
    </section>
    <${Memory} obs=${obs} rules=${rules} />
  </div>`;
}

const NOTHING = { message: "", to: "" };

/** The message that is not sent yet, which survives a reload. @param {any} obs @param {any} receipt of the last act that the server took */
function useDraft({ episode, agent }, receipt) {
  const name = `draft:${episode}:${agent}`;
  const [draft, setDraft] = useState(() => ({ ...NOTHING, ...JSON.parse(remembered(name) ?? "null") }));
  const sent = useRef(/** @type {string | null} */ (null));
  const write = (/** @type {Partial<typeof NOTHING>} */ change) => {
    const next = { ...draft, ...change };
    setDraft(next);
    remember(name, JSON.stringify(next));
  };
  // What was written since the act was sent stays, for the next one.
  useEffect(() => void (receipt && draft.message === sent.current && write(NOTHING)), [receipt]);
  return { draft, write, sent };
}

/** The actions, each of which is the act of the round, with the message. @param {{seat: any, receipt: any, receivers: string[], onAct: (choice: any) => void}} props */
function Pad({ seat, receipt, receivers, onAct }) {
  const { obs, phase, seenAt } = seat;
  const { draft, write, sent } = useDraft(obs, seat.receipt);
  const input = useRef(/** @type {HTMLInputElement | null} */ (null));
  const pad = useRef(/** @type {HTMLElement | null} */ (null));
  const isOpen = phase === "choose";
  // Keys act again.
  const leave = () => document.activeElement === input.current && pad.current?.focus();
  /** @param {string} action */
  const act = (action) => {
    if (!isOpen) return;
    const { line } = readMessage(draft.message);
    sent.current = draft.message;
    leave();
    onAct({ action, ...(line ? { message: line } : {}), ...(line && draft.to ? { to: draft.to } : {}) });
  };
  /** @param {MouseEvent} event @param {string} action */
  const pressed = (event, action) => event.detail > 1 && performance.now() - seenAt < DOUBLE_MS ? undefined : act(action);
  const focus = () => input.current?.focus();
  useKeys({ m: focus, M: focus, ...Object.fromEntries(obs.actions.flatMap((/** @type {string} */ action) => (ACTIONS[letterOf(action)]?.keys ?? []).map((key) => [key, () => act(action)]))) }, true);
  return html`<div class="pad" role="group" aria-label="Action" tabindex="-1" ref=${pad}>
      ${obs.actions.map((/** @type {string} */ action) => html`<button
        type="button" key=${action} class=${action.toLowerCase()} aria-pressed=${receipt?.action === action} aria-disabled=${!isOpen}
        onClick=${(/** @type {MouseEvent} */ event) => pressed(event, action)}
      ><kbd>${ACTIONS[letterOf(action)]?.sign ?? ""}</kbd> ${action === "SWITCH" ? "Light" : action[0] + action.slice(1).toLowerCase()}</button>`)}
    </div>
    <${MessageBox} draft=${draft} write=${write} input=${input} receivers=${receivers} leave=${leave} />`;
}

/** The message that is sent for a text, its length, and the number of characters cut off (docs/rules.md, "Messages"). @param {string} text */
function readMessage(text) {
  const line = text
    .toWellFormed()
    .replace(/\r\n|[\p{Cc}\u2028\u2029]/gu, " ")
    .replace(/^\p{White_Space}+|\p{White_Space}+$/gu, "");
  const count = [...line].length;
  return { line, count, cut: Math.max(0, count - MESSAGE_CHARS_MAX) };
}

/** @param {{draft: typeof NOTHING, write: (change: Partial<typeof NOTHING>) => void, input: any, receivers: string[], leave: () => void}} props */
function MessageBox({ draft, write, input, receivers, leave }) {
  const { count, cut } = readMessage(draft.message);
  return html`<form class="message" onSubmit=${submits(leave)}>
    ${receivers.length > 0 && html`<label>To
      <select value=${draft.to} onChange=${(event) => write({ to: event.target.value })}>
        <option value="">all agents</option>
        ${receivers.map((agent) => html`<option value=${agent}>${agent}</option>`)}
      </select></label>`}
    <label for="message"><kbd>M</kbd> Message</label>
    <input id="message" ref=${input} autocomplete="off" aria-describedby="message-count" value=${draft.message}
      onInput=${(event) => write({ message: event.target.value })} onKeyDown=${({ key }) => key === "Escape" && leave()} />
    <span id="message-count" class=${`small number ${cut ? "bad" : "muted"}`}>
      ${cut ? `${cut} too many: the first ${MESSAGE_CHARS_MAX} are sent, with "..." after them` : count ? `${count} of ${MESSAGE_CHARS_MAX}, sent with the action` : "It is sent with the action."}
    </span>
  </form>`;
}

/** @param {{obs: any}} props */
const Own = ({ obs }) => html`
  ${obs.position && html`Row <b class="number">${obs.position.i}</b>, column <b class="number">${obs.position.j}</b>.`}
  ${obs.light_on !== undefined && obs.light_on !== null && html` Your light is <b>${obs.light_on ? "on" : "off"}</b>.`}
  ${obs.carrying_food !== undefined && obs.carrying_food !== null && html` You carry <b>${obs.carrying_food ? "food" : "nothing"}</b>.`}`;

/** Messages, folded: they stay open for who opens them. @param {{messages: string[]}} props */
function Heard({ messages }) {
  const [isOpen, setOpen] = useState(remembered("heard") === "open");
  const toggled = ({ currentTarget: { open } }) => {
    setOpen(open);
    remember("heard", open ? "open" : null);
  };
  if (messages.length === 0) return html`<p class="heard muted">You heard nothing.</p>`;
  return html`<details class="heard" open=${isOpen} onToggle=${toggled}>
    <summary>You heard ${messages.length} message${messages.length === 1 ? "" : "s"}${!isOpen && html`: <${Text} value=${messages[0]} />`}</summary>
    <ul>${messages.map((message) => html`<li><${Text} value=${message} /> <${Meaning} text=${message} /></li>`)}</ul>
    <p class="muted small">Messages do not name their senders. ${CODES_HELP}</p>
  </details>`;
}

/** The result of this round's act. @param {{seat: any, receipt: any}} props */
function Sent({ seat, receipt }) {
  const { obs, phase, isLost, problem } = seat;
  const others = receipt?.waiting_for;
  return html`<p class="sent" role="status">
    ${isLost && html`<span class="bad">The server does not answer. It is asked again by itself; nothing is lost. </span>`}
    ${problem && html`<span class="bad">${refusal(problem)} </span>`}
    ${phase === "sending" && "Sending …"}
    ${phase === "sent" && receipt && html`Sent: <b>${receipt.action}</b>${receipt.message && html` and “<${Text} value=${receipt.message} />”`}.
      ${others > 0 ? ` Waiting for ${others} other${others === 1 ? "" : "s"}.` : ""}`}
    ${phase === "sent" && !receipt && obs.alive && "You have acted in this round. Waiting for the others."}
  </p>`;
}

function refusal(problem) {
  if (problem.code === "round_over") return "The round ended before your act came: you did nothing in it.";
  if (problem.code === "already_acted") return "This seat has answered this round already, from another tab or program.";
  if (problem.code === "episode_over") return "The game ended before your act came.";
  return html`Your act was not taken: <${Text} value=${problem.message} />.`;
}

/** The agent's memory: the history in its observation. @param {{obs: any, rules: import("../parts/cell.js").Rules}} props */
function Memory({ obs, rules }) {
  if (obs.history.length === 0) return null;
  const views = new Map(obs.past_views.map(({ round, cells }) => [round, cells]));
  return html`<section class="memory" aria-label="What your agent remembers">
    <h2>Your last rounds</h2>
    <ol reversed start=${obs.history.at(0).round}>
      ${obs.history.map(({ round, action, message }) => html`<li key=${round}>
        <p>Round ${round}: <b>${action ?? "no action"}</b>${message && html`<br />“<${Text} value=${message} />”`}</p>
        ${views.has(round) && html`<${AgentWindow} cells=${views.get(round)}
          rules=${rules} agent=${agentOf(obs)} action=${action} label=${`What it saw in round ${round}`} />`}
      </li>`)}
    </ol>
  </section>`;
}

/** The remaining time: first the round's, then the bank's. @param {{obs: any, seenAt: number, isOpen: boolean}} props */
export function Clock({ obs, seenAt, isOpen }) {
  const [now, setNow] = useState(performance.now());
  const runs = isOpen && obs.remaining_ms !== null;
  useEvery(runs ? TICK_MS : null, () => setNow(performance.now()));
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
