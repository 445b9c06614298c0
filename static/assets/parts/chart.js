// Small charts in SVG.
import { html } from "../ui.js";

/**
 * The path of a line through values; undefined ones are gaps.
 * @param {(number | null | undefined)[]} values
 * @param {(index: number) => number} x
 * @param {(value: number) => number} y
 */
export const linePath = (values, x, y) =>
  values
    .map((value, index) => (isKnown(value) ? `${isKnown(values[index - 1]) ? "L" : "M"}${x(index).toFixed(2)} ${y(value).toFixed(2)}` : ""))
    .join("");

/** @param {number | null | undefined} value @returns {value is number} */
const isKnown = (value) => value !== null && value !== undefined;

/**
 * The path of a line in steps: a value stays until the next one.
 * @param {[number, number][]} points
 * @param {(at: number) => number} x
 * @param {(value: number) => number} y
 */
export const stepPath = (points, x, y) =>
  points.map(([at, value], index) => `${index ? "H" : "M"}${x(at).toFixed(1)}${index ? "V" : " "}${y(value).toFixed(1)}`).join("");

/**
 * Lowest and highest of values, never equal.
 * @param {(number | null | undefined)[]} values
 * @returns {[number, number]}
 */
export function extent(values) {
  const known = values.filter(isKnown);
  const low = known.reduce((low, value) => Math.min(low, value), Infinity);
  const high = known.reduce((high, value) => Math.max(high, value), -Infinity);
  if (low > high || (low === 0 && high === 0)) return [0, 1];
  return low === high ? [low - 0.5, high + 0.5] : [low, high];
}

/** Moves values of one range evenly to another. @param {[number, number]} from @param {[number, number]} to */
export const scaled = ([low, high], [first, last]) => (/** @type {number} */ value) => first + ((value - low) / (high - low)) * (last - first);

/**
 * A line without axes, as large as a word.
 * @param {{values: (number | null)[], label: string, range?: [number, number], width?: number, height?: number}} props
 */
export function Sparkline({ values, label, range = extent(values), width = 96, height = 24 }) {
  const x = scaled([0, Math.max(values.length - 1, 1)], [1, width - 1]);
  const y = scaled(range, [height - 2, 2]);
  return html`<svg class="sparkline" viewBox=${`0 0 ${width} ${height}`} width=${width} height=${height} role="img" aria-label=${label}>
    <path d=${linePath(values, x, y)} fill="none" stroke="currentColor" stroke-width="1.5" />
  </svg>`;
}

/**
 * An interval as a bar with its mean, on a scale that all rows of a table share; `band` is another one to compare it with.
 * @param {{mean: number, low: number, high: number, range: [number, number], label: string, width?: number,
 *   band?: [number, number] | null}} props
 */
export function Interval({ mean, low, high, range, label, width = 140, band = null }) {
  const at = scaled(range, [4, width - 4]);
  // A bar that begins below the scale is cut off there, without an end.
  const x = (/** @type {number} */ value) => at(Math.max(value, range[0]));
  const end = (/** @type {number} */ value) => html`<line x1=${x(value)} x2=${x(value)} y1="4" y2="12" class="bar-end" />`;
  return html`<svg class="interval" viewBox=${`0 0 ${width} 16`} width=${width} height="16" role="img" aria-label=${label}>
    ${band && html`<rect x=${x(band[0])} width=${Math.max(x(band[1]) - x(band[0]), 1)} y="0" height="16" class="band" />`}
    <line x1=${x(range[0])} x2=${x(range[1])} y1="8" y2="8" class="axis" />
    <line x1=${x(low)} x2=${x(high)} y1="8" y2="8" class="bar" />
    ${low >= range[0] && end(low)}${end(high)}
    <circle cx=${x(mean)} cy="8" r="3.5" class="mean" />
  </svg>`;
}

const INTEGER = new Intl.NumberFormat("en");

/** A number in few characters. @param {number | null | undefined} value */
export function short(value) {
  if (!isKnown(value)) return "–";
  return Number.isInteger(value) ? INTEGER.format(value) : value.toFixed(Math.abs(value) >= 100 ? 1 : 2);
}

const AMOUNT = new Intl.NumberFormat("en", { maximumSignificantDigits: 3, useGrouping: false });

/** An amount of US dollars, which may be a small part of one. @param {number} value */
export const dollars = (value) => (value >= 100 ? value.toFixed(2) : AMOUNT.format(value));

/**
 * Numbers of a column: all with two decimals if one of them is no integer.
 * @param {(number | null | undefined)[]} values
 * @returns {(value: number | null | undefined) => string}
 */
export const alike = (values) =>
  values.every((value) => !isKnown(value) || Number.isInteger(value)) ? short : (value) => value?.toFixed(2) ?? "–";

/** Whether the order of a row and the one above it is uncertain. @param {any} row of a board */
export const isTied = ({ difference }) => difference !== null && difference.low !== null && difference.low < 0;
