// Contents of cells, as shapes that differ without colour. A cell is CELL units wide.
import { html } from "../ui.js";
import { color } from "./colors.js";

export const CELL = 20;

const SHAPES = {
  W: html`<rect class="wall" width="20" height="20" />`,
  N: html`<path class="nest" d="M2 2H18V18H2ZM2 10L10 2M2 18L18 2M10 18L18 10" />`,
  F: html`<path class="food" d="M10 4L16.5 15.5H3.5Z" />`,
  B: html`<path class="block" d="M1 1H19V19H1ZM1 1L19 19M19 1L1 19" />`,
  P: html`<path class="prey" d="M10 1L12.6 7.4L19 10L12.6 12.6L10 19L7.4 12.6L1 10L7.4 7.4Z" />`,
  "*": html`<path class="outside" d="M0 20L20 0M0 10L10 0M10 20L20 10" />`,
};

/**
 * The shape of a symbol at a cell; none for an empty cell.
 * @param {string} symbol
 * @param {number} i row
 * @param {number} j column
 */
export function shapeAt(symbol, i, j) {
  const shape = SHAPES[/** @type {keyof typeof SHAPES} */ (symbol)];
  return shape && html`<g key=${`${i},${j}`} transform=${`translate(${j * CELL} ${i * CELL})`}>${shape}</g>`;
}

/**
 * An agent with its number, around (0, 0). `isMarked` is a light that is on or food that is carried; `isHollow` a light
 * that is off.
 * @param {{agent: number, label?: string, isMarked?: boolean, isHollow?: boolean, isChosen?: boolean, isDifferent?: boolean,
 *   isRinged?: boolean}} props
 */
export function AgentShape({ agent, label = String(agent), isMarked, isHollow, isChosen, isDifferent, isRinged }) {
  return html`
    ${isDifferent && html`<rect class="different" x="-9.5" y="-9.5" width="19" height="19" />`}
    ${isMarked && html`<circle class="halo" r="9" stroke=${color(agent)} />`}
    <circle class=${isHollow ? "body hollow" : "body"} r="7" fill=${isHollow ? undefined : color(agent)} stroke=${color(agent)} />
    ${isChosen && html`<circle class="chosen" r="9.5" />`}
    ${isRinged && html`<circle class="ring" r="12.5" /><text class="name ring-sign" x="13" y="-7" font-size="12">?</text>`}
    <text class=${isHollow ? "name hollow" : "name"} y="3.2" font-size=${label.length > 2 ? 6 : 9}>${label}</text>
  `;
}

/** The shapes with their names, for first-time visitors. @param {{task: string}} props */
export function Legend({ task }) {
  /** @type {[string, string][]} */
  const shapes = [["W", "wall"]];
  if (task === "Foraging") shapes.push(["N", "nest"], ["F", "food"]);
  if (task === "Pursuit") shapes.push(["P", "prey"]);
  if (task === "Transport") shapes.push(["B", "block"]);
  const marked = { Synchronization: "light on", Foraging: "carries food" }[task];
  /** @param {unknown} drawn @param {string} name */
  const entry = (drawn, name) => html`<li><svg class="cells" viewBox="0 0 20 20" width="18" height="18" aria-hidden="true">${drawn}</svg> ${name}</li>`;
  return html`<ul class="legend">
    ${shapes.map(([symbol, name]) => entry(SHAPES[/** @type {"W"} */ (symbol)], name))}
    ${entry(html`<g transform="translate(10 10)"><${AgentShape} agent=${0} isHollow=${task === "Synchronization"} /></g>`, task === "Synchronization" ? "agent, light off" : "agent")}
    ${marked && entry(html`<g transform="translate(10 10)"><${AgentShape} agent=${0} isMarked=${true} /></g>`, marked)}
    ${entry(html`<g class="arrow chosen-arrow" transform="translate(4 10)"><path d="M0 0H12M8 -4L12 0L8 4" /></g>`, "chosen move")}
    ${entry(html`<g class="arrow blocked" transform="translate(4 10)"><path d="M0 0H12M8 -4L12 0L8 4M13 -5V5" /></g>`, "blocked move")}
  </ul>`;
}
