// The end of a game: its result, and the whole game with all that its player could not see.
import { html } from "../ui.js";
import { request, route, tokenOf, withQuery } from "../api.js";
import { standing } from "../game/marks.js";
import { PARTS } from "../game/parts.js";
import { Viewer } from "../game/viewer.js";
import { agentOf } from "../parts/actions.js";
import { Loaded, useLoaded } from "../parts/load.js";
import { openGame } from "../parts/served.js";
import { againQuery } from "./player.js";

/** @param {{id: string, summary: any, obs: any, leave: () => void}} props */
export function Afterwards({ id, summary, obs, leave }) {
  if (id.startsWith("run_")) return html`<${RunOver} id=${id} leave=${leave} />`;
  if (!summary?.result) return html`<h1>The game is over</h1><p class="muted" role="status">Loading …</p>`;
  const { result, config } = summary;
  const own = obs ? agentOf(obs) : 0;
  return html`<h1>${summary.task}: the game is over</h1>
    <p role="status">
      ${standing(/** @type {any} */ ({ head: { status: summary.status, rounds: result.rounds }, summary }))} The swarm scored <b class="number">${result.score.toFixed(2)}</b>.
    </p>
    <p class="buttons">
      <a class="button primary" href=${withQuery("/play", againQuery(config))}>Play again</a>
      <a class="button" href=${`${route`/episodes/${id}`}#r=0&a=${own}`}>Page of the whole game</a>
      <button type="button" class="quiet" onClick=${leave}>Forget this seat in this tab</button>
    </p>
    <${Unseen} id=${id} agent=${own} />`;
}

/** The game from above, with the agent of the player. @param {{id: string, agent: number}} props */
function Unseen({ id, agent }) {
  const whole = useLoaded((signal) => openGame(id, signal), [id]);
  return html`<${Loaded} of=${whole} what="The whole game">${(game) => html`<h2>What you could not see</h2>
    <div class="watch"><${Viewer} game=${game} parts=${PARTS} agent=${agent} /></div>`}<//>`;
}

/** @param {{id: string, leave: () => void}} props */
function RunOver({ id, leave }) {
  const loaded = useLoaded((signal) => request(route`/api/v1/runs/${id}`, { token: tokenOf(id), signal }), [id]);
  return html`<h1>All games are over</h1>
    <p class="buttons">
      <a class="button primary" href=${route`/runs/${id}`}>Your games</a>
      <${Loaded} of=${loaded}>${({ suite }) => html`<a class="button" href=${route`/board/${suite.name}`}>The board</a>`}<//>
      <a class="button" href="/play">Play again</a>
      <button type="button" class="quiet" onClick=${leave}>Forget this run in this tab</button>
    </p>`;
}
