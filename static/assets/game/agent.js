// One agent in one round: its observation, its answer, and the result.
import { html } from "../ui.js";
import { sleep } from "../api.js";
import { actionOf, resultOf, saidBy } from "../parts/actions.js";
import { IN_WORDS, ownSign, signsIn } from "../parts/cell.js";
import { dollars } from "../parts/chart.js";
import { color } from "../parts/colors.js";
import { duration } from "../parts/duration.js";
import { isLive } from "../parts/game.js";
import { useLoaded, usePart } from "../parts/load.js";
import { Text } from "../parts/text.js";
import { AgentWindow, surroundings } from "../parts/window.js";
import { PANELS } from "./place.js";

/** @import { Game, Head, State } from "../parts/game.js" */

/** The pause at a round before the act is read: scrubbing requests none. */
const REST_MS = 180;

/** The maximum number of agents with a button each; of more, one is entered. */
const BUTTONS_MAX = 40;

/** @param {{head: Head, agent: number, onChoose: (agent: number) => void}} props */
export function AgentChooser({ head, agent, onChoose }) {
  const last = head.num_agents - 1;
  if (last >= BUTTONS_MAX) {
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
 * @param {Game} game @param {number} round @param {number} agent @param {boolean} isResting
 */
function useAct(game, round, agent, isResting) {
  const isShown = isResting && !isSecret(game);
  const { value, problem, isLoading } = useLoaded(async (signal) => {
    if (!isShown) return null;
    await sleep(REST_MS, signal);
    return { act: await game.act(round, agent, signal), round, agent };
  }, [game, round, agent, isShown, round < game.last]);
  return value?.round === round && value.agent === agent ? { act: value.act, problem: null } : { act: null, problem: isLoading ? null : problem };
}

/** True while acts are hidden: the game is running and its seed is secret. @param {Game} game */
export const isSecret = ({ head, summary }) => isLive(head) && summary.config?.seed === null;

/**
 * @param {{game: Game, state: State, next: State | null, agent: number, panel: string, isResting: boolean,
 *   parts: typeof import("./parts.js").PARTS, onPanel: (panel: string) => void}} props
 */
export function AgentPanel({ game, state, next, agent, panel, isResting, parts, onPanel }) {
  const later = usePart(parts.later, panel !== "window");
  const { act: read, problem } = useAct(game, state.round, agent, isResting);
  const isGone = state.gone?.includes(agent);
  return html`<section class="agent-panel" aria-label=${`Agent ${agent}`}>
    <div class="panels" role="group" aria-label="What is shown of this agent">
      ${Object.entries(PANELS).map(([name, words]) => html`<button type="button" aria-pressed=${name === panel} onClick=${() => onPanel(name)}>${words}</button>`)}
    </div>
    <div class="panel-content" tabindex="0" role="group" aria-label=${PANELS[panel]}>
      ${panel === "window"
        ? html`<${WindowPanel} game=${game} state=${state} next=${next} agent=${agent} read=${read} isGone=${isGone} />`
        : later && html`<${later.ReadPanel} game=${game} heard=${heardBy(state, agent)} panel=${panel} read=${read} problem=${problem} isResting=${isResting} />`}
    </div>
  </section>`;
}

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
  const sign = read?.observation ? ownSign(read.observation) : signsIn(head, state)(agent);
  return html`<div class="seen">
    <figure>
      ${isMap ? html`<p class="muted">It sees the whole map.</p>` : html`<${AgentWindow} cells=${cells} rules=${head} agent=${agent} sign=${sign} label=${`Window of agent ${agent}`} />`}
      ${!isMap && html`<figcaption class="small muted">${cells.length}×${cells[0]?.length ?? 0}, ${source}</figcaption>`}
    </figure>
    <${Decision} head=${head} state=${state} next=${next} agent=${agent} read=${read} />
  </div>`;
}

/** An agent's choice, place, messages and cost. */
function Decision({ head, state, next, agent, read }) {
  const action = actionOf(next, agent);
  const result = resultOf(next, agent);
  const said = saidBy(next, agent);
  const heard = heardBy(state, agent);
  const { usage, bank_spent_ms: bank } = read?.act ?? {};
  const sign = signsIn(head, state)(agent);
  return html`<dl class="facts decision">
    <dt>Chose</dt>
    <dd>
      ${next ? html`<strong>${action ? action.name : "nothing"}</strong>${result && html`, <span class="bad">${result}</span>`}` : html`<span class="muted">${isLive(head) ? "not decided yet" : "nothing more: the game has ended"}</span>`}
    </dd>
    <dt>Said</dt>
    <dd>${said ? html`“<${Text} value=${said} />”` : html`<span class="muted">nothing</span>`}</dd>
    <dt>At</dt>
    <dd class="number">row ${state.at[2 * agent]}, column ${state.at[2 * agent + 1]}${sign && `, ${IN_WORDS[sign]}`}</dd>
    <dt>Read</dt>
    <dd>${heard.length ? html`<ul class="plain">${heard.map(({ from, text }) => html`<li><span class="muted">${from}:</span> “<${Text} value=${text} />”</li>`)}</ul>` : html`<span class="muted">no message</span>`}</dd>
    ${usage && html`<dt>Cost</dt><dd class="small">${costOf(usage)}</dd>`}
    ${bank > 0 && html`<dt>Bank</dt><dd class="number">${duration(bank)} spent</dd>`}
  </dl>`;
}

/** Messages that an agent reads with a state, as far as replays have their texts. @param {State} state @param {number} agent */
const heardBy = (state, agent) =>
  (state.heard ?? []).filter(({ by }) => by.includes(agent)).map(({ from, text }) => ({ from, text: text ?? saidBy(state, from) }));

/** @param {{prompt_tokens?: number, completion_tokens?: number, latency_ms?: number, first_token_ms?: number, cached_tokens?: number, reasoning_tokens?: number, cost_nano_usd?: number}} usage */
const costOf = ({ prompt_tokens: read, completion_tokens: written, latency_ms: time, first_token_ms: first, cached_tokens: cached, reasoning_tokens: thought, cost_nano_usd: cost }) =>
  [read !== undefined && `${read.toLocaleString("en")} tokens read${cached ? ` (${cached.toLocaleString("en")} cached)` : ""}`,
    written !== undefined && `${written.toLocaleString("en")} written${thought ? ` (${thought.toLocaleString("en")} reasoning)` : ""}`,
    cost !== undefined && `$${dollars(cost / 1e9)}`,
    time !== undefined && `${(time / 1000).toFixed(1)} s`, first !== undefined && `first token ${(first / 1000).toFixed(1)} s`].filter(Boolean).join(", ");
