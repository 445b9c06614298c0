// The map of a game at one moment: cells, the agents' choices, and who hears whom.
import { html, useMemo } from "../ui.js";
import { voicesIn } from "./actions.js";
import { signsIn } from "./cell.js";
import { color } from "./colors.js";
import { AgentShape, Arrow, CELL, SHAPES, messagePath, shapeAt } from "./shapes.js";

/** @import { Head, State } from "./game.js" */
/** @import { Point } from "./shapes.js" */

/** The maximum cells of a side and agents of a map that shows numbers, moves and signs; of a larger one agents are squares. */
const SIDE_MAX = 90;
const AGENTS_MAX = 160;

/** The side of an agent's body, and its minimum in parts of the map's side, so that it is visible on the largest map. */
const [BODY, SHARE_MIN] = [16, 1 / 140];

/** The maximum number of arrows from speakers to hearers. */
const LINES_MAX = 600;

/** The maximum distance of a click from an agent's centre, in cells. */
const REACH = 1.5;

/**
 * @typedef {{at: number[], gone: number[]}} Ghost agents in a round that was not played
 *
 * @typedef {object} MapProps
 * @property {Head} head
 * @property {State} state the world that is shown
 * @property {State | null} next the state after it: its actions and messages are those of this moment
 * @property {number | null} [agent] the chosen one
 * @property {(agent: number) => void} [onChoose]
 * @property {boolean} [messages]
 * @property {Set<number>} [marks] agents that are marked as different
 * @property {Map<number, number>} [lost] what decisions of agents lost, of those that lost most
 * @property {Ghost[]} [ghosts] later rounds that are outlined
 * @property {string} label
 */

/** @param {MapProps} props */
export function GameMap(props) {
  const { head, state, next, agent = null, onChoose, messages = true, lost, ghosts, label } = props;
  const ground = useMemo(() => groundOf(head), [head.ground]);
  const side = Math.max(head.width, head.height);
  const isDetailed = side <= SIDE_MAX && head.num_agents <= AGENTS_MAX;
  // What is drawn of a few agents grows on a large map; 1 on a small one.
  const scale = isDetailed ? 1 : Math.max(1, (side * CELL * SHARE_MIN) / BODY);
  const gone = new Set(state.gone);
  const numbers = Array.from({ length: head.num_agents }, (_, n) => n).filter((n) => !gone.has(n));
  const large = isDetailed ? numbers : numbers.filter((n) => n === agent || lost?.has(n));
  return html`<svg class=${isDetailed ? "map cells" : "map cells crowded"} style=${{ "--aspect": head.width / head.height }}
    viewBox=${`0 0 ${head.width * CELL} ${head.height * CELL}`} role="img" aria-label=${label}
    onClick=${(/** @type {MouseEvent} */ event) => choose(event, head, state, onChoose)}>
    ${ground} ${blockOf(head, state)} ${preyOf(state, scale)} ${agent !== null && windowOf(head, state, agent)}
    ${messages && next && linesOf(state, next, agent, isDetailed ? CELL : CELL * scale, isDetailed)}
    ${!isDetailed && squares(props, numbers, BODY * scale)}
    ${agentsOf(props, large, scale)}
    ${ghosts && numbers.map((n) => ghostOf(state, ghosts, n, n === agent, scale))}
  </svg>`;
}

/** Cells, their lines, and what never moves: a path for each kind. @param {Head} head */
function groundOf({ ground, width, height }) {
  let lattice = "";
  for (let j = 1; j < width; j++) lattice += `M${j * CELL} 0V${height * CELL}`;
  for (let i = 1; i < height; i++) lattice += `M0 ${i * CELL}H${width * CELL}`;
  const things = new Map(Object.keys(SHAPES).map((symbol) => [symbol, ""]));
  ground.forEach((row, i) => [...row].forEach((symbol, j) => SHAPES[symbol] && things.set(symbol, things.get(symbol) + shifted(SHAPES[symbol][1], j * CELL, i * CELL))));
  return html`<g>
    <rect class="floor" width=${width * CELL} height=${height * CELL} /><path class="lattice" d=${lattice} />
    ${[...things].map(([symbol, path]) => path && html`<path class=${SHAPES[symbol][0]} d=${path} />`)}
  </g>`;
}

/** A path at another place. @param {string} path @param {number} x @param {number} y */
const shifted = (path, x, y) =>
  path.replace(/([MLHV])([\d.]+)(?: ([\d.]+))?/g, (_, step, a, b) => (step === "V" ? `V${Number(a) + y}` : `${step}${Number(a) + x}${b === undefined ? "" : ` ${Number(b) + y}`}`));

/** @param {{at: number[]}} state @param {number} agent @returns {Point} */
const centre = (state, agent) => [(state.at[2 * agent + 1] + 0.5) * CELL, (state.at[2 * agent] + 0.5) * CELL];

/** @param {Head} head @param {State} state */
const blockOf = (head, { block }) => block && (head.block_cells ?? []).map(([di, dj]) => shapeAt("B", block[0] + di, block[1] + dj));

/** @param {State} state @param {number} scale */
const preyOf = ({ prey }, scale) =>
  prey &&
  html`<g key="prey" class="agent" style=${{ transform: `translate(${(prey[1] + 0.5) * CELL}px, ${(prey[0] + 0.5) * CELL}px) scale(${scale})` }}>
    <path class="prey" transform="translate(-10 -10)" d=${SHAPES.P[1]} />
  </g>`;

