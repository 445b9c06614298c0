// What a game is: its name and status, and notices.
import { html, useEffect } from "../ui.js";
import { request, route } from "../api.js";
import { short } from "../parts/chart.js";
import { isLive } from "../parts/game.js";
import { GOALS } from "../parts/goals.js";
import { useLoaded } from "../parts/load.js";
import { Text, visible } from "../parts/text.js";
import { standing } from "./marks.js";
import { nextOf } from "../parts/words.js";

/** @import { Game } from "../parts/game.js" */

/** @typedef {{kind: Game["kind"], summary: any, head: Pick<Game["head"], "id" | "task" | "status" | "rounds"> & {score?: number}}} Shown */

/** The first lines of a game's page, and the title of its document. @param {{game: Shown, isLinked?: boolean}} props */
export function Title({ game, isLinked }) {
  const { head, summary } = game;
  useEffect(() => void (document.title = `${visible(head.task)} · ${visible(summary.model ?? "")} · swarmbench`), []);
  const seed = summary.config?.seed ?? summary.seed;
  return html`<div class="title">
    <h1>${isLinked && GOALS[head.task] ? html`<a href=${route`/tasks/${head.task}`}>${head.task}</a>` : html`<${Text} value=${head.task} />`} <span class="muted">·</span> <${Text} value=${summary.model ?? ""} /></h1>
    <p class="muted">
      ${seed !== null && seed !== undefined && html`seed ${seed} · `}
      <span class=${isLive(head) ? "badge live" : "badge"}>${head.status}</span> ${standing(game)}
    </p>
    ${GOALS[head.task] && html`<p class="goal">${GOALS[head.task][1]}</p>`}
    ${head.score !== undefined && html`<p class="total number"><span class="small muted">score </span>${short(head.score)}</p>`}
  </div>`;
}

/** Notices above a game. @param {{game: Game}} props */
export function Notices({ game: { head, summary, isLost, kind, first, last } }) {
  const isPart = kind === "file" && (first > 0 || last < (summary.result?.rounds ?? head.rounds));
  return html`
    ${isPart && html`<div class="notice"><p>This file has the rounds ${first} to ${last} of the game.</p></div>`}
    ${kind !== "file" && summary.fork && html`<div class="notice"><p>This game plays on from <${Parent} fork=${summary.fork} />. It counts on no board.</p></div>`}
    ${summary.void_reason &&
    html`<div class="problem"><h2>This game was voided</h2><p>It counts nowhere. The reason: <${Text} value=${summary.void_reason} />${kind === "episodes" && summary.run && html`<${Successor} ...${summary} />`}</p></div>`}
    ${head.status === "waiting" &&
    html`<div class="notice">
      <p>
        ${summary.config?.open_seats > 0
          ? html`<strong>This game waits for players.</strong> It begins when every seat is taken. <a href=${route`/play/${head.id}`}>Take a seat</a>.`
          : html`<strong>This game has not started.</strong> Its creator starts it. This page shows it from its first round on.`}
      </p>
    </div>`}
    ${head.rounds === 0 && head.status !== "waiting" && !isLive(head) && html`<div class="notice"><p><strong>No round was played.</strong> The map shows how it would have begun.</p></div>`}
    ${head.rounds === 0 && head.status === "running" && html`<div class="notice"><p><strong>The first round is being decided.</strong> It is shown here when all agents have answered.</p></div>`}
    <p class="lost bad" role="status">${isLost && kind !== "file" && isLive(head) ? "The connection is lost. Trying again …" : ""}</p>
  `;
}

/** The game that its run has in the place of a voided one. @param {{id: string, run: string}} props */
function Successor({ id, run }) {
  const { value } = useLoaded((signal) => request(route`/api/v1/runs/${run}`, { signal }), [run]);
  const next = value && nextOf({ episode: id, ...value.games.find(({ episode }) => episode === id) }, value.games);
  return next?.episode && html`<br />In its place: <a href=${route`/episodes/${next.episode}`}>the game that was played again</a>, ${next.status}.`;
}

/** The round of another game from which this one plays on. @param {{fork: {episode: string, round: number}}} props */
export const Parent = ({ fork }) => html`<a href=${`${route`/episodes/${fork.episode}`}#r=${fork.round}`}>round ${fork.round} of another game</a>`;
