// The view of a game: map, curve, one agent, messages, metrics. The source of the game does not matter.
import { html, useCallback, useEffect, useRef, useState } from "../ui.js";
import { agentOf } from "../parts/actions.js";
import { short } from "../parts/chart.js";
import { useCopied } from "../parts/copied.js";
import { isLive, useChanges, useMoment } from "../parts/game.js";
import { Folded, usePart } from "../parts/load.js";
import { GameMap } from "../parts/map.js";
import { ProblemNote, Waiting } from "../parts/problem.js";
import { Legend } from "../parts/shapes.js";
import { BarLegend, Missing, PlayOn, WithBar, sharesInWords, sharesOf, useLine, useLosses } from "../parts/worth.js";
import { AgentChooser, AgentPanel } from "./agent.js";
import { findMark, hasMark, inWords, isShort, useAllMarks } from "./marks.js";
import { Metrics } from "./metrics.js";
import { linkTo, usePlace } from "./place.js";
import { Announcer, Controls, Toggles, usePlayer } from "./player.js";
import { Messages, list } from "./round.js";
import { Scrubber, useTrack } from "./scrubber.js";

/** @import { Game, State } from "../parts/game.js" */
/** @import { Decision, Shares } from "../parts/worth.js" */

/**
 * What can be done with a game besides watching it; what is left out cannot be done where it is shown.
 * @typedef {object} Tools
 * @property {boolean} [hasLink] its address can be shared
 * @property {string} [embed] markup for pages of others
 * @property {(round: number) => void} [compare]
 * @property {(round: number) => void} [fork]
 * @property {() => void} [journal]
 */

/** What is shown besides: names, what is shown, and keys. @type {[string, string, string][]} */
const TOGGLES = [["messages", "Lines of messages", "m"], ["windows", "All windows", "v"], ["table", "Table of agents", "t"], ["large", "Large map", "z"]];

/**
 * @param {{game: Game, parts: typeof import("./parts.js").PARTS, agent?: number, tools?: Tools, children?: unknown}} props `agent`: the
 *   one that is chosen at first; children come after what one watches
 */
