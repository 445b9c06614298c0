// The two games side by side: where they part, their maps, the agents that differ, and their settings.
import { html, useEffect, useRef, useState } from "../ui.js";
import { actionOf, resultOf, saidBy } from "../parts/actions.js";
import { IN_WORDS, signsIn } from "../parts/cell.js";
import { short } from "../parts/chart.js";
import { color } from "../parts/colors.js";
import { isLive } from "../parts/game.js";
import { GameMap } from "../parts/map.js";
import { Items } from "../parts/listed.js";
import { pageOf } from "../parts/served.js";
import { Shown, Table } from "../parts/table.js";
import { Text } from "../parts/text.js";
import { BarLegend, WithBar, sharesOf } from "../parts/worth.js";
import { differences, findDifference } from "./pair.js";

/** @import { Pair } from "./pair.js" */

/** Settings that are shown if they differ. */
const SETTINGS = ["seed", "rules", "num_agents", "width", "height", "view_size", "memory", "max_round", "control", "noise", "max_delay", "round_deadline_s", "bank_s", "prompt_template"];

/**
 * @param {{name: string, track: import("../game/scrubber.js").Track, moment: any, round: number, agent: number, marks: Set<number>,
 *   messages: boolean, onChoose: (agent: number) => void}} props
 */
export function Side({ name, track: { game, worth, isExpected }, moment: { state, next }, round, agent, marks, messages, onChoose }) {
  const { head, summary } = game;
  const shares = sharesOf(worth, state);
  const hasEnded = round > state.round;
  return html`<section aria-label=${`Game ${name}`}>
    <h2>
      ${name}: <a href=${`${pageOf(head.id)}#r=${state.round}&a=${agent}`}><${Text} value=${summary.model} /></a>
      ${" "}<span class="muted">${head.task}, seed ${summary.config?.seed ?? summary.seed ?? "unknown"}</span>
    </h2>
    <p class="number">
      Score <strong>${short(state.score)}</strong>
      ${hasEnded && html` <span class="badge">${isLive(head) ? "not played yet" : `over after round ${game.last}`}</span>`}
    </p>
    <${WithBar} shares=${shares} isExpected=${isExpected || worth?.values}>
      <${GameMap} ...${{ head, state, next, messages, marks, onChoose }}
        agent=${agent < head.num_agents ? agent : null} label=${`Map of game ${name} in round ${state.round}`} />
    <//>
    <${BarLegend} shares=${shares} />
  </section>`;
}

/** An agent's acts in both games. @param {{head: any, agent: number, a: any, b: any, differs?: any}} props */
function AgentRow({ head, agent, a, b, differs = {} }) {
  const cells = ({ state, next }) => {
    const isGone = state.gone?.includes(agent);
    const place = isGone ? "left" : `${state.at[2 * agent]}, ${state.at[2 * agent + 1]}`;
    const sign = signsIn(head, state)(agent);
    return [`${place}${sign ? `, ${IN_WORDS[sign]}` : ""}`, `${actionOf(next, agent)?.name ?? ""} ${resultOf(next, agent)}`, saidBy(next, agent)];
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
 * @param {{head: any, round: number, agent: number, agents: Map<number, any>, a: any, b: any}} props
 */
export function AgentTable({ head, round, agent, agents, a, b }) {
  const all = [agent, ...[...agents.keys()].filter((other) => other !== agent)];
  const caption = `The chosen agent and those that differ, in round ${round}. What differs is marked.`;
  /** @param {number[]} shown */
  const table = (shown) => html`<${Table} label="Agents" name="pairs" caption=${caption} heads=${["Agent", "Game", "Row, column", "Action", "Message"]}>
    ${shown.map((one) => html`<tbody key=${one}><${AgentRow} head=${head} agent=${one} a=${a} b=${b} differs=${agents.get(one)} /></tbody>`)}
  <//>`;
  return html`<${Shown} items=${all} wrap=${table} />`;
}

/** The maximum length of a setting that is shown. */
const BRIEF_CHARS = 60;

