// A run: its games by task and seed, their progress, and failures.
import { html, useEffect, useState } from "../ui.js";
import { route } from "../api.js";
import { Download } from "../parts/download.js";
import { ProblemNote } from "../parts/problem.js";
import { Text, LongText, visible } from "../parts/text.js";
import { Time, duration } from "../parts/time.js";
import { short } from "../parts/chart.js";
import { SuiteLink } from "../parts/boards.js";
import { GameGrid } from "../parts/grid.js";
import { useRun, useScores } from "../parts/runs.js";
import { useTitle } from "../parts/query.js";
import { Status, percent, runStatusText } from "../parts/status.js";
import { Metrics } from "../parts/runmetrics.js";
import { Failures, Games } from "../run/games.js";
import { Actions } from "../run/actions.js";

/** @param {{id: string}} props */
export function Page({ id }) {
  const loaded = useRun(id);
  const run = loaded.value;
  const scores = useScores(run?.id, run && `${run.played} ${useTick(run.status === "running")}`);
  useTitle(run && `${visible(run.model)} on ${run.attempt === null ? visible(run.suite.name) : "a competition"}: run`);
  if (!run) {
    if (loaded.problem) return html`<h1>Run</h1><${ProblemNote} problem=${loaded.problem} retry=${loaded.reload} what="This run" />`;
    return html`<h1>Run</h1><p class="muted" role="status">Loading …</p>`;
  }
  return html`
    <h1><${Text} value=${run.model} /> on ${run.attempt === null ? html`<${Text} value=${run.suite.name} />` : "a competition"}</h1>
    <${Progress} run=${run} />
    ${(loaded.isLost || loaded.problem) && html`<p class="bad" role="status">The connection is lost. This page tries again by itself.</p>`}
    ${run.waits_for && html`<p role="status">It waits for a limit of the server before it opens more games: <code><${Text} value=${run.waits_for.name ?? run.waits_for} /></code>.</p>`}
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

/** The interval between reads of a running run's curves. */
const CURVES_MS = 10_000;

/** A number that grows while a run is running and can be seen. @param {boolean} isOn */
function useTick(isOn) {
  const [tick, setTick] = useState(0);
  useEffect(() => {
    if (!isOn) return;
    const timer = setInterval(() => document.hidden || setTick((tick) => tick + 1), CURVES_MS);
    return () => clearInterval(timer);
  }, [isOn]);
  return tick;
}

/** @param {{run: any}} props */
const Progress = ({ run }) => html`
  <p>
    <${Status} status=${run.status} of="run" /> ${" "}
    <span role="status">${run.played} of ${run.planned} games played${run.voided > 0 && `, ${run.voided} voided`}</span>
    ${run.status === "running" && html` <progress value=${run.played} max=${Math.max(run.planned, 1)} aria-label="Games played" />`}
    ${run.total !== null && html` · total${run.status === "running" && " so far"} <strong class="number">${short(run.total)}</strong>`}
    <span class="muted"> · ${runStatusText(run.status)}.</span>
  </p>
  ${run.void_reason !== null && html`<p class="bad">This attempt was voided: <${Text} value=${run.void_reason} />. It is on no board.</p>`}
`;

/** @param {{run: any}} props */
function About({ run }) {
  const { suite, acts } = run;
  const end = run.ended_at ? new Date(run.ended_at).getTime() : null;
  const facts = [
    ["Suite", html`<${SuiteLink} run=${run} />, rules ${suite.rules} <span class="mono small">${suite.digest}</span>`],
    ["Setting", settingText(suite.settings)],
    ["Started", html`<${Time} value=${run.created_at} />${end && html`, took ${duration(end - new Date(run.created_at).getTime())}`}`],
    ["Sampling", `temperature ${run.temperature ?? "not declared"}, top p ${run.top_p ?? "not declared"}`],
    ["Prompt", run.template_digest ? html`own template <code>${run.template_digest}</code>` : "built-in template"],
    ["Who plays", run.player ? html`the server, built-in player <${Text} value=${run.player} />` : "a client, with the token of the run"],
    ["Acts", acts.sent > 0 ? `${short(acts.sent)}, ${percent(acts.invalid_share)} invalid, ${percent(acts.timeout_share)} of moves timed out` : "none counted yet; they are counted when a game ends"],
    ["Tokens", acts.prompt_tokens + acts.completion_tokens > 0 ? `${short(acts.prompt_tokens)} of prompts, ${short(acts.completion_tokens)} of answers` : "none reported"],
    ["Visible to", run.visibility],
    ["Id", html`<code>${run.id}</code> (<${Download} href=${route`/api/v1/runs/${run.id}`} name=${`${run.id}.json`}>JSON</${Download}>)`],
  ];
  const meta = Object.keys(run.agent_meta).length > 0;
  return html`
    <h2>About this run</h2>
    <dl class="facts">${facts.map(([name, value]) => html`<dt>${name}</dt><dd>${value}</dd>`)}</dl>
    ${meta && html`<details><summary>Declared facts about the player</summary><${LongText} value=${JSON.stringify(run.agent_meta, null, 2)} label="Declared facts" /></details>`}
  `;
}

/** @param {any} settings */
const settingText = (settings) =>
  [
    `${settings.num_agents} agents`,
    `${settings.width} × ${settings.height} cells`,
    `view ${settings.view_size}`,
    `memory ${settings.memory}`,
    `${settings.max_round} rounds`,
    settings.control,
    settings.noise > 0 && `noise ${settings.noise}`,
    settings.max_delay > 0 && `delay up to ${settings.max_delay} rounds`,
    settings.round_deadline_s && `${settings.round_deadline_s} s a round`,
  ]
    .filter(Boolean)
    .join(", ");
