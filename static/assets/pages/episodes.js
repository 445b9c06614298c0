// All games that the reader may see, running ones first.
import { html, useState } from "../ui.js";
import { route, withQuery } from "../api.js";
import { Sparkline, alike } from "../parts/chart.js";
import { Check, Choice, Filters, Model, fits, useFilters } from "../parts/filters.js";
import { Items, ListTable } from "../parts/listed.js";
import { More, usePages, useReadOn } from "../parts/pages.js";
import { useTitle } from "../parts/query.js";
import { Status } from "../parts/status.js";
import { SortHead } from "../parts/table.js";
import { TASKS } from "../parts/tasks.js";
import { Name, Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

const STATUSES = ["waiting", "running", "finished", "aborted", "abandoned"];

/** The interval between reads of running games. */
const LIVE_MS = 5000;

/** The number of games that are compared. */
const COMPARED = 2;

/** The number of games per page. */
const PAGE_ITEMS = 50;

/** The pages that are read by themselves where filters leave them empty: a sorted list looks at some games for each. */
const EMPTY_MAX = 8;

export function Page() {
  const filters = useFilters(["task", "status", "model", "run", "people"]);
  const [typed, setTyped] = useState("");
  const [chosen, setChosen] = useState(/** @type {string[]} */ ([]));
  useTitle("Games");
  const sort = filters.query.get("sort") || "newest";
  /** @param {string} id */
  const choose = (id) => setChosen(chosen.includes(id) ? chosen.filter((one) => one !== id) : [...chosen, id].slice(-COMPARED));
  const props = { filters, typed, sort, chosen, choose };
  return html`
    <h1>Games</h1>
    <${Filters} filters=${filters}>
      <${Choice} label="Task" options=${TASKS} ...${filters.of("task")} />
      <${Choice} label="Status" options=${STATUSES} ...${filters.of("status")} />
      <${Model} onType=${setTyped} ...${filters.of("model")} />
      <${Check} label="With people" ...${filters.of("people")} />
      <a href="/imports">Imported games</a>
    <//>
    ${chosen.length > 0 &&
    html`<p class="buttons stays" aria-live="polite">
      ${chosen.length === COMPARED
        ? html`<a href=${withQuery("/compare", { a: chosen[0], b: chosen[1] })}>Compare the two chosen games</a>
            <button type="button" class="quiet" onClick=${() => setChosen([])}>Choose others</button>`
        : html`<span class="muted">Choose one more to compare the two.</span>`}
    </p>`}
    ${filters.values.status === "" && html`<${Live} ...${props} />`}
    <${All} ...${props} />
  `;
}

/** @typedef {{filters: ReturnType<typeof useFilters>, typed: string, sort: string, chosen: string[], choose: (id: string) => void}} Props */

/** Games that run now; nothing where there are none. @param {Props} props */
function Live({ filters, typed, ...props }) {
  const list = usePages(withQuery("/api/v1/episodes", { ...filters.values, status: "running", limit: PAGE_ITEMS }), LIVE_MS);
  const items = list.items.filter((game) => fits(game.model, typed));
  if (items.length === 0) return null;
  return html`<h2>Live</h2>
    <${Items} label="Live games" items=${items} header=${-1} columns=${columnsOf(items, props)} />
    <${More} list=${list} />`;
}

/** @param {Props} props */
function All({ filters, typed, ...props }) {
  const { values, isFiltered, change } = filters;
  const [isNewest, isOfAll] = [props.sort === "newest", values.status === ""];
  const asked = { ...values, sort: isNewest ? null : props.sort, curves: true, limit: PAGE_ITEMS };
  const mayRun = isOfAll || values.status === "running";
  const list = usePages(withQuery("/api/v1/episodes", asked), isNewest && mayRun ? LIVE_MS : undefined);
  useReadOn(list, list.items.length === 0 && list.pages < EMPTY_MAX);
  const items = list.items.filter((game) => (!isOfAll || game.status !== "running") && fits(game.model, typed));
  const none = isFiltered || typed ? "No game fits these filters. Choose others." : html`<${None} />`;
  const columns = columnsOf(items, props, (sort) => change({ sort }));
  return html`
    <h2>${isOfAll ? "Ended and waiting" : values.status[0].toUpperCase() + values.status.slice(1)}</h2>
    ${typed &&
    html`<p class="muted" role="status">
      ${items.length} of the ${list.items.length} games below fit “<${Text} value=${typed} />”. A whole name looks through all games.
    </p>`}
    <${ListTable} label="Games" list=${{ ...list, items }} columns=${columns} header=${-1}
      empty=${list.hasMore ? "None of the games that were looked at fits. There are more." : none} />
  `;
}

const None = () => html`No game has ended yet, or none that can be read without a key: those of <a href="/competitions">competitions</a> are sealed
  while they are open. <a href="/play">Play one</a>, or start one with <code>swarmbench play --task Pursuit</code>.`;

/**
 * The columns of games; these are sorted by the server, and have their courses, where there is `onSort`.
 * @param {any[]} games @param {Pick<Props, "sort" | "chosen" | "choose">} props @param {(sort: string) => void} [onSort]
 */
function columnsOf(games, { sort, chosen, choose }, onSort) {
  const score = alike(games.map((game) => game.score));
  /** @param {string} name @param {string} by @param {string} [back] @param {boolean} [isUp] */
  const head = (name, by, back = `-${by}`, isUp = false) =>
    onSort
      ? html`<${SortHead} name=${name.replace("#", "")} isNumber=${name[0] === "#"} ...${{ by, back, isUp, sort, onSort }} />`
      : name;
  const game = ({ id, task, ...game }) =>
    html`<a href=${route`/episodes/${id}`}>${task}<span class="unseen"> ${id}</span></a> <${Badges} ...${game} />`;
  const course = ({ curve, score: last }) =>
    curve?.some(Boolean) && html`<${Sparkline} values=${curve} label=${`Score from 0 to ${score(last)}`} width=${64} />`;
  const compare = ({ id, task }) =>
    html`<input type="checkbox" aria-label=${`Compare ${task} ${id}`} checked=${chosen.includes(id)} onChange=${() => choose(id)} />`;
  return [
    ["Game", game],
    ["Model", ({ model }) => html`<${Name} value=${model} />`],
    [head("#Score", "score"), (game) => score(game.score)],
    onSort && ["Course", course],
    [head("#Rounds", "rounds"), (game) => html`${game.round}<span class="muted">/${game.config.max_round}</span>`],
    [head("#Seed", "seed", "-seed", true), (game) => html`<span class="small">${game.config.seed ?? "–"}</span>`],
    [head("Created", "newest", "oldest"), (game) => html`<${Time} value=${game.created_at} />`],
    ["Compare", compare],
  ];
}

/** What is special about a game; most are played to their end by one model. */
const Badges = ({ void_reason, status, people, mixed, fork }) => html`
  ${void_reason !== null && html`<span class="badge bad" title=${void_reason}>voided</span>`}
  ${void_reason === null && status !== "finished" && html`<${Status} status=${status} />`}
  ${people && html` <span class="badge" title="A person takes part, as declared">people</span>`}
  ${mixed && html` <span class="badge" title="Several holders could take seats">mixed</span>`}
  ${fork && html` <span class="badge" title="It plays on from a round of another game">fork</span>`}
`;