export function Viewer({ game, parts, agent: chosen = 0, tools = {}, children }) {
  const count = useChanges(game);
  const [place, move] = usePlace();
  const [note, setNote] = useState("");
  useEffect(() => setNote(""), [place.round]);
  const [shows, setShows] = useState(/** @type {Record<string, boolean>} */ ({ messages: true }));
  const { copy, note: copied } = useCopied();
  const { head } = game;

  const live = isLive(head);
  const isFollowing = live && place.round === null;
  // The newest round of a running game is undecided: the one before it has actions and messages.
  const newest = live ? Math.max(game.last - 1, game.first) : game.last;
  // A visitor who followed a game to its end stays there.
  const wasLive = useRef(live);
  const round = Math.min(Math.max(place.round ?? (wasLive.current ? newest : game.first), game.first), newest);
  const agent = Math.min(place.agent ?? chosen, head.num_agents - 1);
  const { state, next, problem } = useMoment(game, round);
  useAllMarks(game);
  const track = useTrack(game, count);
  const { worth } = track;
  const losses = useLosses(game, worth);
  const line = useLine(game, round);
  const later = usePart(parts.later, Boolean(shows.windows || shows.table));
  const codes = usePart(parts.codes, String(game.summary.model).startsWith("built-in") || game.summary.config?.open_seats > 0);

  // A visitor at the newest round of a running game follows it.
  const go = useCallback((/** @type {number} */ to) => move({ round: live && to >= newest ? null : to }), [live, newest]);
  const choose = (/** @type {number} */ agent) => move({ agent });
  const toMark = async (/** @type {1 | -1} */ direction) => {
    const found = await findMark(game, round, direction).catch(() => null);
    setNote(found === null ? `No mark ${direction > 0 ? "after" : "before"} this round.` : "");
    if (found !== null) player.jump(found);
  };
  const link = tools.hasLink ? () => copy(linkTo({ round, agent, panel: place.panel }), `the link to round ${round}`) : null;
  const compare = tools.compare && (() => tools.compare?.(round));
  /** Goes to a moment and stops there. @param {Parameters<typeof move>[0]} place */
  const rest = (place) => {
    player.stop();
    move(place);
  };
  const showLoss = (/** @type {Decision} */ decision) => rest({ round: decision.round, agent: agentOf(decision) });
  const follow = live && (() => rest({ round: isFollowing ? round : null }));
  const toggle = (/** @type {string} */ name) => setShows((shows) => ({ ...shows, [name]: !shows[name] }));
  const keys = { ...Object.fromEntries(TOGGLES.map(([name, , key]) => [key, () => toggle(name)])), f: follow || null, l: link, c: compare };
  const player = usePlayer({ game, round, first: game.first, last: newest, agent, agents: head.num_agents, onRound: go, onAgent: choose, onMark: toMark, mark: "mark", keys, parts });
  const playOn = () => {
    player.stop();
    line.toggle();
  };

  if (!state) return html`<${Waiting} of=${{ problem }} />`;
  const common = { head, state, next, agent, onChoose: choose };
  const shares = sharesOf(worth, state);
  const lost = losses.decisions.filter((decision) => decision.round === state.round);
  const summary = sentence(state, next, shares, lost);
  // Nothing can be played after the last round of a complete game.
  const isOver = head.status === "finished" && round >= head.rounds;
  const { embed, fork, journal } = tools;
  const menu = html`
    ${link && html`<button type="button" onClick=${link}>Copy a link to this moment</button>`}
    ${embed && html`<button type="button" onClick=${() => copy(embed, "the markup for another page")}>Copy markup that shows the game in another page</button>`}
    ${compare && html`<button type="button" onClick=${compare}>Compare with another game</button>`}
    ${fork && !isOver && html`<button type="button" onClick=${() => fork(round)}>Play on from round ${round}</button>`}
    <button type="button" onClick=${async () => (await parts.later()).savePicture(`${head.id}-map`)}>Download a picture of the map</button>
    ${journal && html`<button type="button" onClick=${journal}>Download the journal</button>`}`;
  return html`
    ${problem && html`<${ProblemNote} problem=${problem} />`}
    <div class=${shows.large ? "stage large" : "stage"} aria-busy=${state.round !== round}>
      <div class="map-side">
        <${WithBar} shares=${shares} isExpected=${track.isExpected || worth?.values}>
          <${GameMap} ...${common} messages=${shows.messages} lost=${new Map(lost.map((decision) => [agentOf(decision), decision.loss]))} ghosts=${line.ghosts} label=${`Map. ${summary}`} />
        <//>
      </div>
      <div class="time-side">
        <${Controls} player=${player} canMark=${(/** @type {1 | -1} */ direction) => hasMark(game, round, direction)} menu=${menu}>
          ${head.status === "running" && html`<span class="badge live">${isFollowing ? "● live" : "live"}</span>`}
          <${Now} state=${state} next=${next} of=${live ? head.max_round : game.last} />
          <span class="muted" role="status">${note || copied}</span>
        <//>
        <${Scrubber} tracks=${[track]} player=${player} last=${game.last} count=${count} decisions=${losses.decisions} />
        ${!isShort(game) && html`<p class="muted small">A long game: marks are shown where it was read. “Next mark” reads on.</p>`}
        <${Toggles} player=${player} toggles=${[...TOGGLES.map(([name, words]) => [words, Boolean(shows[name]), () => toggle(name)]), ...(follow ? [["Follow", isFollowing, follow]] : [])]} />
      </div>
      <div class="agent-side">
        <${AgentChooser} head=${head} agent=${agent} onChoose=${choose} />
        <${AgentPanel} game=${game} ...${common} panel=${place.panel} isResting=${!player.isPlaying} parts=${parts} onPanel=${(panel) => move({ panel })} />
      </div>
      <div class="legend-side"><${Legend} task=${head.task} hasSpeech=${true} /></div>
      <div class="worth-side">
        <${Missing} worth=${worth} part="values" />
        <${BarLegend} shares=${shares} />
        ${worth?.values && game.line && !isOver && html`<${PlayOn} line=${line} agent=${agent} onToggle=${playOn} />`}
        ${worth?.values && html`<${Folded} summary="What decisions lost" read=${parts.later} name="LossList" props=${{ worth, losses, round, onShow: showLoss }} />`}
      </div>
      <${Metrics} game=${game} round=${state.round} />
    </div>
    <${Announcer} text=${summary} />
    ${later && shows.windows && html`<h2>All windows</h2><${later.AllWindows} ...${common} />`}
    ${later && shows.table && html`<${later.AgentTable} ...${common} />`}
    <h2>Said in round ${state.round}</h2>
    <${Messages} ...${common} codes=${codes} />
    ${children}
  `;
}

/** The moment in numbers, and its marks. @param {{state: State, next: State | null, of?: number}} props */
function Now({ state, next, of = 0 }) {
  const change = next ? next.score - state.score : 0;
  const marks = inWords(next?.marks);
  return html`<span class="number">Round <strong>${state.round}</strong> of ${of.toLocaleString("en")}</span>
    <span class="number">Score <strong>${short(state.score)}</strong>${change !== 0 && html` <span class=${change > 0 ? "good" : "bad"}>${change > 0 ? "+" : "−"}${short(Math.abs(change))}</span>`}</span>
    ${state.distance !== undefined && html`<span class="number">Distance ${short(state.distance)}</span>`}
    ${marks && html`<span class="muted">${marks}</span>`}`;
}

/** A moment in a sentence. @param {State} state @param {State | null} next @param {Shares | null} shares @param {Decision[]} lost */
function sentence(state, next, shares, lost) {
  const parts = [`Round ${state.round}. Score ${short(state.score)}.`];
  /** @param {number[] | undefined} agents @param {string} what */
  const say = (agents, what) => agents?.length && parts.push(`${agents.length === 1 ? "Agent" : "Agents"} ${list(agents)} ${what}.`);
  say(next?.blocked, "blocked");
  say(next?.pushed, "pushed");
  say(next?.invalid, "answered invalidly");
  say(next?.timeouts, "out of time");
  if (shares) parts.push(`Of what could be scored: ${sharesInWords(shares)}`);
  for (const { words, loss } of lost) parts.push(`${words}: ${short(loss)} lost.`);
  return parts.join(" ");
}
