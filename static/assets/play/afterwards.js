// The end of a game: its result, and all that its player could not see.
import { html, useState } from "../ui.js";
import { request, route, tokenOf, withQuery } from "../api.js";
import { standing } from "../game/marks.js";
import { openGame, useChanges, useMoment } from "../parts/game.js";
import { useLoaded } from "../parts/load.js";
import { GameMap } from "../parts/map.js";
import { againQuery } from "./player.js";
import { OwnRounds } from "./ownrounds.js";
import { ProblemNote } from "../parts/problem.js";
import { numberOf } from "./sight.js";

/** @param {{id: string, summary: any, obs: any, leave: () => void}} props */
export function Afterwards({ id, summary, obs, leave }) {
  if (id.startsWith("run_")) return html`<${RunOver} id=${id} leave=${leave} />`;
  if (!summary?.result) return html`<h1>The game is over</h1><p class="muted" role="status">Loading …</p>`;
  const { result, config } = summary;
  const again = withQuery("/play", againQuery(config));
  return html`<h1>${summary.task}: the game is over</h1>
    <p role="status">
      ${standing(/** @type {any} */ ({ head: { status: summary.status, rounds: result.rounds }, summary }))} The swarm scored <b class="number">${result.score.toFixed(2)}</b>.
    </p>
    <p class="buttons">
      <a class="button primary" href=${`/episodes/${encodeURIComponent(id)}#r=0${obs ? `&a=${numberOf(obs.agent)}` : ""}`}>The whole game</a>
      <a class="button" href=${again}>Play again</a>
      <button type="button" class="quiet" onClick=${leave}>Forget this seat in this tab</button>
    </p>
    <${Unseen} id=${id} first=${obs ? numberOf(obs.agent) : 0} />`;
}

/** The game from above, and what became of the acts of one agent. @param {{id: string, first: number}} props */
function Unseen({ id, first }) {
  const { value: game, problem, reload } = useLoaded((signal) => openGame({ kind: "episodes", id }, signal), [id]);
  const [agent, setAgent] = useState(first);
  const [round, setRound] = useState(0);
  useChanges(game);
  const { state, next } = useMoment(game, round);
  if (problem) return html`<${ProblemNote} problem=${problem} retry=${reload} what="The whole game" />`;
  if (!game || !state) return html`<p class="muted" role="status">Loading what you could not see …</p>`;
  const { head } = game;
  return html`<h2>What you could not see</h2>
    <div class="unseen-game">
      <div>
        <${GameMap} head=${head} state=${state} next=${next} agent=${agent} onChoose=${setAgent} label=${`The map in round ${state.round}`} />
        <label class="round"
          >Round ${state.round} of ${game.last}
          <input
            type="range"
            min="0"
            max=${game.last}
            value=${round}
            onInput=${(/** @type {any} */ event) => setRound(Number(event.target.value))}
          />
        </label>
      </div>
      <${OwnRounds} game=${game} agent=${agent} round=${round} onRound=${setRound} onAgent=${setAgent} />
    </div>`;
}

/** @param {{id: string, leave: () => void}} props */
function RunOver({ id, leave }) {
  const { value: run, problem } = useLoaded((signal) => request(route`/api/v1/runs/${id}`, { token: tokenOf(id), signal }), [id]);
  if (problem) return html`<h1>The run is over</h1><${ProblemNote} problem=${problem} />`;
  if (!run) return html`<h1>The run is over</h1><p class="muted" role="status">Loading …</p>`;
  return html`<h1>All games are over</h1>
    <p class="buttons">
      <a class="button primary" href=${`/runs/${encodeURIComponent(id)}`}>Your games</a>
      <a class="button" href=${`/board/${encodeURIComponent(run.suite.name)}`}>The board</a>
      <a class="button" href="/play">Play again</a>
      <button type="button" class="quiet" onClick=${leave}>Forget this run in this tab</button>
    </p>`;
}
