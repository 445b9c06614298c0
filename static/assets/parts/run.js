// What a run shows: its games by task and seed, score curves, metrics, and its facts as they were declared and counted.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { Score, SuiteLink, inRanges, interval, scale } from "./boards.js";
import { Sparkline, alike, dollars, extent, short } from "./chart.js";
import { Download } from "./download.js";
import { duration } from "./duration.js";
import { Items } from "./listed.js";
import { useLoaded } from "./load.js";
import { METRICS, metricName } from "./metrics.js";
import { eachPage } from "./pages.js";
import { Waiting } from "./problem.js";
import { settingsText } from "./rules.js";
import { percent } from "./status.js";
import { Facts } from "./table.js";
import { LongText, Name, PromptName, Text } from "./text.js";
import { Time } from "./time.js";
import { roundsText, samplingText } from "./words.js";

/** The number of points of a curve. */
const POINTS = 50;

/** @typedef {Map<string, {rounds: number, every: number, scores: number[]}>} Scores score curves by episode */

/** @param {string} id @param {number} [everyMs] how often it is loaded again */
export const useRun = (id, everyMs) => useLoaded((signal) => request(route`/api/v1/runs/${id}`, { signal }), [id], everyMs);

/**
 * The score curves of a run's games; empty where the server has none to show.
 * @param {string} id
 * @param {unknown} [version] they are read again when it changes
 * @param {number} [everyMs]
 * @returns {Scores}
 */
export function useScores(id, version, everyMs) {
  const load = async (/** @type {AbortSignal} */ signal) => {
    const scores = new Map();
    await eachPage(route`/api/v1/runs/${id}/scores`, { points: POINTS }, signal, ({ items }) => {
      for (const item of items) scores.set(item.episode, item);
    });
    return scores;
  };
  return useLoaded(load, [id, version], everyMs).value ?? new Map();
}

/** @param {{run: any, scores: Scores}} props */
export function GameGrid({ run, scores }) {
  const rows = [...Map.groupBy(run.games, ({ task }) => task)].map(([task, games]) => {
    const slots = [...new Set(games.map(({ slot }) => slot))];
    // While seeds are secret, games are numbered within the task.
    const bySeed = Map.groupBy(games, ({ seed, slot }) => (seed === null ? `game ${slots.indexOf(slot) + 1}` : `seed ${seed}`));
    return { task, bySeed, range: extent(games.flatMap(({ episode }) => scores.get(episode)?.scores ?? [])) };
  });
  const seeds = [...new Set(rows.flatMap(({ bySeed }) => [...bySeed.keys()]))];
  const score = alike(run.games.map((game) => game.score));
  const game = (seed, { bySeed, range }) => bySeed.has(seed) && html`<${Game} games=${bySeed.get(seed)} ...${{ seed, scores, range, score }} />`;
  const columns = [
    ["Task", ({ task }) => task],
    ["#Mean ± deviation", ({ task }) => html`<${Mean} run=${run} task=${task} />`],
    ...seeds.map((seed) => [html`<th scope="col" class="number">${seed}</th>`, (row) => game(seed, row)]),
  ];
  return html`<${Items} label="Score of each game by task and seed" name="games" items=${rows} keyOf=${({ task }) => task} columns=${columns} />`;
}

/** @param {{run: any, task: string}} props */
function Mean({ run, task }) {
  const result = run.tasks.find((one) => one.task === task);
  if (!result) return null;
  const { deviation, played, planned } = result;
  // Once a run is over, games that were never played count as 0.
  const of = interval([{ ...result, games: run.status === "running" ? played : planned }]);
  return html`${of && html`<${Score} of=${of} deviation=${deviation} range=${scale([of])} name=${task} />`}
    ${played < planned && html`<div class="muted small">${played} of ${planned} played</div>`}`;
}

/**
 * A game; the newest one where it was voided and played again.
 * @param {{games: any[], seed: string, scores: Scores, range: [number, number], score: (value: number | null) => string}} props
 */
function Game({ games, seed, scores, range, score }) {
  const game = games.at(-1);
  if (!game.episode) return html`<span class="game muted small">planned</span>`;
  const series = scores.get(game.episode)?.scores ?? [];
  const failure = game.void_reason !== null ? "voided" : isFailed(game) ? game.status : games.length > 1 ? "played again" : "";
  const label = `${game.task}, ${seed}: score ${score(game.score)}, ${game.status} after ${roundsText(game.round)}${failure && `, ${failure}`}`;
  return html`<a class="game" href=${route`/episodes/${game.episode}`} aria-label=${label} title=${label}>
    <span class="number">${score(game.score)}</span>
    ${series.length > 1 && html`<span aria-hidden="true"><${Sparkline} values=${series} range=${range} label="" width=${64} height=${20} /></span>`}
    <span class=${`small ${game.status === "running" ? "good" : failure ? "bad" : "muted"}`}>
      ${failure || (game.status === "finished" ? "" : `${game.status} ${game.round}`)}
    </span>
  </a>`;
}

/** Whether a game that was opened did not end as planned. @param {any} game */
export const isFailed = ({ void_reason, status }) => void_reason !== null || ["aborted", "abandoned"].includes(status);

/** The metrics of a run's games, by task: on request, as the server may have to measure them. @param {{id: string, version?: unknown}} props */
export function Metrics({ id, version }) {
  const [isWanted, setIsWanted] = useState(false);
  if (isWanted) return html`<${Means} id=${id} version=${version} />`;
  return html`<p>
    <button type="button" onClick=${() => setIsWanted(true)}>Show metrics</button> ${" "}
    <span class="muted">what the swarm said and did, as means over games</span>
  </p>`;
}

