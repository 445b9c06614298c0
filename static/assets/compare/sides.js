// The two games side by side: their names, their maps, and the agents that differ.
import { html, useState } from "../ui.js";
import { actionOf, resultOf } from "../parts/actions.js";
import { short } from "../parts/chart.js";
import { color } from "../parts/colors.js";
import { GameMap } from "../parts/map.js";
import { Text } from "../parts/text.js";
import { BarLegend, WithBar, sharesOf } from "../parts/worth.js";
import { pageOf, saidBy } from "./pair.js";

/** The number of agents listed at first. */
const LISTED = 30;

/** Settings that are shown if they differ. */
const SETTINGS = ["seed", "rules", "num_agents", "width", "height", "view_size", "memory", "max_round", "control", "noise", "max_delay", "round_deadline_s", "bank_s", "prompt_template"];

/**
 * @param {{name: string, game: import("../parts/game.js").Game, moment: any, worth: import("../parts/worth.js").Appraisal,
 *   round: number, agent: number, marks: Set<number>, messages: boolean, onChoose: (agent: number) => void}} props
 */
export function Side({ name, game, moment, worth: { worth, isExpected }, round, agent, marks, messages, onChoose }) {
  const { head, summary } = game;
  const { state, next } = moment;
  const shares = sharesOf(worth, state);
  const hasEnded = round > state.round;
  return html`<section aria-label=${`Game ${name}`}>
    <h2>
      ${name}: <a href=${`${pageOf(head.id)}#r=${state.round}&a=${agent}`}><${Text} value=${summary.model} /></a>
      ${" "}<span class="muted">${head.task}, seed ${summary.config?.seed ?? summary.seed ?? "unknown"}</span>
    </h2>
    <p class="number">
      Score <strong>${short(state.score)}</strong>
      ${hasEnded && html` <span class="badge">${["waiting", "running"].includes(head.status) ? "not played yet" : `over after round ${game.last}`}</span>`}
    </p>
    <${WithBar} shares=${shares} isExpected=${isExpected || worth?.values}>
      <${GameMap}
        head=${head}
        state=${state}
        next=${next}
        agent=${agent < head.num_agents ? agent : null}
        messages=${messages}
        marks=${marks}
        onChoose=${onChoose}
        label=${`Map of game ${name} in round ${state.round}`}
      />
    <//>
    <${BarLegend} shares=${shares} />
  </section>`;
}

/** An agent's acts in both games. @param {{agent: number, a: any, b: any, differs?: any}} props */
function AgentRow({ agent, a, b, differs = {} }) {
  const cells = (/** @type {any} */ { state, next }) => {
    const isGone = state.gone?.includes(agent);
    const place = isGone ? "left" : `${state.at[2 * agent]}, ${state.at[2 * agent + 1]}`;
    const own = state.lit?.includes(agent) ? " light on" : state.loaded?.includes(agent) ? " food" : "";
    return [`${place}${own}`, `${actionOf(next, agent)?.name ?? ""} ${resultOf(next, agent)}`, saidBy(next, agent)];
  };
  const both = [cells(a), cells(b)];
  const parts = /** @type {const} */ (["place", "action", "message"]);
  return html`${both.map(
    (values, side) => html`<tr key=${side} class=${side ? "second" : ""}>
      ${side === 0 && html`<th scope="rowgroup" rowspan="2"><span class="tag" style=${{ borderColor: color(agent) }}>${agent}</span></th>`}
      <th scope="row">${side ? "B" : "A"}</th>
      ${values.map((value, index) => {
        const shown = parts[index] === "message" ? html`<${Text} value=${value || "–"} />` : value || "–";
        return html`<td class=${parts[index]}>${differs[parts[index]] ? html`<mark>${shown}</mark>` : shown}</td>`;
      })}
    </tr>`,
  )}`;
}

/**
 * The agents that differ, and the chosen one.
 * @param {{round: number, agent: number, agents: Map<number, any>, a: any, b: any}} props
 */
export function AgentTable({ round, agent, agents, a, b }) {
  const [shown, setShown] = useState(LISTED);
  const all = [agent, ...[...agents.keys()].filter((other) => other !== agent)];
  return html`<div class="scroll" tabindex="0" role="region" aria-label="Agents">
      <table class="pairs">
        <caption>The chosen agent and those that differ, in round ${round}. What differs is marked.</caption>
        <thead>
          <tr><th scope="col">Agent</th><th scope="col">Game</th><th scope="col">Row, column</th><th scope="col">Action</th><th scope="col">Message</th></tr>
        </thead>
        ${all.slice(0, shown).map((one) => html`<tbody key=${one}><${AgentRow} agent=${one} a=${a} b=${b} differs=${agents.get(one)} /></tbody>`)}
      </table>
    </div>
    ${all.length > shown && html`<p><button type="button" onClick=${() => setShown(shown + LISTED)}>More (${all.length - shown})</button></p>`}`;
}

/** Settings in which the games differ. @param {{a: any, b: any}} props the summaries */
export function Settings({ a, b }) {
  const [one, other] = [a.config ?? a, b.config ?? b];
  const shown = SETTINGS.filter((name) => JSON.stringify(one[name] ?? null) !== JSON.stringify(other[name] ?? null));
  /** @param {unknown} value */
  const cell = (value) => html`<td><${Text} value=${brief(value)} /></td>`;
  return html`<h2>Settings that differ</h2>
    ${shown.length === 0
      ? html`<p class="muted">None: both games were played with the same settings.</p>`
      : html`<div class="scroll" tabindex="0" role="region" aria-label="Settings that differ">
          <table>
            <thead><tr><th scope="col">Setting</th><th scope="col">A</th><th scope="col">B</th></tr></thead>
            <tbody>
              ${shown.map((name) => html`<tr><th scope="row">${name}</th>${cell(one[name])}${cell(other[name])}</tr>`)}
            </tbody>
          </table>
        </div>`}`;
}

const BRIEF_CHARS = 60;

/** @param {unknown} value */
function brief(value) {
  const text = String(value ?? "none");
  return text.length > BRIEF_CHARS ? `${text.slice(0, BRIEF_CHARS)} …` : text;
}
