// One agent in one round: its observation, its answer, and the result.
import { html, useEffect, useState } from "../ui.js";
import { actionOf, resultOf } from "../parts/actions.js";
import { color } from "../parts/colors.js";
import { isLive } from "../parts/game.js";
import { ProblemNote } from "../parts/problem.js";
import { failureText } from "../parts/status.js";
import { LongText, Text } from "../parts/text.js";
import { duration } from "../parts/time.js";
import { AgentWindow, surroundings } from "../parts/window.js";
import { PANELS } from "./place.js";

/** @import { Game, Head, State } from "../parts/game.js" */

/** The pause at a round before the act is read: scrubbing requests none. */
const REST_MS = 180;

/** The maximum number of agents with a button each; of more, one is entered. */
const BUTTONS_MAX = 40;

/** @type {Record<string, string>} */
const NAMES = { window: "Window", inbox: "Inbox", prompt: "Prompt", answer: "Answer", reasoning: "Reasoning" };

/** @param {{head: Head, agent: number, onChoose: (agent: number) => void}} props */
export function AgentChooser({ head, agent, onChoose }) {
  const last = head.num_agents - 1;
  if (last >= BUTTONS_MAX) {
    /** @param {any} event */
    const entered = (event) => {
      const chosen = Number(event.currentTarget.value);
      if (Number.isInteger(chosen) && chosen >= 0 && chosen <= last) onChoose(chosen);
    };
    return html`<label class="chooser">Agent <input type="number" min="0" max=${last} value=${agent} onInput=${entered} /> of ${head.num_agents}</label>`;
  }
  return html`<div class="chooser" role="group" aria-label="Agent">
    ${Array.from({ length: last + 1 }, (_, n) => html`<button type="button" aria-pressed=${n === agent} aria-label=${`Agent ${n}`} onClick=${() => onChoose(n)} style=${{ "--agent": color(n) }}>${n}</button>`)}
  </div>`;
}

/**
 * The act of an agent, read when the visitor rests at a round.
 * @param {Game} game
 * @param {number} round
 * @param {number} agent
 * @param {boolean} isResting
 */
function useAct(game, round, agent, isResting) {
  const [read, setRead] = useState(/** @type {any} */ ({}));
  const isSettled = round < game.last;
  const secret = isSecret(game);
  useEffect(() => {
    if (!isResting || secret) return;
    const aborted = new AbortController();
    const timer = setTimeout(() => {
      game.act(round, agent, aborted.signal).then(
        (act) => setRead({ act, round, agent }),
        (problem) => aborted.signal.aborted || setRead({ problem, round, agent }),
      );
    }, REST_MS);
    return () => {
      clearTimeout(timer);
      aborted.abort();
    };
  }, [game, round, agent, isResting, isSettled, secret]);
  return read.round === round && read.agent === agent ? read : {};
}

/** True while acts are hidden: the game is running and its seed is secret. @param {Game} game */
const isSecret = ({ head, summary }) => isLive(head) && summary.config?.seed === null;

/**
 * @param {{game: Game, state: State,
 *   next: State | null, agent: number, panel: string, isResting: boolean,
 *   onPanel: (panel: string) => void}} props
 */
export function AgentPanel({ game, state, next, agent, panel, isResting, onPanel }) {
  const { act: read, problem } = useAct(game, state.round, agent, isResting);
  const isGone = state.gone?.includes(agent);
  return html`<section class="agent-panel" aria-label=${`Agent ${agent}`}>
    <div class="panels" role="group" aria-label="What is shown of this agent">
      ${PANELS.map((name) => html`<button type="button" aria-pressed=${name === panel} onClick=${() => onPanel(name)}>${NAMES[name]}</button>`)}
    </div>
    <div class="panel-content">
      ${panel === "window"
        ? html`<${WindowPanel} game=${game} state=${state} next=${next} agent=${agent} read=${read} isGone=${isGone} />`
        : html`<${ReadPanel} game=${game} heard=${heardBy(state, agent)} panel=${panel} read=${read} problem=${problem} isResting=${isResting} />`}
    </div>
  </section>`;
}

/** @param {any} props */
function WindowPanel({ game, state, next, agent, read, isGone }) {
  const { head } = game;
  if (isGone) return html`<p class="muted">Agent ${agent} has left the map. It sees and does nothing any more.</p>`;
  const view = read?.observation?.view;
  // A centralized agent sees the map.
  const isMap = head.control === "centralized";
  const cells = view?.cells ?? surroundings(head, state, agent);
  const source = view
    ? "as it was seen"
    : isSecret(game)
      ? "around the agent on the map; what it saw can be read after the end"
      : "around the agent on the map";
  const isMarked = read?.observation?.light_on ?? read?.observation?.carrying_food;
  return html`<div class="seen">
    <figure>
      ${isMap ? html`<p class="muted">It sees the whole map.</p>` : html`<${AgentWindow} cells=${cells} agent=${agent} isMarked=${isMarked} label=${`Window of agent ${agent}`} />`}
      ${!isMap && html`<figcaption class="small muted">${cells.length}×${cells[0]?.length ?? 0}, ${source}</figcaption>`}
    </figure>
    <${Decision} live=${isLive(head)} state=${state} next=${next} agent=${agent} read=${read} />
  </div>`;
}

