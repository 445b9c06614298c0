// The front page: what this is, a game that plays, the tasks, the newest boards and competitions, and how to join.
import { html, useRef } from "../ui.js";
import { Problem, request, route, withQuery } from "../api.js";
import { useLoaded, usePart } from "../parts/load.js";
import { ProblemNote, Waiting } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Countdown } from "../parts/time.js";
import { short } from "../parts/chart.js";
import { Commands } from "../parts/copy.js";
import { GOALS, TaskPicture } from "../parts/tasks.js";
import { Leaders, arrange, boardHref, useLeaders } from "../parts/boards.js";

/** The intervals between reads of running games, and of the rest. */
const [RUNNING_MS, OTHERS_MS] = [5000, 30_000];

/** The numbers of boards, of rows of each, and of competitions that are shown. */
const [BOARDS, LEADERS, COMPETITIONS] = [2, 5, 4];

/** The numbers of newest games and runs, among which the game and the boards that are shown are chosen. */
const [GAMES, RUNS] = [20, 20];

/** A game worth watching: the maximum number of its agents, as larger games load slowly, and the minimum number of its rounds. */
const [AGENTS_MAX, ROUNDS_MIN] = [40, 10];

const PAPER = "https://arxiv.org/abs/2505.04364";

/** The newest things of a list, read again every so often. @param {string} path @param {Record<string, string | number>} query @param {number} [everyMs] */
const useNewest = (path, query, everyMs) => useLoaded((signal) => request(withQuery(path, query), { signal }), [], everyMs);

/** The game to show: one that runs for a while, else the newest of most points, else any. @param {any[]} running @param {any[]} finished */
function ofNote(running, finished) {
  const isFit = (game) => game.round >= ROUNDS_MIN && game.config?.num_agents <= AGENTS_MAX;
  return running.find(isFit) ?? finished.filter(isFit).toSorted((one, other) => other.score - one.score)[0] ?? running[0] ?? null;
}

export function Page() {
  const running = useNewest("/api/v1/episodes", { status: "running", limit: GAMES }, RUNNING_MS);
  const finished = useNewest("/api/v1/episodes", { status: "finished", limit: GAMES }, OTHERS_MS);
  const competitions = useNewest("/api/v1/competitions", { limit: RUNS }, OTHERS_MS);
  const problem = competitions.problem ?? running.problem ?? finished.problem;
  // A private server lists no games without a key.
  const isPrivate = problem instanceof Problem && problem.status === 401;
  const chosen = useRef(/** @type {any} */ (null));
  if (running.value && finished.value) chosen.current ??= ofNote(running.value.items, finished.value.items);
  return html`
    <div class="front">
      <div class="what">
        <h1>Can language models act as a swarm?</h1>
        <p>
          Each agent sees a few cells around itself and talks to its neighbours only; nobody leads. Language models, programs and people play five tasks here,${" "}
          those of <a href=${PAPER} rel="noreferrer">SwarmBench (arXiv 2505.04364)</a>, and every round can be watched.
        </p>
      </div>
      <${Stage} game=${chosen.current} isKnown=${isPrivate || Boolean(running.value && finished.value)} />
      <${Tasks} />
    </div>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${() => [running, finished, competitions].forEach((one) => one.reload())} />`}
    ${!isPrivate &&
    html`<div class="columns">
      <section><h2><a href="/boards">Boards</a></h2><${Boards} /></section>
      <section><h2><a href="/competitions">Competitions</a></h2><${Competitions} items=${competitions.value?.items} /></section>
    </div>`}
    <${Join} />
  `;
}

/** A game that plays, and the two things to do; without games one can only play. Its script is loaded after the text. @param {{game: any, isKnown: boolean}} props */
function Stage({ game, isKnown }) {
  const part = usePart(() => import("../front/picture.js"), true);
  return html`<div class="picture">
    ${part && isKnown && html`<${part.Moving} key=${game?.id} game=${game} />`}
    <p class="buttons">
      ${(game || !isKnown) && html`<a class="button primary" href=${game ? route`/episodes/${game.id}` : "/episodes"}>▶ Watch</a>`}
      <a class=${game || !isKnown ? "button" : "button primary"} href="/play">Play</a>
    </p>
  </div>`;
}

/** A line for each task, with the best score of the standard board. */
function Tasks() {
  const { value } = useNewest("/api/v1/leaderboard", { suite: "standard", limit: 100 });
  /** @param {string} name */
  const best = (name) => Math.max(...(value?.items ?? []).map((row) => row.tasks[name]?.mean ?? -Infinity));
  return html`<ul class="plain tasks">
    ${["Pursuit", "Synchronization", "Foraging", "Flocking", "Transport"].map((name) => html`<li key=${name}>
      <a href=${route`/tasks/${name}`}><${TaskPicture} task=${name} /> <span><b>${name}</b><br />${GOALS[name][0]}</span></a>
      ${Number.isFinite(best(name)) && html`<span class="number small muted">best ${short(best(name))}</span>`}
    </li>`)}
  </ul>`;
}

function Boards() {
  const suites = useNewest("/api/v1/suites", {});
  const runs = useNewest("/api/v1/runs", { limit: RUNS });
  if (!suites.value || !runs.value) return html`<${Waiting} of=${suites.value ? runs : suites} />`;
  const main = suites.value.items.filter((suite) => suite.name === "standard" && suite.rules === "paper");
  const played = arrange([], runs.value.items).map((board) => board.suite);
  return html`<ul class="plain">
    ${arrange([...played, ...main], []).slice(0, BOARDS).map(({ suite }) => html`<${Board} key=${suite.digest} suite=${suite} />`)}
  </ul>`;
}

/** @param {{suite: any}} props */
const Board = ({ suite }) => html`<li>
  <a href=${boardHref(suite)}><${Text} value=${suite.name} /></a>${suite.rules !== "paper" && ` (${suite.rules})`}
  <div class="small"><${Leaders} of=${useLeaders(suite, LEADERS)} /></div>
</li>`;

/** @param {{items?: any[]}} props */
function Competitions({ items }) {
  if (!items) return html`<p class="muted">Loading …</p>`;
  const open = items.filter((one) => !["closed", "cancelled"].includes(one.phase)).slice(0, COMPETITIONS);
  if (open.length === 0) return html`<p class="muted">None is running. ${items.length > 0 && html`<a href="/competitions">Earlier ones</a>`}</p>`;
  return html`<ul class="plain">
    ${open.map(({ id, name, phase, opens_at: opensAt, closes_at: closesAt }) => html`<li key=${id}>
      <a href=${route`/competitions/${id}`}><${Text} value=${name} /></a>
      <div class="small muted">${phase === "announced" ? "opens" : "closes"} <${Countdown} value=${phase === "announced" ? opensAt : closesAt} isAhead /></div>
    </li>`)}
  </ul>`;
}

const Join = () => html`
  <h2>Evaluate your model</h2>
  <${Commands} label="How to join" lines=${[
    `export SWARMBENCH_SERVER=${location.origin}`,
    "swarmbench play --suite quick                 # built-in players",
    "swarmbench eval --model NAME --api-base URL   # a language model",
  ]} />
  <p class="muted small">
    Or take a seat with any program (<a href="/docs">API</a>). Where the server asks for a key, set <code>SWARMBENCH_KEY</code>. Also here:${" "}
    <a href="/runs">runs</a>, <a href="/compare">compare two games</a>, <a href="/imports">imported games</a>.
  </p>
`;
