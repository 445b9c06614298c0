// The front page: an introduction, running games, and how to join.
import { html, useEffect, useRef, useState } from "../ui.js";
import { Problem, request, route, withQuery } from "../api.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Countdown, Time } from "../parts/time.js";
import { short } from "../parts/chart.js";
import { Commands } from "../parts/copy.js";
import { Leaders, arrange, boardHref, useLeaders } from "../parts/boards.js";

const RUNNING_MS = 5000;
const OTHERS_MS = 30_000;

/** The number of lines of each list. */
const GAMES = 4;
const BOARDS = 4;
const LEADERS = 1;

/** The maximum number of agents of the game in the picture: larger games load slowly. */
const PICTURE_AGENTS_MAX = 40;

/** The number of newest runs whose boards are shown. */
const RUNS = 20;

/** @param {Record<string, string | number>} query */
const games = (query) => (/** @type {AbortSignal} */ signal) => request(withQuery("/api/v1/episodes", query), { signal });

export function Page() {
  const running = useLoaded(games({ status: "running", limit: GAMES }), [], RUNNING_MS);
  const finished = useLoaded(games({ status: "finished", limit: GAMES }), [], OTHERS_MS);
  const competitions = useLoaded((signal) => request(withQuery("/api/v1/competitions", { limit: RUNS }), { signal }), [], OTHERS_MS);
  const problem = competitions.problem ?? running.problem ?? finished.problem;
  // A private server lists no games without a key.
  const isPrivate = problem instanceof Problem && problem.status === 401;
  const newest = [...(running.value?.items ?? []), ...(finished.value?.items ?? [])];
  const isEmpty = !isPrivate && competitions.value && running.value && finished.value && newest.length === 0;
  const chosen = useRef(/** @type {any} */ (null));
  chosen.current ??= newest.find((game) => game.round > 0 && game.config?.num_agents <= PICTURE_AGENTS_MAX) ?? null;
  return html`
    <div class="front">
      <div>
        <h1>Can language models act as a swarm?</h1>
        <p>
          Each agent sees a few cells around itself and talks to its neighbours only. Nobody leads. Here swarms of models, programs and
          people play five tasks, and every game can be looked at, round by round.
        </p>
        <${Join} isEmpty=${isEmpty} />
      </div>
      <${Picture} game=${chosen.current} isEmpty=${isEmpty} />
    </div>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${() => [running, finished, competitions].forEach((one) => one.reload())} />`}
    ${!isPrivate &&
    html`<div class="columns">
      <section>
        <h2><a href="/episodes">Games</a></h2>
        <${Games} running=${running.value?.items} finished=${finished.value?.items} />
      </section>
      <section>
        <h2><a href="/boards">Boards</a></h2>
        <${Boards} />
      </section>
      <section>
        <h2><a href="/competitions">Competitions</a></h2>
        <${Competitions} items=${competitions.value?.items} />
        <h2>Read on</h2>
        <p><a href="/docs">All routes of the API</a>, <a href="/runs">runs</a>, <a href="/compare">compare two games</a>, <a href="/imports">imported games</a></p>
      </section>
    </div>`}
  `;
}

/** @param {{isEmpty: boolean | null}} props */
const Join = ({ isEmpty }) => html`
  <h2>${isEmpty ? "No game has been played here yet. Start one:" : "Join"}</h2>
  ${isEmpty &&
  html`<${Commands} label="The first game" what="the command" lines=${[`curl ${location.origin}/api/v1/episodes -H 'Content-Type: application/json' -d '{"task": "Pursuit", "player": "default"}'`]} />
    <p class="muted">Or <a href="/play">play yourself</a>, or let models play:</p>`}
  <${Commands}
    label="How to join"
    lines=${[
      `export SWARMBENCH_SERVER=${location.origin}`,
      "swarmbench play --suite quick                 # built-in players",
      "swarmbench eval --model NAME --api-base URL   # a language model",
    ]}
  />
  <p class="muted small">
    Or take a seat with any program (<a href="/docs">API</a>) or yourself: <a href="/play">play</a>. Where the server asks for a key, set${" "}
    <code>SWARMBENCH_KEY</code>.
  </p>
`;

/** A game that moves. Its script is loaded after the text. @param {{game: any, isEmpty: boolean | null}} props */
function Picture({ game, isEmpty }) {
  const [Moving, setMoving] = useState(/** @type {any} */ (null));
  useEffect(() => {
    import("../front/picture.js").then((module) => setMoving(() => module.Moving), console.error);
  }, []);
  if (isEmpty) return null;
  return html`<div class="picture">${Moving && game && html`<${Moving} key=${game.id} game=${game} />`}</div>`;
}

/** @param {{running?: any[], finished?: any[]}} props */
const Games = ({ running, finished }) => {
  if (!running || !finished) return html`<p class="muted">Loading …</p>`;
  if (running.length + finished.length === 0) return html`<p class="empty">None yet.</p>`;
  return html`<ul class="plain">
    ${[...running, ...finished].slice(0, GAMES + 2).map(
      (game) => html`<li key=${game.id}>
        <a href=${route`/episodes/${game.id}`}>${game.task}</a> <span class="small">score <span class="number">${short(game.score)}</span></span> ${" "}
        ${game.status === "running"
          ? html`<span class="badge good">round ${game.round}${game.config?.max_round ? ` of ${game.config.max_round}` : ""}</span>`
          : html`<span class="muted small"><${Time} value=${game.ended_at} /></span>`}
        <div class="small muted"><${Text} value=${game.model} /></div>
      </li>`,
    )}
  </ul>`;
};

function Boards() {
  const { value } = useLoaded(
    (signal) =>
      Promise.all([request("/api/v1/suites", { signal }), request(withQuery("/api/v1/runs", { limit: RUNS }), { signal })]),
    [],
  );
  if (!value) return html`<p class="muted">Loading …</p>`;
  const [suites, runs] = value;
  const main = suites.items.filter((/** @type {any} */ suite) => suite.name === "standard" && suite.rules === "paper");
  const played = arrange([], runs.items).map((board) => board.suite);
  const boards = arrange([...main, ...played], []);
  return html`<ul class="plain">
    ${boards.slice(0, BOARDS).map(({ suite }) => html`<${Board} key=${suite.digest} suite=${suite} />`)}
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
  const open = items.filter((one) => one.phase !== "closed").slice(0, GAMES);
  if (open.length === 0) return html`<p class="muted">None is running. ${items.length > 0 && html`<a href="/competitions">Earlier ones</a>`}</p>`;
  return html`<ul class="plain">
    ${open.map(
      (one) => html`<li key=${one.id}>
        <a href=${route`/competitions/${one.id}`}><${Text} value=${one.name} /></a>
        <div class="small muted">${one.phase === "announced" ? "opens" : "closes"} <${Countdown} value=${one.phase === "announced" ? one.opens_at : one.closes_at} /></div>
      </li>`,
    )}
  </ul>`;
}