/** @param {{id: string, version?: unknown}} props */
function Means({ id, version }) {
  const loaded = useLoaded((signal) => means(id, signal), [id, version]);
  if (!loaded.value) return html`<${Waiting} of=${loaded} what="Metrics" />`;
  const { method, tasks } = loaded.value;
  if (tasks.size === 0) return html`<p class="empty">No game has ended yet.</p>`;
  const rows = Object.keys(METRICS).map((name) => {
    const values = [...tasks.values()].map((of) => of.get(name)).map((of) => of && of.sum / of.games);
    return { name, values: values.map(alike(values)), isKnown: values.some((value) => value !== undefined) };
  });
  const metric = ({ name }) => html`<span title=${METRICS[name]}>${metricName(name)}</span>`;
  const columns = [["Metric", metric], ...[...tasks.keys()].map((task, index) => [`#${task}`, ({ values }) => values[index]])];
  return html`
    <p class="muted small">Means over games; definition ${method}.</p>
    <${Items} label="Metrics by task" items=${rows.filter((row) => row.isKnown)} keyOf=${({ name }) => name} columns=${columns} />
  `;
}

/** Sums over all pages of games, by task and metric. @param {string} id @param {AbortSignal} signal */
async function means(id, signal) {
  /** @type {Map<string, Map<string, {sum: number, games: number}>>} */
  const tasks = new Map();
  let method = "";
  await eachPage(route`/api/v1/runs/${id}/metrics`, {}, signal, (page) => {
    method = `${page.definition}, revision ${page.metrics_revision}, texts compared by ${page.embedder}`;
    for (const [task, metrics] of Object.entries(page.tasks)) {
      const of = tasks.get(task) ?? new Map();
      tasks.set(task, of);
      for (const [name, { mean, games }] of Object.entries(metrics)) {
        const { sum, games: before } = of.get(name) ?? { sum: 0, games: 0 };
        of.set(name, { sum: sum + mean * games, games: before + games });
      }
    }
  });
  return { method, tasks };
}

export function About({ run }) {
  const { suite, acts, agent_meta: declared, holders = [] } = run;
  const isTeam = holders.length > 0;
  const reads = !isTeam && run.prompt !== "none";
  const took = run.ended_at && `, took ${duration(new Date(run.ended_at).getTime() - new Date(run.created_at).getTime())}`;
  const facts = [
    ["Suite", html`<${SuiteLink} run=${run} />, rules ${suite.rules} <span class="mono small">${suite.digest}</span>`],
    ["Setting", `${settingsText(suite.settings)}${suite.settings.round_deadline_s ? `; ${suite.settings.round_deadline_s} s a round` : ""}`],
    ["Started", html`<${Time} value=${run.created_at} />${took}`],
    reads && ["Sampling", html`<${Text} value=${samplingText(run) || "not declared"} />`],
    reads && ["Prompt", html`<${PromptName} value=${run.prompt} />${run.template_digest && html`, template <code>${run.template_digest}</code>`}`],
    ["Who plays", isTeam ? "a team, each with a token of its own" : run.player ? html`the server, built-in player <${Text} value=${run.player} />` : "a client, with the token of the run"],
    ["Acts", acts.sent > 0 ? actsText(acts) : "none counted yet; they are counted when a game ends"],
    ["Tokens", acts.prompt_tokens + acts.completion_tokens > 0 ? tokensText(acts) : "none reported"],
    ["Cost", acts.usage?.priced && `${acts.usage.priced < acts.sent ? "at least " : ""}$${dollars(acts.usage.cost_nano_usd / 1e9)}`],
    ["Visible to", run.visibility],
    ["Id", html`<code>${run.id}</code> (<${Download} href=${route`/api/v1/runs/${run.id}`} name=${`${run.id}.json`}>JSON<//>)`],
  ];
  return html`
    ${isTeam && html`<h2>Who has which seats</h2><${Holders} holders=${holders} />`}
    <h2>About this run</h2>
    <${Facts} facts=${facts} />
    ${Object.keys(declared).length > 0 &&
    html`<details>
      <summary>Declared facts about the player</summary>
      <${LongText} value=${JSON.stringify(declared, null, 2)} label="Declared facts" />
    </details>`}
  `;
}

/** Who has which seats of a team, as declared. @param {{holders: any[]}} props */
function Holders({ holders }) {
  const columns = [
    ["Holder", ({ name }) => html`<${Name} value=${name} />`],
    ["Seats", ({ seats }) => inRanges(seats)],
    ["Model", ({ model, player }) => (player ? "built-in, played by the server" : html`<${Name} value=${model} />`)],
    ["Sampling", (holder) => html`<${Text} value=${samplingText(holder) || "–"} />`],
    ["Prompt", ({ prompt }) => html`<${PromptName} value=${prompt ?? "–"} />`],
  ];
  return html`<${Items} label="Holders of the team" items=${holders} keyOf=${({ name }) => name} columns=${columns} />`;
}

const actsText = ({ sent, invalid_share, timeout_share }) =>
  `${short(sent)}, ${percent(invalid_share)} invalid, ${percent(timeout_share)} of moves timed out`;

/** @param {any} acts */
function tokensText({ prompt_tokens, completion_tokens, usage = {} }) {
  const { cached_tokens, cache_write_tokens, reasoning_tokens } = usage;
  const part = (/** @type {number | undefined} */ tokens, /** @type {string} */ words) => (tokens ? `, ${short(tokens)} of them ${words}` : "");
  return `${short(prompt_tokens)} of prompts${part(cached_tokens, "from a cache")}${part(cache_write_tokens, "written into one")}; ${
    short(completion_tokens)} of answers${part(reasoning_tokens, "reasoning")}`;
}
