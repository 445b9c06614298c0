// Forks a game from the round on the page: a new game begins with that state.
import { html, useEffect, useRef } from "../ui.js";
import { visit } from "../app.js";
import { onceKey, request, route } from "../api.js";
import { Secret } from "../parts/copy.js";
import { Refused, allSeats, holdAll } from "./player.js";

/** @typedef {{id: string, round: number, token: string}} Fork */

/** Makes a fork of a game. @param {string} id @param {number} round @returns {Promise<{fork?: Fork, problem?: Error}>} */
export async function madeFork(id, round) {
  try {
    const body = { round, ...allSeats() };
    const { episodes } = await request(route`/api/v1/episodes/${id}/fork`, { method: "POST", body, idempotencyKey: onceKey() });
    return { fork: { id: holdAll(episodes[0]), round, token: episodes[0].swarm_token } };
  } catch (problem) {
    return { problem: /** @type {Error} */ (problem) };
  }
}

/** The game that was made, or why it was not. @param {{fork?: Fork, problem?: Error}} props */
export function Forked({ fork, problem }) {
  const shown = useRef(/** @type {HTMLElement | null} */ (null));
  useEffect(() => shown.current?.focus(), [fork, problem]);
  if (problem) return html`<div ref=${shown} tabindex="-1"><${Refused} problem=${problem} what="The new game" /></div>`;
  if (!fork) return null;
  return html`<section class="notice" ref=${shown} tabindex="-1" aria-label="A new game">
    <p><strong>A new game begins with round ${fork.round} of this one.</strong> What you do there changes nothing here, and it counts on no board.</p>
    <p class="buttons"><button type="button" class="primary" onClick=${() => visit(route`/play/${fork.id}`)}>Play all agents here</button> <a href=${route`/episodes/${fork.id}`}>Watch it</a></p>
    <${Secret} value=${fork.token} label="Token of all its agents"><p class="muted">For a program that plays it.</p><//>
  </section>`;
}
