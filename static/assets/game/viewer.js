// The view of a game: map, curve, one agent, messages, metrics. The source of the game does not matter.
import { html, useCallback, useEffect, useRef, useState } from "../ui.js";
import { short } from "../parts/chart.js";
import { isLive, useChanges, useMoment } from "../parts/game.js";
import { GameMap } from "../parts/map.js";
import { ProblemNote } from "../parts/problem.js";
import { Legend } from "../parts/shapes.js";
import { BarLegend, LossList, Missing, PlayOn, WithBar, agentOf, sharesInWords, sharesOf, useLine, useLosses, useWorth } from "../parts/worth.js";
import { AgentChooser, AgentPanel } from "./agent.js";
import { KeyHelp, useKeys } from "./keys.js";
import { findMark, inWords, useAllMarks } from "./marks.js";
import { Metrics } from "./metrics.js";
import { usePlace, writePlace } from "./place.js";
import { SPEEDS, usePlayback } from "./playback.js";
import { AgentTable, AllWindows, Messages } from "./round.js";
import { Scrubber } from "./scrubber.js";

/** @import { Game, State } from "../parts/game.js" */
/** @import { Decision, Shares } from "../parts/worth.js" */

/** The pause at a round before it is announced: passing rounds are not. */
const ANNOUNCE_MS = 500;

/**
 * @param {{game: Game, onLink?: (link: string) => void, onCompare?: (round: number) => void, onFork?: (round: number) => void, children?: unknown}} props
 *   children come after what one watches
 */
export function Viewer({ game, onLink, onCompare, onFork, children }) {
  const count = useChanges(game);
  const [place, move] = usePlace();
  const [shows, setShows] = useState({ messages: true, windows: false, table: false, large: false });
  const help = useRef(/** @type {HTMLDialogElement | null} */ (null));

  const live = isLive(game.head);
  const isFollowing = live && place.round === null;
  // A visitor who followed a game to its end stays there.
  const wasLive = useRef(live);
  const round = Math.min(Math.max(place.round ?? (wasLive.current ? game.last : game.first), game.first), game.last);
  const agent = Math.min(place.agent ?? 0, game.head.num_agents - 1);
  const { state, next, problem } = useMoment(game, round);
  useAllMarks(game);
  const { worth, isExpected } = useWorth(game);
  const losses = useLosses(game, worth);
  const line = useLine(game, round);

  const go = useCallback((/** @type {number} */ to) => move({ round: Math.min(Math.max(to, game.first), game.last) }), [game]);
  const playback = usePlayback(game, round, go);
  /** @param {number} to */
  const jump = (to) => {
    playback.stop();
    go(to);
  };
  const choose = (/** @type {number} */ agent) => move({ agent });
  const playOn = () => {
    playback.stop();
    line.toggle();
  };
  /** @param {Decision} decision */
  const show = (decision) => {
    playback.stop();
    move({ round: decision.round, agent: agentOf(decision) });
  };
  const toMark = async (/** @type {1 | -1} */ direction) => {
    const found = await findMark(game, round, direction).catch(() => null);
    if (found !== null) jump(found);
  };
  const link = () => onLink?.(location.origin + location.pathname + writePlace({ round, agent, panel: place.panel }));
  const follow = () => (isFollowing ? jump(round) : move({ round: null }));
  const toggle = (/** @type {"messages" | "windows" | "table" | "large"} */ name) => setShows((shows) => ({ ...shows, [name]: !shows[name] }));

  useKeys({
    ArrowLeft: () => jump(round - 1),
    ArrowRight: () => jump(round + 1),
    "Shift+ArrowLeft": () => jump(round - 10),
    "Shift+ArrowRight": () => jump(round + 10),
    Home: () => jump(game.first),
    End: () => jump(game.last),
    " ": playback.toggle,
    ",": () => playback.changeSpeed(-1),
    ".": () => playback.changeSpeed(1),
    n: () => void toMark(1),
    p: () => void toMark(-1),
    "[": () => choose(Math.max(agent - 1, 0)),
    "]": () => choose(Math.min(agent + 1, game.head.num_agents - 1)),
    m: () => toggle("messages"),
    v: () => toggle("windows"),
    t: () => toggle("table"),
    z: () => toggle("large"),
    f: () => live && follow(),
    "?": () => help.current?.showModal(),
    ...Object.fromEntries(Array.from({ length: Math.min(10, game.head.num_agents) }, (_, n) => [String(n), () => choose(n)])),
    l: link,
    c: () => onCompare?.(round),
  });

  if (!state) return problem ? html`<${ProblemNote} problem=${problem} />` : html`<p class="muted" role="status">Loading …</p>`;
  const common = { head: game.head, state, next, agent, onChoose: choose };
  const shares = sharesOf(worth, state);
  const lost = losses.decisions.filter((decision) => decision.round === state.round);
  const summary = sentence(state, next, shares, lost);
  // Nothing can be played after the last round of a complete game.
  const isOver = game.head.status === "finished" && round >= game.head.rounds;
  return html`
    ${problem && html`<${ProblemNote} problem=${problem} />`}
    <div class=${shows.large ? "stage large" : "stage"} aria-busy=${state.round !== round}>
      <div class="map-side">
        <${WithBar} shares=${shares} isExpected=${isExpected || worth?.values}>
          <${GameMap} ...${common} messages=${shows.messages} ringed=${new Set(lost.map(agentOf))} ghosts=${line.ghosts} label=${`Map. ${summary}`} />
        <//>
      </div>
      <div class="time-side">
        <${Controls} game=${game} round=${round} state=${state} next=${next} playback=${playback} isFollowing=${isFollowing} onGo=${jump} onMark=${toMark} onFollow=${live ? follow : null} onHelp=${() => help.current?.showModal()} />
        <${Scrubber} game=${game} count=${count} round=${round} worth=${worth} isExpected=${isExpected} decisions=${losses.decisions} onGo=${jump} />
        <${Missing} worth=${worth} part="values" />
        <${BarLegend} shares=${shares} />
        ${worth?.values && game.line && !isOver && html`<${PlayOn} line=${line} agent=${agent} onToggle=${playOn} />`}
        ${worth?.values && html`<${LossList} worth=${worth} losses=${losses} round=${round} onShow=${show} />`}
      </div>
      <div class="agent-side">
        <${AgentChooser} head=${game.head} agent=${agent} onChoose=${choose} />
        <${AgentPanel}
          game=${game}
          state=${state}
          next=${next}
          agent=${agent}
          panel=${place.panel}
          isResting=${!playback.isPlaying}
          onPanel=${(/** @type {string} */ panel) => move({ panel })}
        />
      </div>
      <${Metrics} game=${game} round=${state.round} />
    </div>
    <${Announcer} text=${summary} />
    <div class="buttons toggles">
      <button type="button" aria-pressed=${shows.messages} onClick=${() => toggle("messages")}>Lines of messages</button>
      <button type="button" aria-pressed=${shows.windows} onClick=${() => toggle("windows")}>All windows</button>
      <button type="button" aria-pressed=${shows.table} onClick=${() => toggle("table")}>Table of agents</button>
      <button type="button" aria-pressed=${shows.large} onClick=${() => toggle("large")}>Large map</button>
      ${onLink && html`<button type="button" onClick=${link}>Copy a link to this moment</button>`}
      ${onCompare && html`<button type="button" onClick=${() => onCompare(round)}>Compare with another game</button>`}
      ${onFork && !isOver && html`<button type="button" onClick=${() => onFork(round)}>Play on from round ${round}</button>`}
    </div>
    ${shows.windows && html`<h2>All windows</h2><${AllWindows} ...${common} />`}
    ${shows.table && html`<${AgentTable} ...${common} />`}
    <h2>Said in round ${state.round}</h2>
    <${Messages} ...${common} />
    <${Legend} task=${game.head.task} />
    ${children}
    <${KeyHelp} dialog=${help} />
  `;
}

