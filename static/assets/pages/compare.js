// Two games in step.
import { html, useEffect, useMemo, useRef, useState } from "../ui.js";
import { visit } from "../app.js";
import { Choose, Suggestions, addressOf, nameOf } from "../compare/choose.js";
import { Parting } from "../compare/parting.js";
import { Pair, differences, findDifference, obstacle, openById, readId, sameGround } from "../compare/pair.js";
import { Scrubber } from "../compare/scrubber.js";
import { AgentTable, Settings, Side } from "../compare/sides.js";
import { KeyHelp, useKeys } from "../game/keys.js";
import { usePlace } from "../game/place.js";
import { SPEEDS, usePlayback } from "../game/playback.js";
import { copy } from "../game/save.js";
import { isLive, useChanges, useMoment } from "../parts/game.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { short } from "../parts/chart.js";
import { useWorth } from "../parts/worth.js";

/** The pause at a round before it is announced. */
const ANNOUNCE_MS = 500;

/** @type {[string, string][]} */
const HELP = [
  ["← →", "one round back, one on"],
  ["Shift ← →", "ten rounds"],
  ["Home End", "the first round, the newest"],
  ["Space", "play, pause"],
  [", .", "slower, faster"],
  ["n p", "the next difference, the one before"],
  ["0 … 9", "the agent with this number"],
  ["[ ]", "the agent before, the next"],
  ["m", "lines to who heard a message"],
  ["x", "swap the games"],
  ["l", "copy a link to this moment"],
  ["?", "this list"],
];

/** @param {{query: URLSearchParams}} props */
export function Page({ query }) {
  const [a, b] = [readId(query.get("a") ?? ""), readId(query.get("b") ?? "")];
  return html`<h1>Compare two games</h1>
    <${Choose} a=${a} b=${b} />
    ${a && b ? html`<${Opened} a=${a} b=${b} />` : html`<${Suggestions} a=${a || b} />`}`;
}

/** @param {{a: string, b: string}} props */
function Opened({ a, b }) {
  const one = useLoaded((signal) => openById(a, signal), [a]);
  const other = useLoaded((signal) => openById(b, signal), [b]);
  const pair = useMemo(() => one.value && other.value && new Pair(one.value, other.value), [one.value, other.value]);
  useEffect(() => {
    if (!pair) return;
    document.title = `${nameOf(pair.a)} and ${nameOf(pair.b)} · compare`;
    const aborted = new AbortController();
    // The games themselves show a broken connection, as lost.
    for (const game of [pair.a, pair.b]) if (isLive(game.head)) game.follow(aborted.signal).catch(() => {});
    return () => aborted.abort();
  }, [pair]);
  if (one.problem && !one.value) return html`<${ProblemNote} problem=${one.problem} retry=${one.reload} what="Game A" />`;
  if (other.problem && !other.value) return html`<${ProblemNote} problem=${other.problem} retry=${other.reload} what="Game B" />`;
  return pair ? html`<${InStep} pair=${pair} />` : html`<p class="muted" role="status">Loading both games …</p>`;
}

/** @param {{pair: Pair}} props */
function InStep({ pair }) {
  const { a, b } = pair;
  useChanges(a);
  useChanges(b);
  const [place, move] = usePlace();
  const [messages, setMessages] = useState(true);
  const [parting, setParting] = useState(/** @type {number | null} */ (null));
  const help = useRef(/** @type {HTMLDialogElement | null} */ (null));
  const round = Math.min(place.round ?? 0, pair.last);
  const agents = Math.max(a.head.num_agents, b.head.num_agents);
  const agent = Math.min(place.agent ?? 0, agents - 1);
  const worths = [useWorth(a), useWorth(b)];
  const moments = [useMoment(a, Math.min(round, a.last)), useMoment(b, Math.min(round, b.last))];

  const go = (/** @type {number} */ to) => move({ round: Math.min(Math.max(to, 0), pair.last) });
  const playback = usePlayback(/** @type {any} */ (pair), round, go);
  const jump = (/** @type {number} */ to) => {
    playback.stop();
    go(to);
  };
  const seek = useSeek(pair, round, jump);
  const choose = (/** @type {number} */ agent) => move({ agent: Math.min(Math.max(agent, 0), agents - 1) });
  const [link, setLink] = useState("");
  const copyLink = async () => setLink((await copy(location.href)) ? "" : location.href);
  const swap = () => visit(addressOf(b.head.id, a.head.id) + location.hash);

  useKeys({
    ArrowLeft: () => jump(round - 1),
    ArrowRight: () => jump(round + 1),
    "Shift+ArrowLeft": () => jump(round - 10),
    "Shift+ArrowRight": () => jump(round + 10),
    Home: () => jump(0),
    End: () => jump(pair.last),
    " ": playback.toggle,
    ",": () => playback.changeSpeed(-1),
    ".": () => playback.changeSpeed(1),
    n: () => seek(1),
    p: () => seek(-1),
    "[": () => choose(agent - 1),
    "]": () => choose(agent + 1),
    m: () => setMessages(!messages),
    x: swap,
    l: copyLink,
    "?": () => help.current?.showModal(),
    ...Object.fromEntries(Array.from({ length: Math.min(10, agents) }, (_, n) => [String(n), () => choose(n)])),
  });

  const problem = moments.find(({ problem }) => problem)?.problem;
  const [one, other] = moments;
  if (!one.state || !other.state) return problem ? html`<${ProblemNote} problem=${problem} />` : html`<p class="muted" role="status">Loading …</p>`;
  const why = obstacle(a.head, b.head);
  const isCommon = !why && round <= pair.common;
  const found = isCommon ? differences(a.head, /** @type {any} */ (one), /** @type {any} */ (other)) : NOTHING;
  const marks = new Set(found.agents.keys());
  const side = { round, agent, marks, messages, onChoose: choose };
  const sentence = inWords(round, [one, other], found, why);
  return html`
    ${problem && html`<${ProblemNote} problem=${problem} />`}
    ${(a.isLost || b.isLost) && html`<p class="bad" role="status">The connection to a running game is lost. It is opened again by itself.</p>`}
    ${why
      ? html`<p class="notice">${why}: rounds and scores are compared, agents and places are not.</p>`
      : html`<${Parting} pair=${pair} isGroundSame=${sameGround(pair)} onFound=${setParting} onGo=${jump} />`}
    <div class="sides">
      <${Side} name="A" game=${a} moment=${one} worth=${worths[0]} ...${side} />
      <${Side} name="B" game=${b} moment=${other} worth=${worths[1]} ...${side} />
    </div>
    <${Controls} pair=${pair} round=${round} playback=${playback} canSeek=${!why} onGo=${jump} onSeek=${seek} onLink=${copyLink} onHelp=${() => help.current?.showModal()} />
    ${link && html`<p><label>The link to this moment <input readonly value=${link} /></label></p>`}
    <${Scrubber} pair=${pair} worths=${worths} round=${round} parting=${parting} isLive=${isLive(a.head) || isLive(b.head)} onGo=${jump} />
    <${Announced} text=${sentence} />
    ${isCommon && html`<${AgentTable} round=${round} agent=${agent} agents=${found.agents} a=${one} b=${other} />`}
    <${Settings} a=${a.summary} b=${b.summary} />
    <${KeyHelp} dialog=${help} help=${HELP} />
  `;
}

