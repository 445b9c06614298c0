// Clicks on agents of a map.

/** @import { Head, State } from "./game.js" */

/** The maximum distance of a click from an agent's centre, in cells. */
const REACH = 1.5;

/**
 * Chooses the agent nearest to a click.
 * @param {MouseEvent} event
 * @param {Head} head
 * @param {State} state
 * @param {((agent: number) => void) | undefined} onChoose
 */
export function choose(event, head, state, onChoose) {
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
