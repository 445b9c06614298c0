// The curve of the score, on which a click goes to a round.
import { html, useMemo, useState } from "../ui.js";
import { extent, short, stepPath } from "../parts/chart.js";
import { useLoaded } from "../parts/load.js";
import { isLive } from "../parts/game.js";
import { WorthCurve } from "../parts/worth.js";
import { MARKS, inWords, isShort } from "./marks.js";

/** @import { Game } from "../parts/game.js" */
/** @import { Decision, Worth } from "../parts/worth.js" */

const [WIDTH, HEIGHT] = [1000, 60];

/** The maximum number of marks; of more, some stand for their neighbours. */
const COLUMNS = 160;

/** The interval between reads of a running game's curve. */
const RELOAD_MS = 10_000;

/**
 * Points of the curve: rounds and scores. States give newer points.
 * @param {Game} game
 * @param {number} count changes with the states
 * @returns {[number, number][]}
 */
function usePoints(game, count) {
  const { value } = useLoaded(() => game.scores(), [game, game.head.status], isLive(game.head) ? RELOAD_MS : undefined);
  return useMemo(() => {
    /** @type {[number, number][]} */
    const points = [];
    const known = value?.rounds ?? -1;
    value?.scores.forEach((/** @type {number} */ score, /** @type {number} */ index) => points.push([Math.min((value.first ?? 0) + index * value.every, known), score]));
    for (let round = known + 1; round <= game.last; round++) {
      const state = game.peek(round);
      if (state) points.push([round, state.score]);
    }
    return points;
  }, [value, count]);
}

/**
 * @param {{game: Game, count: number, round: number, worth: Worth | null, isExpected: boolean, decisions: Decision[], onGo: (round: number) => void}} props
 *   `isExpected`: the worth may come yet; `decisions` lost most
 */
export function Scrubber({ game, count, round, worth, isExpected, decisions, onGo }) {
  const [hovered, setHovered] = useState(/** @type {number | null} */ (null));
  const points = usePoints(game, count);
  const [first, last] = [game.first, Math.max(game.last, game.first + 1)];
  const x = (/** @type {number} */ at) => (at - first) / (last - first);
  const columns = useMemo(() => markColumns(game), [count, last]);
  /** @param {MouseEvent} event */
  const roundAt = (event) => {
    const box = /** @type {Element} */ (event.currentTarget).getBoundingClientRect();
    const at = first + ((event.clientX - box.left) / box.width) * (last - first);
    const marks = [...columns.values(), decisions].flat().map(({ round }) => round);
    const near = marks.find((mark) => Math.abs(x(mark) - x(at)) * box.width < 5);
    return Math.min(Math.max(near ?? Math.round(at), first), game.last);
  };
  const pointer = {
    onClick: (/** @type {MouseEvent} */ event) => onGo(roundAt(event)),
    onMouseMove: (/** @type {MouseEvent} */ event) => setHovered(roundAt(event)),
    onMouseLeave: () => setHovered(null),
  };
  /** @param {number} at */
  const numbers = (at) => `${game.peek(at) ? `, score ${short(game.peek(at)?.score)}` : ""}${worth?.values?.[at] !== undefined ? `, worth ${short(worth.values[at])}` : ""}`;
  return html`<div class="scrubber">
    <div class="curve" ...${pointer}>
      <${Curve} points=${points} x=${x} at=${round} />
      ${[...columns].map(([row, marks]) => html`<div class=${`marks ${row}`} aria-hidden="true">
        ${marks.map(({ round, mark }) => html`<span class=${MARKS[mark].kind} style=${{ left: `${x(round) * 100}%` }}>${MARKS[mark].sign}</span>`)}
      </div>`)}
      ${hovered !== null && html`<div class="hovered" style=${x(hovered) < 0.5 ? { left: `${x(hovered) * 100}%` } : { right: `${(1 - x(hovered)) * 100}%` }}>
        round ${hovered}${numbers(hovered)}${game.marks.has(hovered) && `: ${inWords(game.marks.get(hovered))}`}
      </div>`}
    </div>
    <input
      type="range"
      min=${first}
      max=${game.last}
      value=${round}
      aria-label="Round"
      aria-valuetext=${`round ${round} of ${game.last}${numbers(round)}`}
      onInput=${(/** @type {any} */ event) => onGo(Number(event.currentTarget.value))}
    />
    ${(isExpected || worth?.values) && html`<div class="curve future" ...${pointer}>
      ${worth ? html`<${WorthCurve} worth=${worth} points=${points} first=${first} last=${last} x=${x} at=${round} decisions=${decisions} />` : html`<span class="low" role="status">Working out what could still be scored …</span>`}
    </div>`}
    ${!isShort(game) && html`<p class="muted small">A long game: marks are shown where it was read. “Next mark” reads on.</p>`}
  </div>`;
}

/** @param {{points: [number, number][], x: (round: number) => number, at: number}} props */
function Curve({ points, x, at }) {
  const [low, high] = extent(points.map(([, score]) => score));
  const y = (/** @type {number} */ score) => HEIGHT - 4 - ((score - low) / (high - low)) * (HEIGHT - 8);
  const path = useMemo(() => stepPath(points, (round) => x(round) * WIDTH, y), [points]);
  const isFlat = points.length > 0 && points.every(([, score]) => score === points[0][1]);
  return html`<svg viewBox=${`0 0 ${WIDTH} ${HEIGHT}`} preserveAspectRatio="none" aria-hidden="true">
      <path class="score" d=${path} />
      <line class="now" x1=${x(at) * WIDTH} x2=${x(at) * WIDTH} y1="0" y2=${HEIGHT} />
    </svg>
    <span class="high" aria-hidden="true">${isFlat ? "" : short(high)}</span>
    <span class="low" aria-hidden="true">score ${isFlat ? short(points[0][1]) : short(low)}</span>`;
}

/**
 * Marks in two rows: scores and messages, and failures. One mark per column.
 * @param {Game} game
 * @returns {Map<string, {round: number, mark: string}[]>}
 */
function markColumns({ marks, first, last }) {
  const rows = new Map([["upper", new Map()], ["lower", new Map()]]);
  for (const [round, names] of marks) {
    const column = Math.floor(((round - first) / Math.max(last - first, 1)) * COLUMNS);
    for (const mark of names) {
      if (!MARKS[mark]) continue;
      const row = rows.get(MARKS[mark].kind === "bad" ? "lower" : "upper");
      if (row && !row.has(column)) row.set(column, { round, mark });
    }
  }
  return new Map([...rows].map(([name, row]) => [name, [...row.values()]]));
}