/** @param {any} props */
function Controls({ game, round, state, next, playback, isFollowing, onGo, onMark, onFollow, onHelp }) {
  const change = next ? next.score - state.score : 0;
  const marks = inWords(next?.marks);
  return html`<div class="controls">
    <div class="buttons" role="group" aria-label="Rounds">
      <button type="button" onClick=${() => onGo(round - 1)} aria-disabled=${round <= game.first}>← Back</button>
      <button type="button" class="primary" onClick=${playback.toggle} aria-disabled=${game.first === game.last}>${playback.isPlaying ? "Pause" : "Play"}</button>
      <button type="button" onClick=${() => onGo(round + 1)} aria-disabled=${round >= game.last}>Next →</button>
      <label>Speed <select onChange=${(/** @type {any} */ event) => playback.setSpeed(Number(event.currentTarget.value))}>
        ${SPEEDS.map((speed) => html`<option value=${speed} selected=${speed === playback.speed}>${speed}×</option>`)}
      </select></label>
      <button type="button" onClick=${() => onMark(-1)}>Mark before</button>
      <button type="button" onClick=${() => onMark(1)}>Next mark</button>
      ${onFollow && html`<button type="button" aria-pressed=${isFollowing} onClick=${onFollow}>Follow</button>`}
      <button type="button" class="quiet" onClick=${onHelp}>Keys ?</button>
    </div>
    <p class="now">
      <span class="number">Round <strong>${state.round}</strong> of ${game.last}</span>
      <span class="number">Score <strong>${short(state.score)}</strong>${change !== 0 && html` <span class=${change > 0 ? "good" : "bad"}>${change > 0 ? "+" : "−"}${short(Math.abs(change))}</span>`}</span>
      ${state.distance !== undefined && html`<span class="number">Distance ${short(state.distance)}</span>`}
      ${marks && html`<span class="muted">${marks}</span>`}
    </p>
  </div>`;
}

/** A moment in a sentence. @param {State} state @param {State | null} next @param {Shares | null} shares @param {Decision[]} lost */
function sentence(state, next, shares, lost) {
  const parts = [`Round ${state.round}. Score ${short(state.score)}.`];
  /** @param {number[] | undefined} agents @param {string} what */
  const say = (agents, what) => agents?.length && parts.push(`${agents.length === 1 ? "Agent" : "Agents"} ${agents.slice(0, 12).join(", ")}${agents.length > 12 ? " and more" : ""} ${what}.`);
  say(next?.blocked, "blocked");
  say(next?.pushed, "pushed");
  say(next?.invalid, "answered invalidly");
  say(next?.timeouts, "out of time");
  if (shares) parts.push(`Of what could be scored: ${sharesInWords(shares)}`);
  for (const { words, loss } of lost) parts.push(`${words}: ${short(loss)} lost.`);
  return parts.join(" ");
}

/** Announces to screen readers what is shown, once it rests. @param {{text: string}} props */
function Announcer({ text }) {
  const [said, setSaid] = useState("");
  useEffect(() => {
    const timer = setTimeout(() => setSaid(text), ANNOUNCE_MS);
    return () => clearTimeout(timer);
  }, [text]);
  return html`<p class="unseen" aria-live="polite">${said}</p>`;
}