/** Settings in which the games differ. @param {{a: any, b: any}} props the summaries */
export function Settings({ a, b }) {
  const [one, other] = [a.config ?? a, b.config ?? b];
  const shown = SETTINGS.filter((name) => JSON.stringify(one[name] ?? null) !== JSON.stringify(other[name] ?? null));
  const of = (settings) => (name) => html`<${Text} value=${String(settings[name] ?? "none").replace(new RegExp(`^(.{${BRIEF_CHARS}}).+`, "su"), "$1 …")} />`;
  return html`<h2>Settings that differ</h2>
    ${shown.length === 0
      ? html`<p class="muted">None: both games were played with the same settings.</p>`
      : html`<${Items} label="Settings that differ" columns=${[["Setting", (name) => name], ["A", of(one)], ["B", of(other)]]}
          items=${shown} keyOf=${(name) => name} />`}`;
}

/**
 * The first round in which two games differ, found by reading both until then.
 * @param {{pair: Pair, isGroundSame: boolean, onFound: (round: number | null) => void, onGo: (round: number) => void}} props
 */
export function Parting({ pair, isGroundSame, onFound, onGo }) {
  const search = useSearch(pair, onFound);
  const { round, places, seen, problem } = search;
  const both = `${pair.a.last === pair.b.last ? "all" : "the first"} ${pair.common} rounds`;
  const mayGoOn = isLive(pair.a.head) || isLive(pair.b.head);
  if (problem) return html`<p class="bad" role="status">The games could not be read to the round in which they part. <button type="button" onClick=${search.again}>Try again</button></p>`;
  if (round === null && seen < pair.common) {
    return html`<p role="status">Looking for the round in which they part: ${seen} of ${pair.common} … <progress max=${pair.common} value=${seen} aria-label="Rounds that were compared"></progress></p>`;
  }
  if (round === null) {
    return html`<p role="status"><strong>They never part${mayGoOn ? " so far" : ""}:</strong> ${both} are the same in both.
      ${pair.a.last !== pair.b.last && " One of them is longer."}</p>`;
  }
  return html`<p class="parts" role="status">
    ${!isGroundSame || places === 0
      ? html`<strong>They differ from the beginning:</strong> their layouts are not the same.`
      : html`<strong>They part in round ${round}.</strong> <${How} pair=${pair} round=${round} />`}
    ${" "}<button type="button" onClick=${() => onGo(round)}>Go to round ${round}</button>
    ${places !== null && places > round && html`${" "}On the map they differ from <button type="button" onClick=${() => onGo(places)}>round ${places}</button> on.`}
  </p>`;
}

/** @type {{round: number | null, places: number | null, seen: number, problem: boolean}} */
const NOT_FOUND = { round: null, places: null, seen: 0, problem: false };

/** Searches on as the games grow. @param {Pair} pair @param {(round: number | null) => void} onFound */
function useSearch(pair, onFound) {
  const [state, setState] = useState(NOT_FOUND);
  const [count, setCount] = useState(0);
  const from = useRef(0);
  useEffect(() => {
    if (state.round !== null) return;
    const aborted = new AbortController();
    const common = pair.common;
    const seen = (/** @type {number} */ seen) => setState({ ...NOT_FOUND, seen });
    const search = async () => {
      const round = await findDifference(pair, from.current, 1, aborted.signal, { onRound: seen });
      const places = round === null ? null : await findDifference(pair, round, 1, aborted.signal, { onlyPlaces: true });
      if (aborted.signal.aborted) return;
      // The decisions of the newest round are not known yet.
      from.current = common;
      setState({ round, places, seen: common, problem: false });
      onFound(round);
    };
    search().catch(() => aborted.signal.aborted || setState((state) => ({ ...state, problem: true })));
    return () => aborted.abort();
  }, [pair, pair.common, count]);
  return { ...state, again: () => setCount(count + 1) };
}

/** The acts of the first agent that differs, in both games. @param {{pair: Pair, round: number}} props */
function How({ pair, round }) {
  const [a, b] = [pair.a, pair.b].map((game) => /** @type {any} */ ({ state: game.peek(round), next: game.peek(round + 1) }));
  if (!a.state || !b.state) return null;
  const { agents } = differences(pair.a.head, a, b);
  const first = [...agents].find(([, { action, message }]) => action || message);
  if (!first) return null;
  const [agent, { action }] = first;
  const others = agents.size - 1;
  const does = (next) =>
    action ? html`<b>${actionOf(next, agent)?.name}</b>` : saidBy(next, agent) ? html`“<${Text} value=${saidBy(next, agent)} />”` : "nothing";
  return html`Agent ${agent} ${action ? "chooses" : "says"} ${does(a.next)} in A and ${does(b.next)} in
    B${others > 0 ? `; ${others} other${others === 1 ? " agent differs" : "s differ"} too` : ""}.`;
}
