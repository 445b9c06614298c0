// Two games in step.
import { html, useEffect, useMemo, useRef, useState } from "../ui.js";
import { visit } from "../app.js";
import { Choose, Suggestions, addressOf, nameOf } from "../compare/choose.js";
import { differences, findDifference, obstacle, pairOf, readId, sameGround } from "../compare/pair.js";
import { AgentTable, Parting, Settings, Side } from "../compare/sides.js";
import { PARTS } from "../game/parts.js";
import { linkTo, usePlace } from "../game/place.js";
import { Announcer, Controls, Toggles, usePlayer } from "../game/player.js";
import { list } from "../game/round.js";
import { Scrubber, useTrack } from "../game/scrubber.js";
import { useCopied } from "../parts/copied.js";
import { isLive, useChanges, useMoment } from "../parts/game.js";
import { Loaded, useLoaded } from "../parts/load.js";
import { ProblemNote, Waiting } from "../parts/problem.js";
import { openGame } from "../parts/served.js";
import { short } from "../parts/chart.js";

/** @param {{query: URLSearchParams}} props */
export function Page({ query }) {
  const [a, b] = [readId(query.get("a") ?? ""), readId(query.get("b") ?? "")];
  return html`<h1>Compare two games</h1>
    ${a && b
      ? html`<details><summary>Choose other games</summary><${Choose} a=${a} b=${b} /></details><${Opened} a=${a} b=${b} />`
      : html`<${Choose} a=${a} b=${b} /><${Suggestions} a=${a || b} />`}`;
}

/** @param {{a: string, b: string}} props */
function Opened({ a, b }) {
  const one = useLoaded((signal) => openGame(a, signal), [a]);
  const other = useLoaded((signal) => openGame(b, signal), [b]);
  const pair = useMemo(() => one.value && other.value && pairOf(one.value, other.value), [one.value, other.value]);
  useEffect(() => {
    if (!pair) return;
    document.title = `${nameOf(pair.a)} and ${nameOf(pair.b)} · compare`;
    const aborted = new AbortController();
    // The games themselves show a broken connection, as lost.
    for (const game of [pair.a, pair.b]) if (isLive(game.head)) game.follow(aborted.signal).catch(() => {});
    return () => aborted.abort();
  }, [pair]);
  return pair ? html`<${InStep} pair=${pair} />` : html`<${Loaded} of=${one} what="Game A" /><${Loaded} of=${other} what="Game B" />`;
}

/** @import { Pair } from "../compare/pair.js" */

/** @param {{pair: Pair}} props */
function InStep({ pair }) {
  const { a, b } = pair;
  const count = useChanges(a) + useChanges(b);
  const [place, move] = usePlace();
  const [messages, setMessages] = useState(true);
  const [parting, setParting] = useState(/** @type {number | null} */ (null));
  const { copy, note } = useCopied();
  const round = Math.min(place.round ?? 0, pair.last);
  const agents = Math.max(a.head.num_agents, b.head.num_agents);
  const agent = Math.min(place.agent ?? 0, agents - 1);
  const tracks = [useTrack(a, count), useTrack(b, count)];
  const [one, other] = [useMoment(a, Math.min(round, a.last)), useMoment(b, Math.min(round, b.last))];

  const onRound = (/** @type {number} */ round) => move({ round });
  const onAgent = (/** @type {number} */ agent) => move({ agent });
  const seek = useSeek(pair, round, (found) => player.jump(found));
  const here = linkTo({ ...place, round, agent });
  const link = () => copy(here, `the link to round ${round}`);
  const swap = () => visit(addressOf(b.head.id, a.head.id) + new URL(here).hash);
  const keys = { m: () => setMessages(!messages), x: swap, l: link };
  const player = usePlayer({ game: pair, round, first: 0, last: pair.last, agent, agents, onRound, onAgent, onMark: seek, mark: "difference", keys, parts: PARTS });

  const problem = one.problem ?? other.problem;
  if (!one.state || !other.state) return html`<${Waiting} of=${{ problem }} />`;
  const why = obstacle(a.head, b.head);
  const isCommon = !why && round <= pair.common;
  const found = isCommon ? differences(a.head, /** @type {any} */ (one), /** @type {any} */ (other)) : NOTHING;
  const marks = new Set(found.agents.keys());
  const side = { round, agent, marks, messages, onChoose: onAgent };
  const sentence = inWords(round, [one, other], found, why);
  const menu = html`<button type="button" onClick=${link}>Copy a link to this moment</button> <button type="button" onClick=${swap}>Swap the games</button>`;
  return html`
    ${problem && html`<${ProblemNote} problem=${problem} />`}
    ${(a.isLost || b.isLost) && html`<p class="bad" role="status">The connection to a running game is lost. It is opened again by itself.</p>`}
    ${why
      ? html`<p class="notice">${why}: rounds and scores are compared, agents and places are not.</p>`
      : html`<${Parting} pair=${pair} isGroundSame=${sameGround(pair)} onFound=${setParting} onGo=${player.jump} />`}
    <div class="watch">
      <div class="sides">
        <${Side} name="A" track=${tracks[0]} moment=${one} ...${side} />
        <${Side} name="B" track=${tracks[1]} moment=${other} ...${side} />
      </div>
      <${Controls} player=${player} canMark=${(/** @type {1 | -1} */ way) => !why && round + way >= 0 && round + way <= pair.common} menu=${menu}>
        <span class="number">Round <strong>${round}</strong> of ${pair.last}</span>
        <span class="muted" role="status">${note}</span>
      <//>
      <${Scrubber} tracks=${tracks} player=${player} last=${pair.last} count=${count} parting=${parting} />
      <${Toggles} player=${player} toggles=${[["Lines of messages", messages, keys.m]]} />
    </div>
    <p class="differences">${sentence}</p>
    <${Announcer} text=${sentence} />
    ${isCommon && html`<${AgentTable} head=${a.head} round=${round} agent=${agent} agents=${found.agents} a=${one} b=${other} />`}
    <${Settings} a=${a.summary} b=${b.summary} />
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

/** @param {number} round @param {any[]} moments @param {typeof NOTHING} found @param {string} why */
function inWords(round, [one, other], found, why) {
  const scores = `Round ${round}. Scores ${short(one.state.score)} and ${short(other.state.score)}.`;
  if (why) return scores;
  if (!found.any) return `${scores} Nothing differs.`;
  const agents = [...found.agents.keys()];
  const who = agents.length ? `${agents.length === 1 ? "agent" : "agents"} ${list(agents)}` : "";
  return `${scores} Different: ${[...found.things, who].filter(Boolean).join(", ")}.`;
}
