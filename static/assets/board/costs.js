// Score against cost: the rows of a board with a known cost as points, and those that no other beats for as little.
import { html, useLayoutEffect, useRef, useState } from "../ui.js";
import { Settings, rowHref, totalOf } from "../parts/boards.js";
import { alike, dollars, extent, scaled, short, stepPath } from "../parts/chart.js";
import { Text, visible } from "../parts/text.js";
import { hasCost } from "./rows.js";

/** By how many times the highest cost may exceed the lowest before the axis is logarithmic. */
const LINEAR_MAX = 20;

/** The size of the figure, its margins, the radius of a point, and the widths of a character and a tick's number, in pixels. */
const [WIDTH_MAX, HEIGHT, LEFT, RIGHT, TOP, BOTTOM, RADIUS, CHAR, TICK] = [760, 340, 52, 16, 16, 44, 5, 6.7, 60];

/** The part of the axis for costs of 0, which have no logarithm. */
const FREE = 40;

/** The maximum number of characters of a name in the figure. */
const NAME_CHARS = 24;

/**
 * A row of the board; isWhole: whether the cost of all its answers is known; isBest: whether no row scores as much for less, or more for
 * as much.
 * @typedef {{row: any, name: string, cost: number, isWhole: boolean, of: NonNullable<ReturnType<typeof totalOf>>, isBest: boolean}} Point
 */

/** @param {any[]} rows @param {any} board @returns {Point[]} */
function pointsOf(rows, board) {
  const points = rows.filter(hasCost).flatMap((row) => {
    const [of, name] = [totalOf(row, board.tasks), [...visible(row.model)]];
    const brief = name.length > NAME_CHARS ? `${name.slice(0, NAME_CHARS - 1).join("")}…` : name.join("");
    return of ? [{ row, of, name: brief, cost: row.cost_usd, isWhole: row.costs_are_whole, isBest: false }] : [];
  });
  const beats = (/** @type {Point} */ one, /** @type {Point} */ other) =>
    one.isWhole && one.cost <= other.cost && one.of.mean >= other.of.mean && (one.cost < other.cost || one.of.mean > other.of.mean);
  return points.map((point) => ({ ...point, isBest: point.isWhole && !points.some((other) => beats(other, point)) }));
}

/** Round numbers in a range, about five. @param {[number, number]} range */
function ticksOf([low, high]) {
  const power = 10 ** Math.floor(Math.log10(high - low));
  const step = [0.1, 0.2, 0.5, 1, 2].map((part) => part * power).find((step) => (high - low) / step <= 6) ?? power;
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, index) => Number(((first + index) * step).toPrecision(12)));
}

/** The axis of costs. @param {number[]} costs @param {number} right */
function costAxis(costs, right) {
  const known = costs.filter((cost) => cost > 0);
  const [low, high] = [Math.min(...known), Math.max(...known)];
  if (high <= LINEAR_MAX * low || known.length === 0) {
    /** @type {[number, number]} */
    const range = [0, high * 1.1];
    return { x: scaled(range, [LEFT, right]), ticks: ticksOf(range), isLog: false };
  }
  const [from, to] = [Math.floor(Math.log10(low)), Math.ceil(Math.log10(high))];
  const isFree = known.length < costs.length;
  const at = scaled([from, to], [LEFT + (isFree ? FREE : 0), right]);
  const powers = Array.from({ length: to - from + 1 }, (_, index) => Number(`1e${from + index}`));
  return { x: (/** @type {number} */ cost) => (cost > 0 ? at(Math.log10(cost)) : LEFT), ticks: isFree ? [0, ...powers] : powers, isLog: true };
}

/**
 * Names beside their points, as far as there is room: those of the best first.
 * @param {(Point & {x: number, y: number})[]} points @param {number} right
 */
function placed(points, right) {
  const taken = points.map(({ x, y }) => [x - RADIUS, y - RADIUS, x + RADIUS, y + RADIUS]);
  const names = new Map();
  for (const point of points.toSorted((one, other) => Number(other.isBest) - Number(one.isBest))) {
    const { x, y, name, isBest } = point;
    const width = [...name].length * CHAR;
    // The line leaves a point to the right.
    const places = [[x + 9, isBest ? y - 7 : y + 4], [x - 9 - width, y + 4], [x - width / 2, y - 10], [x - width / 2, y + 18]];
    const found = places.find(([left, base]) => {
      const box = [left, base - 10, left + width, base + 3];
      const isInside = left >= LEFT && left + width <= right + RIGHT && base - 10 >= 0 && base <= HEIGHT - BOTTOM;
      return isInside && !taken.some((other) => box[0] < other[2] && other[0] < box[2] && box[1] < other[3] && other[1] < box[3]);
    });
    if (!found) continue;
    taken.push([found[0], found[1] - 10, found[0] + width, found[1] + 3]);
    names.set(point, found);
  }
  return names;
}

/** @param {Point} point */
const costText = ({ cost, isWhole }) => `${isWhole ? "" : "at least "}$${dollars(cost)}`;