/** @type {ReturnType<typeof differences>} */
const NOTHING = { agents: new Map(), things: [], isPlaced: false, any: false };

/** Goes to the next difference, one search at a time. @param {Pair} pair @param {number} round @param {(round: number) => void} onFound */
function useSeek(pair, round, onFound) {
  const running = useRef(/** @type {AbortController | null} */ (null));
  useEffect(() => () => running.current?.abort(), [pair]);
  return async (/** @type {1 | -1} */ step) => {
    if (obstacle(pair.a.head, pair.b.head)) return;
    running.current?.abort();
    const aborted = (running.current = new AbortController());
    const found = await findDifference(pair, round + step, step, aborted.signal).catch(() => null);
    if (found !== null && !aborted.signal.aborted) onFound(found);
  };
}

/** @param {any} props */
const Controls = ({ pair, round, playback, canSeek, onGo, onSeek, onLink, onHelp }) => html`<div class="buttons controls" role="group" aria-label="Rounds">
  <button type="button" onClick=${() => onGo(round - 1)} disabled=${round <= 0}>← Back</button>
  <button type="button" class="primary" onClick=${playback.toggle} disabled=${pair.last === 0}>${playback.isPlaying ? "Pause" : "Play"}</button>
  <button type="button" onClick=${() => onGo(round + 1)} disabled=${round >= pair.last}>Next →</button>
  <label>Speed <select onChange=${(/** @type {any} */ event) => playback.setSpeed(Number(event.currentTarget.value))}>
    ${SPEEDS.map((speed) => html`<option value=${speed} selected=${speed === playback.speed}>${speed}×</option>`)}
  </select></label>
  <button type="button" onClick=${() => onSeek(-1)} disabled=${!canSeek}>Difference before</button>
  <button type="button" onClick=${() => onSeek(1)} disabled=${!canSeek}>Next difference</button>
  <button type="button" onClick=${onLink}>Copy a link to this moment</button>
  <button type="button" class="quiet" onClick=${onHelp}>Keys ?</button>
  <span class="number">Round <strong>${round}</strong> of ${pair.last}</span>
</div>`;

/** @param {number} round @param {any[]} moments @param {typeof NOTHING} found @param {string} why */
function inWords(round, [one, other], found, why) {
  const scores = `Round ${round}. Scores ${short(one.state.score)} and ${short(other.state.score)}.`;
  if (why) return scores;
  if (!found.any) return `${scores} Nothing differs.`;
  const agents = [...found.agents.keys()];
  const listed = `${agents.slice(0, 12).join(", ")}${agents.length > 12 ? " and more" : ""}`;
  const who = agents.length ? `${agents.length === 1 ? "agent" : "agents"} ${listed}` : "";
  return `${scores} Different: ${[...found.things, who].filter(Boolean).join(", ")}.`;
}

/** Text for screen readers, announced when it no longer changes. @param {{text: string}} props */
function Announced({ text }) {
  const [said, setSaid] = useState("");
  useEffect(() => {
    const timer = setTimeout(() => setSaid(text), ANNOUNCE_MS);
    return () => clearTimeout(timer);
  }, [text]);
  return html`<p class="now">${text}</p><p class="unseen" aria-live="polite">${said}</p>`;
}
