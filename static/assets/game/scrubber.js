// Curves of one game or of two, on which a click goes to a round.
import { html, useMemo, useState } from "../ui.js";
import { agentOf } from "../parts/actions.js";
import { extent, short, stepPath } from "../parts/chart.js";
import { color, dashes } from "../parts/colors.js";
import { useLoaded } from "../parts/load.js";
import { isLive } from "../parts/game.js";
import { useWorth } from "../parts/worth.js";
import { MARKS, inWords } from "./marks.js";

/** @import { Game } from "../parts/game.js" */
/** @import { Appraisal, Decision } from "../parts/worth.js" */
/** @import { Player } from "./player.js" */
/** @typedef {[number, number]} Point a round and a value */
/** @typedef {Appraisal & {game: Game, points: Point[]}} Track a game with its score and its worth */

const [WIDTH, HEIGHT] = [1000, 60];

/** The maximum number of marks; of more, some stand for their neighbours. */
const COLUMNS = 160;

/** The distance from a mark, in pixels, at which a click means it. */
const NEAR_PX = 5;

/** Marks of what a round led to: they stand at the state after it, where the curve rises or falls. */
const AFTERWARDS = new Set(["points", "drop"]);

/** The interval between reads of a running game's curve. */
const RELOAD_MS = 10_000;

/**
 * A game with its curves. States give newer points of the score than the curve.
 * @param {Game} game @param {number} count changes with the states @returns {Track}
 */
export function useTrack(game, count) {
  const appraisal = useWorth(game);
  const { value } = useLoaded(() => game.scores(), [game, game.head.status], isLive(game.head) ? RELOAD_MS : undefined);
  const points = useMemo(() => {
    const known = value?.rounds ?? -1;
    /** @type {Point[]} */
    const points = (value?.scores ?? []).map((score, index) => [Math.min((value?.first ?? 0) + index * (value?.every ?? 1), known), score]);
    for (let round = known + 1; round <= game.last; round++) {
      const state = game.peek(round);
      if (state) points.push([round, state.score]);
    }
    return points;
  }, [value, count]);
  return { game, points, ...appraisal };
}

/**
 * @param {{tracks: Track[], player: Player, last: number, count: number, decisions?: Decision[], parting?: number | null}} props `tracks`: one
 *   game, or two that are compared; `last`: the last round of the axis; `count` changes with the states; `decisions`: those that lost most;
 *   `parting`: the round where two games part
 */
export function Scrubber({ tracks, player, last: end, count, decisions = [], parting = null }) {
  const { first, last: newest, round, jump } = player;
  const [hovered, setHovered] = useState(/** @type {number | null} */ (null));
  const last = Math.max(end, first + 1);
  const [{ game }] = tracks;
  const isOne = tracks.length === 1;
  const x = (/** @type {number} */ at) => (at - first) / (last - first);
  const rows = useMemo(() => (isOne ? markRows(game) : []), [count, last]);
  const points = tracks.map((track) => track.points);
  const worths = tracks.map(({ worth }) => worth);
  /** @param {Appraisal["worth"]} worth @returns {Point[]} */
  const pointsOf = (worth) => (worth?.values ?? []).map((value, at) => [at, value]);
  const values = useMemo(() => worths.map((worth) => pointsOf(worth).slice(first, last + 1)), [last, ...worths]);
  const isExpected = tracks.some(({ worth, isExpected }) => isExpected || worth?.values);
  const roundAt = (event) => {
    const box = /** @type {Element} */ (event.currentTarget).getBoundingClientRect();
    const at = first + ((event.clientX - box.left) / box.width) * (last - first);
    const near = [...rows, decisions].flat().find((mark) => Math.abs(x(mark.round) - x(at)) * box.width < NEAR_PX);
    return Math.min(Math.max(near?.round ?? Math.round(at), first), newest);
  };
  const pointer = {
    onClick: (/** @type {MouseEvent} */ event) => jump(roundAt(event)),
    onMouseMove: (/** @type {MouseEvent} */ event) => setHovered(roundAt(event)),
    onMouseLeave: () => setHovered(null),
  };
  /** @param {number} at */
  const numbers = (at) => tracks.map(({ game, worth: known }, index) => {
    const [score, worth] = [game.peek(at)?.score, known?.values?.[at]];
    return `${isOne ? "" : `, ${"AB"[index]}`}${score !== undefined ? `${isOne ? ", " : " "}score ${short(score)}` : ""}${worth !== undefined ? `, worth ${short(worth)}` : ""}`;
  }).join("");
  const plot = { x, at: round, parting };
  return html`<div class="scrubber">
    <div class="curve" ...${pointer}>
      <${Plot} name="score" curves=${points} ...${plot} />
      ${rows.map((marks, row) => html`<div key=${row} class="marks" aria-hidden="true">
        ${marks.map(({ round, mark }) => html`<span class=${MARKS[mark].kind} style=${{ left: `${x(round) * 100}%` }}>${MARKS[mark].sign}</span>`)}
      </div>`)}
      ${hovered !== null && html`<div class="hovered" style=${x(hovered) < 0.5 ? { left: `${x(hovered) * 100}%` } : { right: `${(1 - x(hovered)) * 100}%` }}>
        round ${hovered}${numbers(hovered)}${isOne && game.marks.has(hovered) && `: ${inWords(game.marks.get(hovered))}`}
      </div>`}
    </div>
    <input type="range" min=${first} max=${newest} value=${round} aria-label="Round" style=${{ width: `calc(16px + (100% - 16px) * ${x(newest)})` }}
      aria-valuetext=${`round ${round} of ${newest}${numbers(round)}`} onInput=${(event) => jump(Number(event.currentTarget.value))} />
    ${isExpected && html`<div class="curve future" ...${pointer}>
      ${values.some(({ length }) => length > 0)
        ? html`<${Plot} name="worth" curves=${values} scores=${points} ...${plot} /><${Dearest} decisions=${decisions} x=${x} />`
        : html`<span class="low" role="status">Working out what could still be scored …</span>`}
    </div>`}
    ${!isOne && html`<p class="small muted">
      ${tracks.map((_, index) => html`<span class="legend">
        <svg width="24" height="8" aria-hidden="true"><line x1="0" x2="24" y1="4" y2="4" stroke=${color(index)} stroke-dasharray=${dashes(index)} stroke-width="2" /></svg> ${"AB"[index]}
      </span>`)}
      ${parting !== null && html`<span class="legend"><svg width="8" height="14" aria-hidden="true"><line class="parting" x1="4" x2="4" y1="0" y2="14" /></svg> they part</span>`}
    </p>`}
  </div>`;
}

