// The map of a large game: one canvas, whose ground is drawn once.
import { html, useEffect, useMemo, useRef } from "../ui.js";
import { actionOf } from "./actions.js";
import { canvasColor, cssValue } from "./colors.js";
import { choose } from "./pick.js";

/** @import { Head, State } from "./game.js" */
/** @import { Ghost, MapProps } from "./map.js" */

/** The longer side in pixels, which the page scales. */
const SIDE_PX = 1280;

/** The minimum side of a cell, in pixels, for numbers and arrows. */
const DETAIL_PX = 14;

/** The minimum size of an agent in pixels, so that it is visible on the largest map. */
const AGENT_MIN_PX = 9;

/** @typedef {{context: CanvasRenderingContext2D, cell: number}} Brush */

/** @param {MapProps} props */
export function CanvasMap({ head, state, next, agent = null, onChoose, arrows = true, messages = true, marks, ringed, ghosts, label }) {
  const canvas = useRef(/** @type {HTMLCanvasElement | null} */ (null));
  const cell = Math.max(2, Math.floor(SIDE_PX / Math.max(head.width, head.height)));
  const isDark = useDark();
  const ground = useMemo(() => drawGround(head, cell), [head.ground, isDark]);

  useEffect(() => {
    const context = canvas.current?.getContext("2d");
    if (!context) return;
    const brush = { context, cell };
    context.drawImage(ground, 0, 0);
    drawThings(brush, head, state);
    if (messages && next && agent !== null) drawLines(brush, state, next, agent);
    drawAgents(brush, head, state, marks);
    if (arrows && cell >= DETAIL_PX) drawArrows(brush, head, state, next);
    if (agent !== null && !state.gone?.includes(agent)) drawChosen(brush, head, state, agent);
    for (const n of ringed ?? []) drawRing(brush, state, n);
    if (ghosts) drawGhosts(brush, head, state, ghosts, agent);
  });

  return html`<canvas
    class="map"
    style=${{ "--aspect": head.width / head.height }}
    ref=${canvas}
    width=${head.width * cell}
    height=${head.height * cell}
    role="img"
    aria-label=${label}
    onClick=${(/** @type {MouseEvent} */ event) => choose(event, head, state, onChoose)}
  ></canvas>`;
}

/** Whether the page is dark now: colours of a canvas do not change by themselves. */
const useDark = () => matchMedia("(prefers-color-scheme: dark)").matches;

/** @param {Head} head @param {number} cell */
function drawGround(head, cell) {
  const canvas = document.createElement("canvas");
  canvas.width = head.width * cell;
  canvas.height = head.height * cell;
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.fillStyle = cssValue("--ground");
  context.fillRect(0, 0, canvas.width, canvas.height);
  const colors = { W: "--strong-line", N: "--line", F: "--good" };
  head.ground.forEach((row, i) =>
    [...row].forEach((symbol, j) => {
      const name = colors[/** @type {keyof typeof colors} */ (symbol)];
      if (!name) return;
      context.fillStyle = cssValue(name);
      if (symbol === "F") triangle(context, j * cell, i * cell, cell);
      else context.fillRect(j * cell, i * cell, cell, cell);
    }),
  );
  return canvas;
}

/** @param {CanvasRenderingContext2D} context @param {number} x @param {number} y @param {number} side */
function triangle(context, x, y, side) {
  context.beginPath();
  context.moveTo(x + side / 2, y + side * 0.1);
  context.lineTo(x + side * 0.9, y + side * 0.9);
  context.lineTo(x + side * 0.1, y + side * 0.9);
  context.fill();
}

/** The block and the prey. @param {Brush} brush @param {Head} head @param {State} state */
function drawThings({ context, cell }, head, { block, prey }) {
  context.lineWidth = Math.max(1, cell / 10);
  if (block) {
    context.fillStyle = cssValue("--raised");
    context.strokeStyle = cssValue("--ink");
    for (const [di, dj] of head.block_cells ?? []) {
      const [x, y] = [(block[1] + dj) * cell, (block[0] + di) * cell];
      context.fillRect(x, y, cell, cell);
      context.strokeRect(x, y, cell, cell);
    }
  }
  if (prey) {
    const [x, y, side] = [(prey[1] + 0.5) * cell, (prey[0] + 0.5) * cell, Math.max(cell, 8)];
    context.fillStyle = cssValue("--bad");
    context.beginPath();
    context.moveTo(x, y - side);
    context.lineTo(x + side, y);
    context.lineTo(x, y + side);
    context.lineTo(x - side, y);
    context.fill();
  }
}

