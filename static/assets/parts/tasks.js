// The five tasks: what the swarm has to do, and a picture of it.
import { html } from "../ui.js";
import { AgentShape, Arrow, CELL, shapeAt } from "./shapes.js";

export { GOALS, TASKS } from "./goals.js";

/**
 * A thing in a picture of cells, by its row and column: a symbol, or an agent's number with its sign and its move.
 * @typedef {[number, number, string | number, string?, string?]} Thing
 */

/** A picture of each task, of three by three cells. @type {Record<string, Thing[]>} */
const PICTURES = {
  Transport: [[0, 2, "W"], [2, 2, "W"], [1, 1, "B"], [0, 0, 0], [1, 0, 1], [2, 0, 2]],
  Pursuit: [[1, 1, "P"], [0, 1, 0], [1, 0, 1], [1, 2, 2], [2, 1, 3]],
  Synchronization: [[0, 0, 0, "on"], [0, 2, 1, "on"], [1, 1, 2, "off"], [2, 0, 3, "on"], [2, 2, 4, "on"]],
  Foraging: [[0, 2, "F"], [2, 0, "N"], [1, 1, 0, "food"], [0, 1, 1], [2, 1, 2, "food"]],
  Flocking: [[0, 0, 0], [0, 1, 1], [0, 2, 2], [1, 0, 3], [1, 2, 4], [2, 0, 5], [2, 1, 6]],
};

/** The rules of each task in pictures. @type {Record<string, [Thing[], string][]>} */
export const RULES = {
  Transport: [
    [[[1, 1, "B"], [1, 0, 0, "", "R"]], "The block weighs as much as five agents: fewer cannot push it."],
    [[[0, 2, "B"], [1, 2, "B"], [2, 2, "B"], [0, 1, 0, "", "R"], [1, 1, 1, "", "R"], [2, 1, 2, "", "R"], [0, 0, 3, "", "R"], [1, 0, 4, "", "R"]],
      "Five that push the same way move it, also through those in front."],
    [[[0, 1, "W"], [2, 1, "W"], [1, 1, 0, "", "R"]], "Behind the block the agents leave through the gap. Early is worth more."],
  ],
  Pursuit: [
    [[[1, 1, "P"], [1, 0, 0, "", "R"], [2, 1, 1, "", "U"]], "The prey flees two steps, to where fewest agents and walls are near."],
    [PICTURES.Pursuit, "With no empty cell beside it it is caught, by agents or walls: a point, and another prey comes."],
  ],
  Synchronization: [
    [[[0, 0, 0, "on"], [1, 1, 1, "off"], [2, 2, 2, "on"]], "Each agent switches its own light only, and sees those in its window."],
    [[[0, 0, 0, "on"], [1, 1, 1, "on"], [2, 2, 2, "on"]], "All on, or all off: a point, if it was the other way when it scored last."],
  ],
  Foraging: [
    [[[0, 1, "F"], [1, 1, 0, "food"]], "An agent beside the source takes food. The source is never empty."],
    [[[2, 1, "N"], [1, 1, 0, "food"]], "Beside the nest it leaves it: a point."],
    [[[1, 0, 0, "food", "R"], [1, 1, 1, "", "L"]], "On narrow ways agents are in each other's way."],
  ],
  Flocking: [
    [PICTURES.Flocking, "The shape is the outline of a square, anywhere on the map."],
    [[[0, 0, 0, "", "R"], [2, 1, 1, "", "U"], [1, 2, 2]], "The score is how much closer the agents came to it than they began, at their best moment."],
  ],
};

/** Cells with things in them. @param {{task?: string, of?: Thing[]}} props */
export const TaskPicture = ({ task = "", of = PICTURES[task] }) => html`<svg class="cells task-picture" viewBox="-1 -1 62 62" width="60" height="60" aria-hidden="true">
  <rect class="floor" width="60" height="60" />
  <path class="lattice" d="M0 0H60V60H0ZM20 0V60M40 0V60M0 20H60M0 40H60" />
  ${of.map(([i, j, what, sign, move]) =>
    typeof what === "string"
      ? shapeAt(what, i, j)
      : html`<g transform=${`translate(${(j + 0.5) * CELL} ${(i + 0.5) * CELL})`}>
        ${move && html`<${Arrow} action=${move} agent=${what} />`}<${AgentShape} agent=${what} sign=${sign || null} /></g>`,
  )}
</svg>`;