/** @param {{rows: any[], board: any}} props */
export function Costs({ rows, board }) {
  const place = useRef(/** @type {HTMLElement | null} */ (null));
  const [width, setWidth] = useState(0);
  useLayoutEffect(() => {
    const observer = new ResizeObserver(([{ contentRect }]) => setWidth(Math.min(Math.round(contentRect.width), WIDTH_MAX)));
    observer.observe(/** @type {HTMLElement} */ (place.current));
    return () => observer.disconnect();
  }, []);
  const points = pointsOf(rows, board);
  const best = points.filter(({ isBest }) => isBest).sort((one, other) => one.cost - other.cost);
  return html`<div ref=${place}>
    ${width > 0 && html`<${Figure} points=${points} best=${best} board=${board} width=${width} />`}
    <p class="small muted">
      ${points.length} rows with a known cost; the table has all numbers. ◆ on the line: no other row scores as much for less, or more for as
      much. ${points.some(({ isWhole }) => !isWhole) && "A dashed ring: the cost of some answers is unknown, so the row costs more. "}Upright lines are intervals of 95 %.
    </p>
    <p class="small"><strong>On the line, cheapest first</strong></p>
    <ol class="small">
      ${best.map((point) => html`<li><a href=${rowHref(board, point.row)}><${Text} value=${point.row.model} /></a> <${Settings} row=${point.row} />${" "}
        <span class="number">${short(point.of.mean)} for ${costText(point)}</span></li>`)}
    </ol>
  </div>`;
}

/** @param {{points: Point[], best: Point[], board: any, width: number}} props */
function Figure({ points, best, board, width }) {
  const [right, bottom] = [width - RIGHT, HEIGHT - BOTTOM];
  const { x, ticks, isLog } = costAxis(points.map(({ cost }) => cost), right);
  const [low, high] = extent(points.flatMap(({ of }) => [of.mean, 0]));
  /** @type {[number, number]} */
  const range = [low, high + (high - low) * 0.08];
  const y = scaled(range, [bottom, TOP]);
  const bounded = (/** @type {number} */ score) => y(Math.min(Math.max(score, range[0]), range[1]));
  const drawn = points.map((point) => ({ ...point, x: x(point.cost), y: y(point.of.mean) }));
  const names = placed(drawn, right);
  const every = Math.ceil((ticks.length * TICK) / (right - LEFT));
  const scores = ticksOf(range);
  const text = alike(scores);
  const front = stepPath(best.map(({ cost, of }) => [cost, of.mean]), x, y);
  return html`<figure class="chart costs">
    <svg viewBox=${`0 0 ${width} ${HEIGHT}`} width=${width} height=${HEIGHT} role="group" aria-label=${`Score against cost of ${points.length} rows`}>
      <g aria-hidden="true">
        ${scores.map((tick) => html`<line class="grid" x1=${LEFT} x2=${right} y1=${y(tick)} y2=${y(tick)} />
          <text x=${LEFT - 8} y=${y(tick) + 4} text-anchor="end">${text(tick)}</text>`)}
        ${ticks.map((tick, place) => html`<line class="grid" x1=${x(tick)} x2=${x(tick)} y1=${TOP} y2=${bottom} />
          ${place % every === 0 && html`<text x=${x(tick)} y=${bottom + 16} text-anchor="middle">${dollars(tick)}</text>`}`)}
        <text x=${right} y=${HEIGHT - 8} text-anchor="end">$ a game${isLog ? ", by powers of ten" : ""}</text>
        <text x="0" y="10">${board.tasks.length > 1 ? "total" : board.tasks[0]}</text>
        <path class="front" d=${front} />
      </g>
      ${drawn.map((point) => html`<${Mark} key=${point.row.id} point=${point} name=${names.get(point)} bounded=${bounded} href=${rowHref(board, point.row)} />`)}
    </svg>
  </figure>`;
}

/** A point as a link to its row. @param {{point: Point & {x: number, y: number}, name?: [number, number], bounded: (score: number) => number, href: string}} props */
function Mark({ point, name, bounded, href }) {
  const { x, y, of, isBest, isWhole } = point;
  const label = `${visible(point.row.model)}: ${short(of.mean)} for ${costText(point)} a game${isBest ? ", none scores more for as little" : ""}`;
  return html`<a href=${href} aria-label=${label} class=${isBest ? "best" : isWhole ? "" : "open"}>
    <title>${label}</title>
    ${of.low !== null && html`<line class="range" x1=${x} x2=${x} y1=${bounded(of.low)} y2=${bounded(of.high ?? of.mean)} />`}
    ${isBest ? html`<path d=${`M${x} ${y - 7}l7 7l-7 7l-7 -7Z`} />` : html`<circle cx=${x} cy=${y} r=${RADIUS} />`}
    ${name && html`<text x=${name[0]} y=${name[1]}>${point.name}</text>`}
  </a>`;
}
