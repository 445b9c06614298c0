// Small charts in SVG.
import { html } from "../ui.js";
import { color, dashes } from "./colors.js";

/**
 * The path of a line through values; undefined ones are gaps.
 * @param {(number | null | undefined)[]} values
 * @param {(index: number) => number} x
 * @param {(value: number) => number} y
 */
export function linePath(values, x, y) {
  let path = "";
  let isOpen = false;
  values.forEach((value, index) => {
    if (value === null || value === undefined) {
      isOpen = false;
      return;
    }
    path += `${isOpen ? "L" : "M"}${x(index).toFixed(2)} ${y(value).toFixed(2)}`;
    isOpen = true;
  });
  return path;
}

/**
 * The path of a line in steps: a value stays until the next one.
 * @param {[number, number][]} points
 * @param {(at: number) => number} x
 * @param {(value: number) => number} y
 */
export const stepPath = (points, x, y) => points.map(([at, value], index) => `${index ? "H" : "M"}${x(at).toFixed(1)}${index ? "V" : " "}${y(value).toFixed(1)}`).join("");

/**
 * Lowest and highest of values, never equal.
 * @param {(number | null | undefined)[]} values
 * @returns {[number, number]}
 */
export function extent(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value === null || value === undefined) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  if (low > high) return [0, 1];
  return low === high ? [low - 0.5, high + 0.5] : [low, high];
}

/**
 * A line without axes, as large as a word.
 * @param {{values: (number | null)[], label: string, range?: [number, number], width?: number, height?: number}} props
 */
export function Sparkline({ values, label, range, width = 96, height = 24 }) {
  const [low, high] = range ?? extent(values);
  const last = Math.max(values.length - 1, 1);
  const x = (/** @type {number} */ index) => 1 + (index / last) * (width - 2);
  const y = (/** @type {number} */ value) => height - 2 - ((value - low) / (high - low)) * (height - 4);
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
  const x = (/** @type {number} */ value) => 4 + ((value - range[0]) / (range[1] - range[0])) * (width - 8);
  return html`<svg class="interval" viewBox=${`0 0 ${width} 16`} width=${width} height="16" role="img" aria-label=${label}>
    ${band && html`<rect x=${x(band[0])} width=${Math.max(x(band[1]) - x(band[0]), 1)} y="0" height="16" class="band" />`}
    <line x1="0" x2=${width} y1="8" y2="8" class="axis" />
    <line x1=${x(low)} x2=${x(high)} y1="8" y2="8" class="bar" />
    <line x1=${x(low)} x2=${x(low)} y1="4" y2="12" class="bar-end" />
    <line x1=${x(high)} x2=${x(high)} y1="4" y2="12" class="bar-end" />
    <circle cx=${x(mean)} cy="8" r="3.5" class="mean" />
  </svg>`;
}

/**
 * Lines over one axis, with their names and values in a legend.
 * @param {{series: {name: string, values: (number | null)[], dim?: boolean}[], label: string, width?: number,
 *   height?: number, from?: number, every?: number, at?: number | null}} props
 */
export function LineChart({ series, label, width = 560, height = 180, from = 0, every = 1, at = null }) {
  const [low, high] = extent(series.flatMap((one) => one.values));
  const count = Math.max(...series.map((one) => one.values.length), 2);
  const [left, right, top, bottom] = [44, 8, 8, 20];
  const x = (/** @type {number} */ index) => left + (index / (count - 1)) * (width - left - right);
  const y = (/** @type {number} */ value) => height - bottom - ((value - low) / (high - low)) * (height - top - bottom);
  const ticks = [low, (low + high) / 2, high];
  return html`<figure class="chart">
    <svg viewBox=${`0 0 ${width} ${height}`} role="img" aria-label=${label}>
      ${ticks.map(
        (tick) => html`<line x1=${left} x2=${width - right} y1=${y(tick)} y2=${y(tick)} class="grid" />
          <text x=${left - 6} y=${y(tick) + 4} text-anchor="end">${short(tick)}</text>`,
      )}
      <text x=${left} y=${height - 4}>${from}</text>
      <text x=${width - right} y=${height - 4} text-anchor="end">${from + (count - 1) * every}</text>
      ${series.map(
        (one, index) =>
          html`<path d=${linePath(one.values, x, y)} fill="none" stroke=${color(index)} stroke-dasharray=${dashes(index)} stroke-width="1.8" opacity=${one.dim ? 0.4 : 1} />`,
      )}
      ${at !== null && html`<line x1=${x(at)} x2=${x(at)} y1=${top} y2=${height - bottom} class="cursor" />`}
    </svg>
    ${series.length > 1 &&
    html`<figcaption>
      ${series.map(
        (one, index) => html`<span class="legend">
          <svg width="24" height="8" aria-hidden="true"><line x1="0" x2="24" y1="4" y2="4" stroke=${color(index)} stroke-dasharray=${dashes(index)} stroke-width="2" /></svg>
          ${one.name}
        </span>`,
      )}
    </figcaption>`}
  </figure>`;
}

const INTEGER = new Intl.NumberFormat("en");

/** A number in few characters. @param {number | null | undefined} value */
export function short(value) {
  if (value === null || value === undefined) return "–";
  if (Number.isInteger(value)) return INTEGER.format(value);
  return Math.abs(value) >= 100 ? value.toFixed(1) : value.toFixed(2);
}