/** The outline of what an agent sees. @param {Head} head @param {State} state @param {number} agent */
function windowOf(head, state, agent) {
  if (!head.view_size || head.control === "centralized" || state.gone?.includes(agent)) return null;
  const side = head.view_size * CELL;
  const [x, y] = centre(state, agent);
  return html`<rect class="window" x=${x - side / 2} y=${y - side / 2} width=${side} height=${side} stroke=${color(agent)} />`;
}

/** Agents with their numbers, moves and signs. @param {MapProps} props @param {number[]} numbers @param {number} scale */
function agentsOf({ head, state, next, agent, marks, lost }, numbers, scale) {
  const signOf = signsIn(head, state);
  const { silent, speaking } = voicesIn(next);
  return numbers.map((n) => {
    const [x, y] = centre(state, n);
    return html`<g key=${`a${n}`} class="agent" style=${{ transform: `translate(${x}px, ${y}px) scale(${scale})` }}>
      <${Arrow} action=${next?.actions?.[n]} agent=${n} isBlocked=${next?.blocked?.includes(n)} />
      <${AgentShape} agent=${n} sign=${signOf(n)} isChosen=${n === agent} isDifferent=${marks?.has(n)} lost=${lost?.get(n)}
        isSilent=${silent.has(n)} isSpeaking=${speaking.has(n)} />
    </g>`;
  });
}

/** Agents as squares: hollow ones and those with a ring as in a small map. @param {MapProps} props @param {number[]} numbers @param {number} side */
function squares({ head, state, marks }, numbers, side) {
  const signOf = signsIn(head, state);
  /** @param {number} n @param {string} name @param {number} size */
  const square = (n, name, size) => {
    const [x, y] = centre(state, n);
    const isFilled = name === "body";
    return html`<rect key=${`${name}${n}`} class=${name} x=${x - size / 2} y=${y - size / 2} width=${size} height=${size} fill=${isFilled ? color(n) : undefined} stroke=${isFilled ? undefined : color(n)} />`;
  };
  return numbers.flatMap((n) => {
    const sign = signOf(n);
    const body = square(n, sign === "off" ? "hollow body" : "body", side);
    return [body, sign === "food" && square(n, "halo", side * 1.5), marks?.has(n) && square(n, "different", side * 2)].filter(Boolean);
  });
}

/**
 * The way of an agent through later rounds, and its last place; of the chosen one every place, with the number of rounds.
 * @param {State} state @param {Ghost[]} ghosts @param {number} agent @param {boolean} isChosen @param {number} scale
 */
function ghostOf(state, ghosts, agent, isChosen, scale) {
  const steps = ghosts.filter(({ gone }) => !gone.includes(agent));
  const way = [state, ...steps].map((step) => centre(step, agent));
  return html`<g key=${`g${agent}`} class="ghost">
    <path d=${`M${way.join("L")}`} stroke=${color(agent)} />
    ${way.slice(isChosen ? 1 : -1).map(([x, y], step) => html`<g transform=${`translate(${x} ${y}) scale(${scale})`}>
      <circle r="7" stroke=${color(agent)} /><text class="name hollow" y="3" font-size="8">${isChosen ? `+${step + 1}` : agent}</text>
    </g>`)}
  </g>`;
}

/**
 * Arrows from each speaker to its readers: a path for each speaker, and those of the chosen agent above.
 * @param {State} state @param {State} next @param {number | null} agent @param {number} side of their heads @param {boolean} hasAll
 */
function linesOf(state, next, agent, side, hasAll) {
  const [others, own] = [new Map(), new Map()];
  let count = 0;
  for (const { from, by } of next.heard ?? []) {
    for (const to of by) {
      const isOwn = from === agent || to === agent;
      if (!isOwn && !hasAll) continue;
      if (count++ === LINES_MAX) break;
      const paths = isOwn ? own : others;
      paths.set(from, `${paths.get(from) ?? ""}${messagePath(centre(state, from), centre(state, to), side)}`);
    }
  }
  /** @param {Map<number, string>} paths @param {string} name */
  const drawn = (paths, name) => [...paths].map(([from, path]) => html`<path key=${`${name}${from}`} class=${name} d=${path} stroke=${color(from)} />`);
  return [drawn(others, "heard"), drawn(own, "heard chosen-line")];
}

/**
 * Chooses the agent nearest to a click.
 * @param {MouseEvent} event
 * @param {Head} head
 * @param {State} state
 * @param {((agent: number) => void) | undefined} onChoose
 */
function choose(event, head, state, onChoose) {
  const box = /** @type {Element} */ (event.currentTarget).getBoundingClientRect();
  const i = ((event.clientY - box.top) / box.height) * head.height - 0.5;
  const j = ((event.clientX - box.left) / box.width) * head.width - 0.5;
  let [nearest, least] = [-1, REACH];
  for (let n = 0; n < head.num_agents; n++) {
    if (state.gone?.includes(n)) continue;
    const distance = Math.hypot(state.at[2 * n] - i, state.at[2 * n + 1] - j);
    if (distance < least) [nearest, least] = [n, distance];
  }
  if (nearest >= 0) onChoose?.(nearest);
}
