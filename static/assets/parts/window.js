// The window of one agent.
import { html } from "../ui.js";
import { letterOf } from "./actions.js";
import { readCell, signsIn, symbolOf } from "./cell.js";
import { AgentShape, Arrow, CELL, shapeAt } from "./shapes.js";

/** @import { Rules, Sign } from "./cell.js" */
/** @import { Head, State } from "./game.js" */

/** The maximum side of a window that is drawn, in cells; a larger one is text. */
const DRAWN_MAX = 41;

/**
 * A window in words, for screen readers: rows and columns count from its upper left corner.
 * @param {string[][]} cells
 * @param {Rules} rules
 */
export function describe(cells, rules) {
  const found = cells.flatMap((row, i) =>
    row.flatMap((symbol, j) => {
      const { kind, name } = readCell(symbol, rules);
      return ["empty", "outside", "wall"].includes(kind) ? [] : [`${kind === "you" ? "itself" : name} in row ${i + 1}, column ${j + 1}`];
    }),
  );
  return found.length ? found.join("; ") : "nothing but cells and walls";
}

/**
 * A window with the symbols of an observation: exactly what the agent saw.
 * @param {{cells: string[][], rules: Rules, agent: number, label: string, sign?: Sign, action?: string | null}} props `sign`: the
 *   agent's own light or load, which its symbol does not show; `action`: what it chose, by its name
 */
export function AgentWindow({ cells, rules, agent, label, sign, action }) {
  const [rows, columns] = [cells.length, cells[0]?.length ?? 0];
  if (rows > DRAWN_MAX || columns > DRAWN_MAX) {
    const text = cells.map((row) => row.map((symbol) => symbol.padStart(3)).join("")).join("\n");
    return html`<pre class="window-text" tabindex="0" role="region" aria-label=${label}>${text}</pre>`;
  }
  const lines = `M0 0H${columns * CELL}V${rows * CELL}H0Z` + cells.map((_, i) => `M0 ${i * CELL}H${columns * CELL}`).join("") + (cells[0] ?? []).map((_, j) => `M${j * CELL} 0V${rows * CELL}`).join("");
  return html`<svg class="agent-window cells" viewBox=${`-1 -1 ${columns * CELL + 2} ${rows * CELL + 2}`} role="img" aria-label=${`${label}: ${describe(cells, rules)}`}>
    <rect class="floor" width=${columns * CELL} height=${rows * CELL} />
    <path class="lattice" d=${lines} />
    ${cells.flatMap((row, i) => row.map((symbol, j) => seen(symbol, i, j, rules, { agent, sign, action })))}
  </svg>`;
}

/** @param {string} symbol @param {number} i @param {number} j @param {Rules} rules @param {{agent: number, sign?: Sign, action?: string | null}} own */
function seen(symbol, i, j, rules, { agent, sign, action }) {
  const { kind, agent: other, sign: shown } = readCell(symbol, rules);
  if (kind !== "you" && kind !== "agent") return shapeAt(symbol, i, j);
  const isOwn = kind === "you";
  const who = isOwn ? { agent, label: "me", sign, isChosen: true } : { agent: other, sign: shown };
  return html`<g key=${`${i},${j}`} transform=${`translate(${(j + 0.5) * CELL} ${(i + 0.5) * CELL})`}>
    ${isOwn && html`<${Arrow} action=${letterOf(action)} agent=${agent} />`}<${AgentShape} ...${who} />
  </g>`;
}

/**
 * The surroundings of an agent in a state, in the symbols of a window; not what the agent was sent.
 * @param {Head} head
 * @param {State} state
 * @param {number} agent
 * @returns {string[][]}
 */
export function surroundings(head, state, agent) {
  const size = head.view_size ?? 5;
  const [top, left] = [state.at[2 * agent] - (size - 1) / 2, state.at[2 * agent + 1] - (size - 1) / 2];
  const cells = Array.from({ length: size }, (_, a) =>
    Array.from({ length: size }, (_, b) => head.ground[top + a]?.[left + b] ?? "*"),
  );
  /** @param {number} i @param {number} j @param {string} symbol */
  const put = (i, j, symbol) => {
    if (cells[i - top]?.[j - left] !== undefined) cells[i - top][j - left] = symbol;
  };
  const { block, prey } = state;
  if (block) for (const [di, dj] of head.block_cells ?? []) put(block[0] + di, block[1] + dj, "B");
  if (prey) put(prey[0], prey[1], "P");
  const signOf = signsIn(head, state);
  for (let n = 0; n < head.num_agents; n++) {
    if (state.gone?.includes(n)) continue;
    put(state.at[2 * n], state.at[2 * n + 1], n === agent ? "Y" : symbolOf(head, n, signOf(n)));
  }
  return cells;
}
