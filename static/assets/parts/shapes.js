// Contents of cells, as shapes that differ without colour. A cell is CELL units wide.
import { html } from "../ui.js";
import { ACTIONS } from "./actions.js";
import { short } from "./chart.js";
import { color } from "./colors.js";

/** @import { Sign } from "./cell.js" */

export const CELL = 20;

/** Classes and paths by symbol. @type {Record<string, [string, string]>} */
export const SHAPES = {
  W: ["wall", "M0 0H20V20H0Z"],
  N: ["nest", "M2 2H18V18H2ZM2 10L10 2M2 18L18 2M10 18L18 10"],
  F: ["food", "M10 4L16.5 15.5H3.5Z"],
  B: ["block", "M1 1H19V19H1ZM1 1L19 19M19 1L1 19"],
  P: ["prey", "M10 1L12.6 7.4L19 10L12.6 12.6L10 19L7.4 12.6L1 10L7.4 7.4Z"],
  "*": ["outside", "M0 20L20 0M0 10L10 0M10 20L20 10"],
};

/** The shape of a symbol at a cell; none for an empty cell. @param {string} symbol @param {number} i row @param {number} j column */
export function shapeAt(symbol, i, j) {
  const [name, path] = SHAPES[symbol] ?? [];
  return path && html`<path key=${`${i},${j}`} class=${name} d=${path} transform=${`translate(${j * CELL} ${i * CELL})`} />`;
}

/** The dot of a speaker, at the lower right of an agent around (0, 0). */
export const SPEECH = "M4.1 6.7a2.6 2.6 0 1 0 5.2 0a2.6 2.6 0 1 0 -5.2 0Z";

/** @typedef {[number, number]} Point */

/** The path of a message between the middles of two cells of a side, with a head at its hearer. @param {Point} from @param {Point} to @param {number} side */
export function messagePath([x, y], [a, b], side) {
  const length = Math.hypot(a - x, b - y) || 1;
  const [u, v] = [((a - x) / length) * side, ((b - y) / length) * side];
  /** @param {number} back @param {number} aside */
  const point = (back, aside) => `${(a - u * back - v * aside).toFixed(1)} ${(b - v * back + u * aside).toFixed(1)}`;
  return `M${x} ${y}L${point(0.42, 0)}M${point(0.7, 0.14)}L${point(0.42, 0)}L${point(0.7, -0.14)}`;
}

/**
 * An agent with its number, around (0, 0): hollow with its light off, with a dashed ring with its light on or with food.
 * @param {{agent: number, label?: string, sign?: Sign, isChosen?: boolean, isDifferent?: boolean, lost?: number, isSilent?: boolean,
 *   isSpeaking?: boolean}} props `lost`: what its decision lost; `isSilent`: it gave no valid answer
 */
export function AgentShape({ agent, label = String(agent), sign, isChosen, isDifferent, lost, isSilent, isSpeaking }) {
  const isHollow = sign === "off";
  return html`
    ${isDifferent && html`<rect class="different" x="-9.5" y="-9.5" width="19" height="19" />`}
    ${sign && !isHollow && html`<circle class="halo" r="9" stroke=${color(agent)} />`}
    <circle class=${isHollow ? "body hollow" : "body"} r="7" fill=${isHollow ? undefined : color(agent)} stroke=${color(agent)} />
    ${isChosen && html`<circle class="chosen" r="9.5" />`}
    ${lost !== undefined && html`<circle class="ring" r="12.5" /><text class="name bad-sign" x="13" y="-9" font-size="9">−${short(lost)}</text>`}
    ${isSilent && html`<text class="name bad-sign" x="-9" y="-4" font-size="13">?</text>`}
    ${isSpeaking && html`<path class="spoke" d=${SPEECH} />`}
    <text class=${isHollow ? "name hollow" : "name"} y="3.2" font-size=${label.length > 2 ? 6 : 9}>${label}</text>
  `;
}

/** The move that an agent chose, around it. @param {{action?: string, agent: number, isBlocked?: boolean}} props action: the letter of a replay */
export function Arrow({ action = "", agent, isBlocked }) {
  const by = ACTIONS[action]?.by;
  if (!by) return null;
  const angle = (Math.atan2(by[0], by[1]) * 180) / Math.PI;
  return html`<g class=${isBlocked ? "arrow blocked" : "arrow"} transform=${`rotate(${angle})`}>
    <path d=${isBlocked ? "M8 0H13M10 -3L13 0L10 3M14 -4V4" : "M8 0H15M11.5 -3.5L15 0L11.5 3.5"} stroke=${isBlocked ? undefined : color(agent)} />
  </g>`;
}

/** The shapes with their names, for first-time visitors. @param {{task: string, hasSpeech?: boolean}} props `hasSpeech`: agents speak where it stands */
export function Legend({ task, hasSpeech }) {
  const things = { Foraging: [["N", "nest"], ["F", "food"]], Pursuit: [["P", "prey"]], Transport: [["B", "block"]] }[task] ?? [];
  const isOfLights = task === "Synchronization";
  const marked = isOfLights ? "light on" : task === "Foraging" && "carries food";
  /** @param {unknown} drawn @param {string} name */
  const entry = (drawn, name) => html`<li><svg class="cells" viewBox="0 0 20 20" width="18" height="18" aria-hidden="true">${drawn}</svg> ${name}</li>`;
  /** Its signs stand around an agent. @param {string} name @param {object} props */
  const agent = (name, props) => entry(html`<g transform="translate(11.5 12) scale(0.7)"><${AgentShape} agent=${0} ...${props} /></g>`, name);
  /** @param {string} name @param {string} kind @param {string} path */
  const arrow = (name, kind, path) => entry(html`<g class=${kind} transform="translate(4 10)"><path d=${path} /></g>`, name);
  return html`<ul class="legend">
    ${[["W", "wall"], ...things].map(([symbol, name]) => entry(shapeAt(symbol, 0, 0), name))}
    ${agent(isOfLights ? "agent, light off" : "agent", { sign: isOfLights ? "off" : null })}
    ${marked && agent(marked, { sign: "on" })}
    ${agent("no valid answer", { isSilent: true })}
    ${arrow("chosen move", "arrow legend-arrow", "M0 0H12M8 -4L12 0L8 4")} ${arrow("blocked move", "arrow blocked", "M0 0H12M8 -4L12 0L8 4M13 -5V5")}
    ${hasSpeech && agent("spoke", { isSpeaking: true })}
    ${hasSpeech && entry(html`<path class="heard chosen-line legend-line" d=${messagePath([1, 10], [27, 10], CELL)} />`, "said to")}
  </ul>`;
}
