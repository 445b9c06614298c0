// The games of a run: a row per task, a column per seed.
import { html } from "../ui.js";
import { Sparkline, extent, short } from "./chart.js";
import { Score, scale } from "./rows.js";
import { interval } from "./statistics.js";
import { reasonText, roundsText } from "./status.js";

/**
 * Games by task and seed. If a game was voided and played again, the newest one is shown.
 * @param {any[]} games in the order of the plan
 */
function arrange(games) {
  /** @type {Map<string, Map<string, any[]>>} */
  const tasks = new Map();
  /** @type {Map<string, number | null>} */
  const seeds = new Map();
  for (const game of games) {
    const row = tasks.get(game.task) ?? new Map();
    tasks.set(game.task, row);
    // While seeds are secret, games are numbered within the task.
    const place = [...row.values()].findIndex((of) => of[0].slot === game.slot);
    const name = game.seed === null ? `game ${(place < 0 ? row.size : place) + 1}` : `seed ${game.seed}`;
    seeds.set(name, game.seed);
    row.set(name, [...(row.get(name) ?? []), game]);
  }
  return { tasks, seeds: [...seeds.keys()] };
}

/** @param {{run: any, scores: import("./runs.js").Scores}} props */
export function GameGrid({ run, scores }) {
  const { tasks, seeds } = arrange(run.games);
  const caption = "Score of each game by task and seed";
  return html`<div class="scroll" tabindex="0" role="region" aria-label=${caption}>
    <table class="games">
      <caption class="unseen">${caption}</caption>
      <thead>
        <tr>
          <th scope="col">Task</th>
          <th scope="col" class="number">Mean ± deviation</th>
          ${seeds.map((seed) => html`<th scope="col" class="number">${seed}</th>`)}
        </tr>
      </thead>
      <tbody>
        ${[...tasks].map(([task, of]) => {
          const range = extent([...of.values()].flatMap((games) => games.flatMap((game) => scores.get(game.episode)?.scores ?? [])));
          return html`<tr key=${task}>
            <th scope="row">${task}</th>
            <td class="number"><${Mean} run=${run} task=${task} /></td>
            ${seeds.map((seed) => html`<td><${Game} games=${of.get(seed) ?? []} seed=${seed} scores=${scores} range=${range} /></td>`)}
          </tr>`;
        })}
      </tbody>
    </table>
  </div>`;
}

/** @param {{run: any, task: string}} props */
function Mean({ run, task }) {
  const result = run.tasks.find((/** @type {any} */ one) => one.task === task);
  if (!result) return null;
  // Once a run is over, games that were never played count as 0.
  const of = interval([{ ...result, games: run.status === "running" ? result.played : result.planned }]);
  return html`${of && html`<${Score} of=${of} deviation=${result.deviation} range=${scale([of])} name=${result.task} />`}
    ${result.played < result.planned && html`<div class="muted small">${result.played} of ${result.planned} played</div>`}`;
}

/** @param {{games: any[], seed: string, scores: import("./runs.js").Scores, range: [number, number]}} props */
function Game({ games, seed, scores, range }) {
  const game = games.at(-1);
  if (!game) return null;
  if (!game.episode) return html`<span class="game muted small">planned</span>`;
  const series = scores.get(game.episode)?.scores;
  const note = noteOf(game, games.length);
  const label = `${game.task}, ${seed}: score ${short(game.score)}, ${game.status} after ${roundsText(game.round)}${note && `, ${note}`}`;
  return html`<a class="game" href=${`/episodes/${encodeURIComponent(game.episode)}`} aria-label=${label} title=${label}>
    <span class="number">${short(game.score)}</span>
    ${series && series.length > 1 && html`<span aria-hidden="true"><${Sparkline} values=${series} range=${range} label="" width=${64} height=${20} /></span>`}
    <span class=${`small ${game.status === "running" ? "good" : note ? "bad" : "muted"}`}>${note || (game.status === "finished" ? "" : `${game.status} ${game.round}`)}</span>
  </a>`;
}

/** The failure of a game, in a few words. @param {any} game @param {number} tries */
function noteOf(game, tries) {
  if (game.void_reason !== null) return "voided";
  if (game.status === "aborted" || game.status === "abandoned") return game.status;
  return tries > 1 ? "played again" : "";
}

/** Games of a run that did not end as planned. @param {any} run */
export const failed = (run) =>
  run.games.filter(
    (/** @type {any} */ game) =>
      game.void_reason !== null || ["aborted", "abandoned"].includes(game.status) || (!game.episode && run.status !== "running"),
  );

/** The reason why a game ended, or was voided. @param {any} game */
export const whyOf = (game) => reasonText(game.reason) || game.status;