/**
 * Curves over each other. Worth stands on one scale with the score, which is filled below that of one game.
 * @param {{name: string, curves: Point[][], scores?: Point[][], x: (round: number) => number, at: number, parting: number | null}} props
 */
function Plot({ name, curves, scores = [], x, at, parting }) {
  const isOne = curves.length === 1;
  const { low, high, paths, area, start } = useMemo(() => {
    const all = [...curves, ...scores].flat().map(([, value]) => value);
    const [low, high] = extent(scores.length ? [0, ...all] : all);
    const y = (/** @type {number} */ value) => HEIGHT - 4 - ((value - low) / (high - low)) * (HEIGHT - 8);
    const [area, ...paths] = [isOne ? (scores[0] ?? []) : [], ...curves].map((points) => stepPath(points, (round) => x(round) * WIDTH, y));
    return { low, high, paths, area, start: isOne && scores.length ? y(curves[0][0]?.[1] ?? 0) : null };
  }, [...curves, ...scores]);
  const isFlat = !scores.length && curves.flat().every(([, value]) => value === curves[0][0]?.[1]);
  const rule = (/** @type {string} */ kind, /** @type {number} */ round) => html`<line class=${kind} x1=${x(round) * WIDTH} x2=${x(round) * WIDTH} y1="0" y2=${HEIGHT} />`;
  return html`<svg viewBox=${`0 0 ${WIDTH} ${HEIGHT}`} preserveAspectRatio="none" aria-hidden="true">
      ${parting !== null && rule("parting", parting)}
      ${area && html`<path class="area" d=${`${area}V${HEIGHT}H0Z`} />`}
      ${paths.map((path, index) => html`<path class=${name} d=${path} ...${isOne ? {} : { stroke: color(index), "stroke-dasharray": dashes(index) }} />`)}
      ${start !== null && html`<line class="start" x1="0" x2=${WIDTH} y1=${start} y2=${start} />`}
      ${rule("now", at)}
    </svg>
    <span class="high" aria-hidden="true">${isFlat ? "" : short(high)}</span>
    <span class="low" aria-hidden="true">${name} ${scores.length ? "" : short(isFlat ? (curves[0][0]?.[1] ?? 0) : low)}</span>`;
}

/** Seats whose decisions lost most, in two rows under the curve. @param {{decisions: Decision[], x: (round: number) => number}} props */
function Dearest({ decisions, x }) {
  const rounds = [...new Set(decisions.map(({ round }) => round))].sort((one, other) => one - other);
  const seats = (/** @type {number} */ round) => decisions.filter((decision) => decision.round === round).map(agentOf).join();
  return [0, 1].map((row) => rounds.length > row && html`<div class="marks" aria-hidden="true">
    ${rounds.filter((_, index) => index % 2 === row).map((round) => html`<span class="bad" style=${{ left: `${x(round) * 100}%` }}>${seats(round)}?</span>`)}
  </div>`);
}

/**
 * Marks in two rows: scores and messages, and failures. One mark per column.
 * @param {Game} game
 * @returns {{round: number, mark: string}[][]}
 */
function markRows({ marks, first, last }) {
  const rows = [new Map(), new Map()];
  for (const [decided, names] of marks) {
    for (const mark of names.filter((name) => MARKS[name])) {
      const round = decided + Number(AFTERWARDS.has(mark));
      const column = Math.floor(((round - first) / Math.max(last - first, 1)) * COLUMNS);
      const row = rows[Number(MARKS[mark].kind === "bad")];
      if (!row.has(column)) row.set(column, { round, mark });
    }
  }
  return rows.map((row) => [...row.values()]);
}
