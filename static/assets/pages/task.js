// A task: what the swarm has to do, the rules in pictures, what players score, and its best games.
import { html } from "../ui.js";
import { request, route, withQuery } from "../api.js";
import { short } from "../parts/chart.js";
import { Items } from "../parts/listed.js";
import { Loaded, useLoaded } from "../parts/load.js";
import { useTitle } from "../parts/query.js";
import { PARTS, Score, rowHref, scale, totalOf } from "../parts/boards.js";
import { Legend } from "../parts/shapes.js";
import { GOALS, RULES, TASKS, TaskPicture } from "../parts/tasks.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

/** The numbers of players and games that are listed. */
const [PLAYERS, GAMES] = [10, 10];

/** @param {{task: string}} props */
export function Page({ task }) {
  useTitle(task);
  if (!TASKS.includes(task)) {
    return html`<h1>No such task</h1><ul class="plain">${TASKS.map((name) => html`<li><a href=${route`/tasks/${name}`}>${name}</a></li>`)}</ul>`;
  }
  return html`
    <h1>${task}</h1>
    <p>${GOALS[task][1]}</p>
    <ul class="plain rules">
      ${RULES[task].map(([picture, words]) => html`<li><${TaskPicture} of=${picture} /> <p>${words}</p></li>`)}
    </ul>
    <${Legend} task=${task} />
    <p class="buttons"><a class="button primary" href=${withQuery("/play", { task })}>Play it</a> <a class="button" href=${withQuery("/episodes", { task })}>All games</a></p>
    <h2>What players score on the standard seeds</h2>
    <${Players} task=${task} />
    <h2>Best of the newest games</h2>
    <${Games} task=${task} />
  `;
}

/** The board of the standard suite, by this task. @param {{task: string}} props */
function Players({ task }) {
  const board = useLoaded((signal) => request(withQuery("/api/v1/leaderboard", { suite: "standard", task, limit: PLAYERS }), { signal }), [task]);
  const rows = (board.value?.items ?? []).map((row) => ({ ...row, of: totalOf(row, [task]) }));
  const player = (row) =>
    html`<a href=${rowHref(board.value, row)}><${Text} value=${row.model} /></a>${row.reference && html` <span class="badge">paper</span>`}`;
  /** A table of each kind of players, with a scale of its own. */
  const table = ({ label, has }) => {
    const items = rows.filter(has);
    const range = scale(items.map(({ of }) => of));
    const columns = [["Player", player], ["#Mean", ({ of }) => html`<${Score} of=${of} range=${range} name=${task} />`]];
    return items.length > 0 && html`<h3>${label}</h3><${Items} label=${label} columns=${columns} items=${items} />`;
  };
  return html`<${Loaded} of=${board}>${() => PARTS.map(table)}<//>
    <p class="small"><a href=${withQuery("/board/standard", { task })}>The whole board</a></p>`;
}

/** @param {{task: string}} props */
function Games({ task }) {
  const games = useLoaded((signal) => request(withQuery("/api/v1/episodes", { task, status: "finished", limit: 100 }), { signal }), [task]);
  const best = games.value?.items.toSorted((one, other) => other.score - one.score).slice(0, GAMES);
  const columns = [
    ["#Score", ({ id, score }) => html`<a href=${route`/episodes/${id}`}>${short(score)}</a>`],
    ["Player", ({ model }) => html`<${Text} value=${model} />`],
    ["#Agents", ({ config }) => config?.num_agents],
    ["Played", ({ ended_at: endedAt }) => html`<${Time} value=${endedAt} />`],
  ];
  return html`<${Loaded} of=${games}>${() => best.length === 0
    ? html`<p class="empty">Nobody has played it here yet.</p>`
    : html`<${Items} label="Best games" columns=${columns} items=${best} />`}<//>`;
}