/** @param {Brush} brush @param {Head} head @param {State} state @param {Set<number>} [marks] */
function drawAgents({ context, cell }, head, state, marks) {
  const gone = new Set(state.gone);
  const marked = new Set(state.lit ?? state.loaded);
  const side = Math.max(cell * 0.8, AGENT_MIN_PX);
  context.font = `600 ${Math.round(cell * 0.42)}px sans-serif`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  for (let n = 0; n < head.num_agents; n++) {
    if (gone.has(n)) continue;
    const [x, y] = [(state.at[2 * n + 1] + 0.5) * cell, (state.at[2 * n] + 0.5) * cell];
    context.fillStyle = context.strokeStyle = canvasColor(n);
    const isHollow = state.lit && !marked.has(n);
    context.lineWidth = Math.max(1, cell / 8);
    if (isHollow) context.strokeRect(x - side / 2, y - side / 2, side, side);
    else context.fillRect(x - side / 2, y - side / 2, side, side);
    if (state.loaded && marked.has(n)) context.strokeRect(x - side * 0.75, y - side * 0.75, side * 1.5, side * 1.5);
    if (marks?.has(n)) outline(context, x, y, side * 2, "--ink");
    if (cell < DETAIL_PX) continue;
    context.fillStyle = cssValue(isHollow ? "--ink" : "--ground");
    context.fillText(String(n), x, y);
  }
}

/** @param {CanvasRenderingContext2D} context @param {number} x @param {number} y @param {number} side @param {string} name */
function outline(context, x, y, side, name) {
  context.strokeStyle = cssValue(name);
  context.strokeRect(x - side / 2, y - side / 2, side, side);
}

/** @param {Brush} brush @param {Head} head @param {State} state @param {State | null} next */
function drawArrows({ context, cell }, head, state, next) {
  context.lineWidth = Math.max(1, cell / 10);
  for (let n = 0; n < head.num_agents; n++) {
    const by = actionOf(next, n)?.by;
    if (!by || state.gone?.includes(n)) continue;
    context.strokeStyle = next?.blocked?.includes(n) ? cssValue("--strong-line") : canvasColor(n);
    const [x, y] = [(state.at[2 * n + 1] + 0.5) * cell, (state.at[2 * n] + 0.5) * cell];
    context.beginPath();
    context.moveTo(x + by[1] * cell * 0.4, y + by[0] * cell * 0.4);
    context.lineTo(x + by[1] * cell * 0.75, y + by[0] * cell * 0.75);
    context.stroke();
  }
}

/** Lines of what the chosen agent said and heard. @param {Brush} brush @param {State} state @param {State} next @param {number} agent */
function drawLines({ context, cell }, state, next, agent) {
  context.lineWidth = 2;
  for (const { from, by } of next.heard ?? []) {
    for (const to of from === agent ? by : by.filter((to) => to === agent)) {
      context.strokeStyle = canvasColor(from);
      context.beginPath();
      context.moveTo((state.at[2 * from + 1] + 0.5) * cell, (state.at[2 * from] + 0.5) * cell);
      context.lineTo((state.at[2 * to + 1] + 0.5) * cell, (state.at[2 * to] + 0.5) * cell);
      context.stroke();
    }
  }
}

/** @param {Brush} brush @param {Head} head @param {State} state @param {number} agent */
function drawChosen({ context, cell }, head, state, agent) {
  const [x, y] = [(state.at[2 * agent + 1] + 0.5) * cell, (state.at[2 * agent] + 0.5) * cell];
  context.lineWidth = 2;
  outline(context, x, y, Math.max(cell * 1.4, 12), "--ink");
  if (!head.view_size || head.control === "centralized") return;
  context.setLineDash([6, 4]);
  outline(context, x, y, head.view_size * cell, "--ink");
  context.setLineDash([]);
}

/** @param {Brush} brush @param {{at: number[]}} state @param {number} agent @returns {[number, number]} */
const centre = ({ cell }, state, agent) => [(state.at[2 * agent + 1] + 0.5) * cell, (state.at[2 * agent] + 0.5) * cell];

/** The ring of an agent whose decision lost much. @param {Brush} brush @param {State} state @param {number} agent */
function drawRing(brush, state, agent) {
  const { context, cell } = brush;
  const [x, y] = centre(brush, state, agent);
  const radius = Math.max(cell, 14);
  context.fillStyle = context.strokeStyle = cssValue("--bad");
  context.lineWidth = 3;
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.stroke();
  context.font = `600 ${Math.round(radius * 1.2)}px sans-serif`;
  context.fillText("?", x + radius, y - radius);
}

/** Ways of agents through later rounds, and their last places; of the chosen one every place. @param {Brush} brush @param {Head} head @param {State} state @param {Ghost[]} ghosts @param {number | null} agent */
function drawGhosts(brush, head, state, ghosts, agent) {
  const { context, cell } = brush;
  const side = Math.max(cell * 0.8, AGENT_MIN_PX);
  context.globalAlpha = 0.7;
  context.setLineDash([4, 3]);
  context.lineWidth = Math.max(1, cell / 10);
  for (let n = 0; n < head.num_agents; n++) {
    if (state.gone?.includes(n)) continue;
    const way = [state, ...ghosts.filter(({ gone }) => !gone.includes(n))].map((step) => centre(brush, step, n));
    context.strokeStyle = canvasColor(n);
    context.beginPath();
    for (const [x, y] of way) context.lineTo(x, y);
    context.stroke();
    for (const [x, y] of way.slice(n === agent ? 1 : -1)) context.strokeRect(x - side / 2, y - side / 2, side, side);
  }
  context.setLineDash([]);
  context.globalAlpha = 1;
}
