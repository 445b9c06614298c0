// A run: its games by task and seed, their progress, failures, journals and verification, and what its creator can do.
import { html, useEffect, useState } from "../ui.js";
import { Problem, request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { alike, short } from "../parts/chart.js";
import { Commands, Secret } from "../parts/copy.js";
import { Download } from "../parts/download.js";
import { Items } from "../parts/listed.js";
import { Waiting } from "../parts/problem.js";
import { useTitle } from "../parts/query.js";
import { About, GameGrid, Metrics, isFailed, useRun, useScores } from "../parts/run.js";
import { Status, failuresText, percent, runStatusText } from "../parts/status.js";
import { Shown } from "../parts/table.js";
import { Text, visible } from "../parts/text.js";
import { ending, renewals } from "../parts/tokens.js";
import { nextOf, reasonText, roundsText } from "../parts/words.js";

/** The intervals between reads of a running run, and of its curves. */
const POLL_MS = 3000;
const CURVES_MS = 10_000;

/** @param {{id: string}} props */
export function Page({ id }) {
  const [isRunning, setIsRunning] = useState(false);
  const loaded = useRun(id, isRunning ? POLL_MS : undefined);
  const run = loaded.value;
  const scores = useScores(id, run?.played, isRunning ? CURVES_MS : undefined);
  useEffect(() => setIsRunning(run?.status === "running"), [run]);
  useTitle(run && `${visible(run.model)} on ${run.attempt === null ? visible(run.suite.name) : "a competition"}: run`);
  if (!run) return html`<h1>Run</h1><${Waiting} of=${loaded} what="This run" />`;
  return html`
    <h1><${Text} value=${run.model} /> on ${run.attempt === null ? html`<${Text} value=${run.suite.name} />` : "a competition"}</h1>
    <${Progress} run=${run} />
    ${loaded.problem && html`<p class="bad" role="status">The connection is lost. This page tries again by itself.</p>`}
    ${run.waits_for &&
    html`<p role="status">
      It waits for a limit of the server before it opens more games: <code><${Text} value=${run.waits_for.name ?? run.waits_for} /></code>.
    </p>`}
    <h2>Games</h2>
    <${GameGrid} run=${run} scores=${scores} />
    <${Failures} run=${run} />
    <h2>Metrics</h2>
    <${Metrics} id=${run.id} version=${run.played} />
    <h2>All games as a list</h2>
    <${Games} games=${run.games} />
    <${About} run=${run} />
    <${Actions} run=${run} changed=${loaded.reload} />
  `;
}

const Progress = ({ run: { status, played, planned, voided, total, void_reason } }) => html`
  <p>
    <${Status} status=${status} of="run" /> ${" "}
    <span role="status">${played} of ${planned} games played${voided > 0 && `, ${voided} voided`}</span>
    ${status === "running" && html` <progress value=${played} max=${Math.max(planned, 1)} aria-label="Games played" />`}
    ${total !== null && html` · total${status === "running" && " so far"} <strong class="number">${short(total)}</strong>`}
    <span class="muted"> · ${runStatusText(status)}.</span>
  </p>
  ${void_reason !== null && html`<p class="bad">This attempt was voided: <${Text} value=${void_reason} />. It is on no board.</p>`}
`;

/** A game with a link to it, if it was opened. */
const GameLink = ({ game: { task, seed, slot, episode } }) => {
  const name = seed === null ? `${task}, game ${slot + 1}` : `${task}, seed ${seed}`;
  return episode ? html`<a href=${route`/episodes/${episode}`}>${name}</a>` : name;
};

/** Why a game counts no more, and the one that is played in its place. @param {{game: any, games: any[]}} props */
const Voided = ({ game, games }) => {
  const next = nextOf(game, games);
  return game.void_reason !== null && html`Voided: <${Text} value=${game.void_reason} />.${next?.episode && html` In its place: <${GameLink} game=${next} />, ${next.status}.`}`;
};

/** The reason why a game ended. */
const whyOf = ({ reason, status }) => reasonText(reason) || status;

/** The failures of a run: those of answers, and games that did not end as planned. */
function Failures({ run: { games, status, acts } }) {
  const failed = games.filter((game) => isFailed(game) || (!game.episode && status !== "running"));
  const why = failuresText(acts.failures);
  if (failed.length === 0 && acts.invalid === 0 && acts.timeouts === 0) return null;
  const reason = (game) =>
    game.episode
      ? html`${whyOf(game)}, after ${roundsText(game.round)} with score ${short(game.score)}${game.void_reason !== null && ". "}<${Voided} game=${game} games=${games} />`
      : "never played, counts as 0";
  return html`
    <h2>What failed</h2>
    <${Shown} items=${failed} wrap=${(some) => html`<ul>
      ${acts.invalid > 0 &&
      html`<li>
        ${short(acts.invalid)} of ${short(acts.sent)} answers could not be read (${percent(acts.invalid_share)}): their agents did nothing.${" "}
        ${why && `${why}. `}A game's page shows each.
      </li>`}
      ${acts.timeouts > 0 && html`<li>${short(acts.timeouts)} times a clock expired (${percent(acts.timeout_share)} of all moves).</li>`}
      ${some.map((game) => html`<li><${GameLink} game=${game} />: ${reason(game)}</li>`)}
    </ul>`} />
  `;
}

/** @param {{games: any[]}} props */
function Games({ games }) {
  const [isOpen, setIsOpen] = useState(false);
  const { results, text, toggle, isRunning } = useVerified(games);
  const score = alike(games.map((game) => game.score));
  const why = (game) => html`${game.reason && whyOf(game)}${game.void_reason !== null && html`<div class="small"><${Voided} game=${game} games=${games} /></div>`}`;
  const journal = ({ episode: id }) => id && html`<${Download} href=${route`/api/v1/episodes/${id}/journal`} name=${`${id}.jsonl`}>journal<//>`;
  const columns = [
    ["Game", (game) => html`<${GameLink} game=${game} />`],
    ["Status", (game) => html`<${Status} status=${game.status} />`],
    ["Why it ended", why],
    ["#Rounds", (game) => game.round],
    ["#Score", (game) => score(game.score)],
    ["Journal", journal],
    ["Verified", ({ episode }) => results.has(episode) && html`<${Result} ...${results.get(episode)} />`],
  ];
  return html`<details onToggle=${(event) => setIsOpen(event.currentTarget.open)}>
    <summary>${games.length} games with journals and verification</summary>
    ${isOpen &&
    html`
      <p class="buttons">
        <button type="button" onClick=${toggle}>${isRunning ? "Stop" : "Verify all games"}</button>
        <span role="status">${text}</span>
      </p>
      <${Shown} items=${games} wrap=${(some) => html`<${Items} label="Games of the run" items=${some} keyOf=${({ episode, slot }) => episode ?? slot} columns=${columns} />`} />
    `}
  </details>`;
}

const Result = ({ ok, text }) => html`<span class=${ok ? "good" : "bad"}><${Text} value=${text} /></span>`;

/** Has the server play the journals again, one after another. @param {any[]} games */
function useVerified(games) {
  const [results, setResults] = useState(/** @type {Map<string, {ok: boolean, text: string}>} */ (new Map()));
  const [running, setRunning] = useState(/** @type {AbortController | null} */ (null));
  useEffect(() => () => running?.abort(), [running]);
  const ended = games.filter((game) => game.episode && game.status !== "running" && game.status !== "waiting");
  async function start() {
    const started = new AbortController();
    setRunning(started);
    for (const { episode } of ended) {
      const result = await verify(episode, started.signal);
      if (started.signal.aborted) return;
      setResults((results) => new Map(results).set(episode, result));
    }
    setRunning(null);
  }
  const bad = [...results.values()].filter((result) => !result.ok).length;
  const text =
    results.size > 0
      ? `${results.size - bad} of ${ended.length} verified${bad > 0 ? `, ${bad} not` : ""}`
      : "The server plays each journal again and checks every hash, act and score.";
  return { results, text, isRunning: running !== null, toggle: () => (running ? setRunning(null) : void start()) };
}

/** @param {string} episode @param {AbortSignal} signal */
async function verify(episode, signal) {
  try {
    const { ok, journal_head, problem } = await request(route`/api/v1/episodes/${episode}/verification`, { signal });
    return { ok, text: ok ? `✓ ${journal_head.slice(0, 12)}` : `✗ ${problem}` };
  } catch (error) {
    return { ok: false, text: error instanceof Problem ? error.message : "stopped" };
  }
}

/** Actions of a run's creator. @param {{run: any, changed: () => void}} props */
function Actions({ run, changed }) {
  const [made, setMade] = useState({ swarm_token: "", holder: "" });
  const isRunning = run.status === "running";
  const tokens = renewals(run, setMade);
  if (!isRunning && tokens.length === 0) return null;
  return html`
    <h2>For its creator</h2>
    <p class="muted">
      On a server with keys, enter the key with which the run was created. Only then do these work.
      ${run.attempt !== null && " Only organizers can abort an attempt of a competition."}
    </p>
    <div class="buttons">
      ${tokens.map((act) => html`<${ActButton} key=${act.label} ...${act} />`)}
      ${isRunning && html`<${ActButton} ...${ending(run)} label="Abort the run" done=${changed} />`}
    </div>
    ${made.swarm_token &&
    html`<${Secret} value=${made.swarm_token} label=${`New token of ${visible(made.holder || "the run")}`}>
      ${!made.holder && html`<p>The earlier one is revoked. Built-in players resume the run with it, in the environment variable <code>SWARMBENCH_RUN_TOKEN</code>:</p>
        <${Commands} label="Resume the run" what="the command" lines=${[`swarmbench play --run ${run.id} --server ${location.origin}`]} />`}
    <//>`}
  `;
}
