// What could still be scored: the worth of a game's states, as a bar beside the map, a curve over the rounds and in words, the
// decisions that lost most, and how the reference would play on.
import { html, useEffect, useMemo, useState } from "../ui.js";
import { short } from "./chart.js";
import { isLive } from "./game.js";
import { useLoaded } from "./load.js";
import { ProblemNote } from "./problem.js";
import { Text } from "./text.js";

/** @import { Game } from "./game.js" */

/**
 * @typedef {{round: number, agent: string, loss: number, words: string}} Decision a decision that lost much
 *
 * @typedef {object} Worth the answer of the route `worth`
 * @property {string} reference
 * @property {number[] | null} values by state: the score that the reference reaches from there
 * @property {boolean | null} [reference_is_weak]
 * @property {Decision[] | null} [dearest]
 * @property {{part: string, detail: string}[]} [missing]
 *
 * @typedef {{scored: number, open: number, lost: number}} Shares `lost` is below 0 where the swarm found something better
 *
 * @typedef {{worth: Worth | null, isExpected: boolean}} Appraisal `isExpected`: the worth may come yet
 *
 * @typedef {{known: Worth | null, decisions: Decision[], problem: Error | null, reload: () => void, ask: () => void}} Losses
 */

/** The interval between reads of the worth of a running game. */
const RELOAD_MS = 30_000;

/** Differences below this come from rounding. */
const NEGLIGIBLE = 1e-9;

/** @type {[keyof Shares, string][]} */
const PARTS = [["lost", "lost"], ["open", "can still be scored"], ["scored", "scored"]];

/**
 * Whether the reader may know how a game could go on: a reader who is told the seed, and not while others hold seats.
 * @param {Game} game
 */
function isForeseeable({ kind, head, summary: { config } }) {
  if (kind !== "episodes") return kind === "file";
  return (config?.seed ?? null) !== null && head.status !== "waiting" && !(isLive(head) && config.open_seats > 0);
}

/**
 * The worth of a game's states without the losses of seats, which take long. A refusal shows nothing.
 * @param {Game} game
 * @returns {Appraisal}
 */
export function useWorth(game) {
  const may = isForeseeable(game);
  const live = isLive(game.head);
  const { value, isLoading } = useLoaded(async (signal) => (may ? game.worth(false, signal) : null), [game, may, live], may && live ? RELOAD_MS : undefined);
  return { worth: may ? value : null, isExpected: may && isLoading && !value };
}

/**
 * The parts of what could be scored from the start, or null while the worth of a state is unknown.
 * @param {Worth | null} worth
 * @param {{round: number, score: number}} state
 * @returns {Shares | null}
 */
export function sharesOf(worth, { round, score }) {
  const [first, value] = [worth?.values?.[0], worth?.values?.[round]];
  if (first === undefined || value === undefined) return null;
  const lost = first - value;
  return { scored: score, open: Math.max(value - score, 0), lost: Math.abs(lost) < NEGLIGIBLE ? 0 : lost };
}

/** @param {Shares} shares */
export function sharesInWords({ scored, open, lost }) {
  const rest = lost < 0 ? `${short(-lost)} gained on what the reference would score from the start` : `${short(lost)} lost`;
  return `${short(scored)} scored, ${short(open)} can still be scored, ${rest}.`;
}

/** The parts as a bar from the bottom up, beside a map. @param {{shares: Shares | null, isExpected?: boolean, children?: unknown}} props */
export function WithBar({ shares, isExpected, children }) {
  if (!shares && !isExpected) return children;
  const all = shares ? shares.scored + shares.open + Math.max(shares.lost, 0) : 0;
  const height = (/** @type {keyof Shares} */ part) => (shares && all > 0 ? `${(Math.max(shares[part], 0) / all) * 100}%` : "0");
  return html`<div class="with-bar">
    <div class="worth-bar" role="img" aria-label=${`Worth. ${shares ? sharesInWords(shares) : "Not known yet."}`}>
      ${PARTS.map(([part]) => html`<div class=${part} style=${{ height: height(part) }}></div>`)}
    </div>
    ${children}
  </div>`;
}

/** The numbers of a bar, and its patterns. @param {{shares: Shares | null}} props */
export const BarLegend = ({ shares }) =>
  shares &&
  html`<p class="bar-legend small">
    ${PARTS.toReversed().map(([part, name]) => html`<span><i class=${part}></i> ${part === "lost" && shares.lost < 0 ? "gained" : name} <b class="number">${short(Math.abs(shares[part]))}</b></span>`)}
  </p>`;

/** Why there is no worth, if the server says so. @param {{worth: Worth | null, part: string}} props */
export const Missing = ({ worth, part }) => {
  const missing = worth?.missing?.find((one) => one.part === part);
  return missing && html`<p class="muted small">${part === "values" ? "What could still be scored" : "What each decision lost"} is not computed: <${Text} value=${missing.detail} />.</p>`;
};

/**
 * The decisions that lost most. The server works them out when they are asked for: that takes up to a minute.
 * @param {Game} game
 * @param {Worth | null} worth
 * @returns {Losses}
 */
export function useLosses(game, worth) {
  const [isAsked, setAsked] = useState(false);
  const { value, problem, reload } = useLoaded(async (signal) => (isAsked ? game.worth(true, signal) : null), [game, isAsked, isLive(game.head)]);
  const known = value ?? (worth?.dearest ? worth : null);
  const decisions = useMemo(() => (known?.dearest ?? []).filter(({ round }) => round >= game.first && round < game.last), [known]);
  return { known, decisions, problem, reload, ask: () => setAsked(true) };
}

/** The reference's next rounds from the shown one, until another is shown. @param {Game} game @param {number} round */
export function useLine(game, round) {
  const [asked, ask] = useState(-1);
  const isAsked = asked === round;
  const { value, problem } = useLoaded(async (signal) => (isAsked ? (game.line?.(round, signal) ?? null) : null), [game, isAsked && round]);
  useEffect(() => ask(-1), [round]);
  const line = isAsked && value?.round === round ? value : null;
  const ghosts = useMemo(() => line?.rounds.map(({ agents }) => ({ at: agents.flatMap(({ at }) => at), gone: agents.flatMap(({ alive }, n) => (alive ? [] : [n])) })), [line]);
  return { line, ghosts, problem: isAsked ? problem : null, isAsked, toggle: () => ask(isAsked ? -1 : round) };
}

/** @param {{line: ReturnType<typeof useLine>, agent: number, onToggle: () => void}} props */
export function PlayOn({ line: { line, problem, isAsked }, agent, onToggle }) {
  const last = line?.rounds.at(-1);
  return html`<div class="play-on">
    <button type="button" aria-pressed=${isAsked} onClick=${onToggle}>Play on from here as the reference would</button>
    <p class="small" role="status">
      ${last && `The outlines are its next ${line?.rounds.length} rounds, to a score of ${short(last.score)}. Agent ${agent} would choose ${line?.rounds.map(({ agents }) => agents[agent].action ?? "nothing").join(", ")}.`}
    </p>
    ${problem && html`<${ProblemNote} problem=${problem} what="The reference’s rounds" />`}
  </div>`;
}
