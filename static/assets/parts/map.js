// The map of a game at one moment: cells, the agents' choices, and who hears whom.
import { html, useMemo } from "../ui.js";
import { actionOf } from "./actions.js";
import { CanvasMap } from "./canvas.js";
import { color } from "./colors.js";
import { choose } from "./pick.js";
import { AgentShape, CELL, shapeAt } from "./shapes.js";

/** @import { Head, State } from "./game.js" */

/** The maximum numbers of cells and agents of a map of elements; a larger map is a canvas. */
const CELLS_MAX = 1600;
const AGENTS_MAX = 160;

/** The maximum number of lines between speakers and hearers. */
const LINES_MAX = 600;

/**
 * @typedef {{at: number[], gone: number[]}} Ghost agents in a round that was not played
 *
 * @typedef {object} MapProps
 * @property {Head} head
 * @property {State} state the world that is shown
 * @property {State | null} next the state after it: its actions and messages are those of this moment
 * @property {number | null} [agent] the chosen one
 * @property {(agent: number) => void} [onChoose]
 * @property {boolean} [arrows]
 * @property {boolean} [messages]
 * @property {Set<number>} [marks] agents that are marked as different
 * @property {Set<number>} [ringed] agents whose decisions lost most
 * @property {Ghost[]} [ghosts] later rounds that are outlined
 * @property {string} label
 */

/** @param {MapProps} props */
export function GameMap(props) {
  const { width, height, num_agents: agents } = props.head;
  return width * height > CELLS_MAX || agents > AGENTS_MAX ? html`<${CanvasMap} ...${props} />` : html`<${SvgMap} ...${props} />`;
}

/** @param {MapProps} props */
function SvgMap({ head, state, next, agent = null, onChoose, arrows = true, messages = true, marks, ringed, ghosts, label }) {
  const ground = useMemo(() => head.ground.flatMap((row, i) => [...row].map((symbol, j) => shapeAt(symbol, i, j))), [head.ground]);
  const [w, h] = [head.width * CELL, head.height * CELL];
  const numbers = Array.from({ length: head.num_agents }, (_, n) => n).filter((n) => !state.gone?.includes(n));
  return html`<svg
    class="map cells"
    style=${{ "--aspect": head.width / head.height }}
    viewBox=${`0 0 ${w} ${h}`}
    role="img"
    aria-label=${label}
    onClick=${(/** @type {MouseEvent} */ event) => choose(event, head, state, onChoose)}
  >
    <rect class="floor" width=${w} height=${h} />
    <path class="lattice" d=${lattice(head.width, head.height)} />
    ${ground} ${blockOf(head, state)} ${preyOf(state)} ${agent !== null && windowOf(head, state, agent)}
    ${messages && next && linesOf(state, next, agent)}
    ${numbers.map((n) => {
      const [x, y] = centre(state, n);
      return html`<g key=${`a${n}`} class="agent" style=${{ transform: `translate(${x}px, ${y}px)` }}>
        ${arrows && arrowOf(next, n)}
        <${AgentShape}
          agent=${n}
          isMarked=${(state.lit ?? state.loaded)?.includes(n)}
          isHollow=${state.lit && !state.lit.includes(n)}
          isChosen=${n === agent}
          isDifferent=${marks?.has(n)}
          isRinged=${ringed?.has(n)}
        />
      </g>`;
    })}
    ${ghosts && numbers.map((n) => ghostOf(state, ghosts, n, n === agent))}
  </svg>`;
}

/** @param {number} width @param {number} height */
function lattice(width, height) {
  let path = "";
  for (let j = 1; j < width; j++) path += `M${j * CELL} 0V${height * CELL}`;
  for (let i = 1; i < height; i++) path += `M0 ${i * CELL}H${width * CELL}`;
  return path;
}

/** @param {{at: number[]}} state @param {number} agent @returns {[number, number]} */
const centre = (state, agent) => [(state.at[2 * agent + 1] + 0.5) * CELL, (state.at[2 * agent] + 0.5) * CELL];

/** @param {Head} head @param {State} state */
const blockOf = (head, { block }) => block && (head.block_cells ?? []).map(([di, dj]) => shapeAt("B", block[0] + di, block[1] + dj));

/** @param {State} state */
const preyOf = ({ prey }) =>
  prey &&
  html`<g key="prey" class="agent" style=${{ transform: `translate(${prey[1] * CELL}px, ${prey[0] * CELL}px)` }}>${shapeAt("P", 0, 0)}</g>`;

/** The outline of what an agent sees. @param {Head} head @param {State} state @param {number} agent */
function windowOf(head, state, agent) {
  if (!head.view_size || head.control === "centralized" || state.gone?.includes(agent)) return null;
  const side = head.view_size * CELL;
  const [x, y] = centre(state, agent);
  return html`<rect class="window" x=${x - side / 2} y=${y - side / 2} width=${side} height=${side} stroke=${color(agent)} />`;
}

/** @param {State | null} next @param {number} agent */
function arrowOf(next, agent) {
  const action = actionOf(next, agent);
  if (!action?.by) return null;
  const [di, dj] = action.by;
  const isBlocked = next?.blocked?.includes(agent);
  const angle = (Math.atan2(di, dj) * 180) / Math.PI;
  return html`<g class=${isBlocked ? "arrow blocked" : "arrow"} transform=${`rotate(${angle})`}>
    <path d=${isBlocked ? "M8 0H13M10 -3L13 0L10 3M14 -4V4" : "M8 0H15M11.5 -3.5L15 0L11.5 3.5"} stroke=${isBlocked ? undefined : color(agent)} />
  </g>`;
}

/** The way of an agent through later rounds, and its last place; of the chosen one every place, with the number of rounds. @param {State} state @param {Ghost[]} ghosts @param {number} agent @param {boolean} isChosen */
function ghostOf(state, ghosts, agent, isChosen) {
  const steps = ghosts.filter(({ gone }) => !gone.includes(agent));
  const way = [state, ...steps].map((step) => centre(step, agent));
  return html`<g key=${`g${agent}`} class="ghost">
    <path d=${`M${way.join("L")}`} stroke=${color(agent)} />
    ${way.slice(isChosen ? 1 : -1).map(([x, y], step) => html`<g transform=${`translate(${x} ${y})`}>
      <circle r="7" stroke=${color(agent)} /><text class="name hollow" y="3" font-size="8">${isChosen ? `+${step + 1}` : agent}</text>
    </g>`)}
  </g>`;
}

/** Lines from each speaker to its readers: a path for each speaker, and those of the chosen agent above. @param {State} state @param {State} next @param {number | null} agent */
function linesOf(state, next, agent) {
  const [others, own] = [new Map(), new Map()];
  let count = 0;
  for (const { from, by } of next.heard ?? []) {
    for (const to of by) {
      if (count++ === LINES_MAX) break;
      const paths = from === agent || to === agent ? own : others;
      paths.set(from, `${paths.get(from) ?? ""}M${centre(state, from).join(" ")}L${centre(state, to).join(" ")}`);
    }
  }
  /** @param {Map<number, string>} paths @param {string} name */
  const drawn = (paths, name) => [...paths].map(([from, path]) => html`<path key=${`${name}${from}`} class=${name} d=${path} stroke=${color(from)} />`);
  return [drawn(others, "heard"), drawn(own, "heard chosen-line")];
}