/** An agent's prompt, choice, message and cost. @param {any} props */
function Decision({ live, state, next, agent, read }) {
  const action = actionOf(next, agent);
  const result = resultOf(next, agent);
  const said = next?.said?.find((/** @type {any} */ one) => one.from === agent);
  const heard = heardBy(state, agent);
  const { usage, bank_spent_ms: bank } = read?.act ?? {};
  const own = state.lit ? (state.lit.includes(agent) ? "light on" : "light off") : state.loaded?.includes(agent) ? "carries food" : "";
  return html`<dl class="facts decision">
    <dt>Chose</dt>
    <dd>
      ${next ? html`<strong>${action ? action.name : "nothing"}</strong>${result && html`, <span class="bad">${result}</span>`}` : html`<span class="muted">${live ? "not decided yet" : "nothing more: the game has ended"}</span>`}
    </dd>
    <dt>At</dt>
    <dd class="number">row ${state.at[2 * agent]}, column ${state.at[2 * agent + 1]}${own && `, ${own}`}</dd>
    <dt>Read</dt>
    <dd>${heard.length ? html`<ul class="plain">${heard.map(({ from, text }) => html`<li><span class="muted">${from}:</span> “<${Text} value=${text} />”</li>`)}</ul>` : html`<span class="muted">no message</span>`}</dd>
    <dt>Said</dt>
    <dd>${said ? html`“<${Text} value=${said.text} />”` : html`<span class="muted">nothing</span>`}</dd>
    ${usage && html`<dt>Cost</dt><dd class="number">${costOf(usage)}</dd>`}
    ${bank > 0 && html`<dt>Bank</dt><dd class="number">${duration(bank)} spent</dd>`}
  </dl>`;
}

/** Messages that an agent reads with a state, as far as replays have their texts. @param {State} state @param {number} agent */
function heardBy(state, agent) {
  const heard = (state.heard ?? []).filter(({ by }) => by.includes(agent));
  return heard.map(({ from, text }) => ({ from, text: text ?? state.said?.find((one) => one.from === from)?.text ?? "" }));
}

/** @param {{prompt_tokens?: number, completion_tokens?: number, latency_ms?: number}} usage */
function costOf({ prompt_tokens: read, completion_tokens: written, latency_ms: time }) {
  const parts = [];
  if (read !== undefined) parts.push(`${read.toLocaleString("en")} tokens read`);
  if (written !== undefined) parts.push(`${written.toLocaleString("en")} written`);
  if (time !== undefined) parts.push(`${(time / 1000).toFixed(1)} s`);
  return parts.join(", ");
}

/** @param {{game: Game, heard: any[], panel: string, read: any, problem?: Error, isResting: boolean}} props */
function ReadPanel({ game, heard, panel, read, problem, isResting }) {
  if (isSecret(game)) return html`<p class="muted">What agents read and answer can be seen by the creator of the game, and by everybody after its end.</p>`;
  if (problem) return html`<${ProblemNote} problem=${problem} what="This act" />`;
  if (!read) return html`<p class="muted" role="status">${isResting ? "Loading …" : "Pause to read it."}</p>`;
  if (read.isMissing) return html`<p class="muted">What this agent read and answered is not in this file.</p>`;
  if (panel === "inbox") return html`<${Inbox} inbox=${read.inbox ?? heard} />`;
  if (panel === "prompt") return html`<${Prompt} read=${read} />`;
  const text = panel === "answer" ? read.act?.response : read.act?.reasoning;
  const failure = panel === "answer" ? read.act?.failure : undefined;
  const why = failure && html`<p class="bad">The answer did not count: ${failureText(failure)}.</p>`;
  if (text) return html`${why}<${LongText} value=${text} label=${NAMES[panel]} />`;
  if (why) return why;
  return html`<p class="muted">${panel === "answer" ? noAnswer(read) : "No reasoning was sent with this act."}</p>`;
}

/** @param {any} read */
function noAnswer({ act }) {
  if (!act) return "There is no act: the round is not over, or the agent did not act in it.";
  if (act.source === "clock") return "No answer came in time.";
  const message = act.message ? ", with the message that is shown" : "";
  return `The player sent the action ${act.action ?? "none"}${message}, not a text.`;
}

/** @param {{inbox: any[]}} props */
const Inbox = ({ inbox }) =>
  inbox.length === 0
    ? html`<p class="muted">No message came with this round.</p>`
    : html`<ul class="plain inbox">
        ${inbox.map(
          ({ from, sent, text, original }) => html`<li>
            <span class="muted">agent ${String(from).replace("Agent_", "")}${sent !== undefined && `, said in round ${sent}`}</span><br />“<${Text} value=${text} />”
            ${original !== undefined && original !== null && html`<br /><span class="bad">changed by noise; sent was</span> “<${Text} value=${original} />”`}
          </li>`,
        )}
      </ul>`;

/** @param {{read: any}} props */
const Prompt = ({ read }) =>
  read.prompt
    ? html`<${LongText} value=${read.prompt} label="Prompt" />`
    : html`<p class="muted">${read.prompt_problem ? html`No prompt: <${Text} value=${read.prompt_problem} />` : "There is no prompt."}</p>`;
