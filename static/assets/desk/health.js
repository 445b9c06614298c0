// The health of the server, and its current load.
import { html, useRef } from "../ui.js";
import { Problem, request, send } from "../api.js";
import { ActButton } from "../parts/act.js";
import { Sparkline, short } from "../parts/chart.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Time, duration } from "../parts/time.js";
import { samplesOf, total } from "./prometheus.js";

const EVERY_MS = 3000;

/** The number of stored samples: those of a minute. */
const SAMPLES_MAX = 21;

/** Counters whose growth is shown. */
const RATES = {
  acts: "swarmbench_acts_total",
  rounds: "swarmbench_rounds_total",
  requests: "swarmbench_http_requests_total",
  cpu: "process_cpu_seconds_total",
  commits: "swarmbench_commit_seconds_count",
  commitSeconds: "swarmbench_commit_seconds_sum",
};

/** Metrics that must be 0, and what to do otherwise. */
const FAULTS = [
  ["swarmbench_commit_failures_total", "A commit failed: nothing is acknowledged. Repair the disk, then restart the server."],
  ["swarmbench_database_lost", "A file of the database was removed or replaced. Put it back, then restart the server."],
  ["swarmbench_jobs_refused_total", "The database rejected entries. The log says why; their senders may send them again."],
  ["swarmbench_closing_failures_total", "A competition could not be closed at once. It is tried again; the log says why."],
  ["swarmbench_errors_total", "Requests were answered with a fault of the server. The log says why."],
];

/** @param {{isOrganizer: boolean}} props */
export function View({ isOrganizer }) {
  const kept = useRef(/** @type {any[]} */ ([]));
  const { value, problem, reload } = useLoaded(load, [], EVERY_MS);
  if (value && kept.current.at(-1) !== value) kept.current = [...kept.current, value].slice(-SAMPLES_MAX);
  if (!value) return problem ? html`<${ProblemNote} problem=${problem} retry=${reload} />` : html`<p class="muted" role="status">Loading …</p>`;
  const { samples, ready } = value;
  const isInDoubt = total(samples, "swarmbench_clock_in_doubt") > 0;
  const faults = FAULTS.filter(([name]) => total(samples, name) > 0);
  return html`
    <h2>Health</h2>
    <p role="status" class=${ready === "" && !problem ? "good" : "bad"}>
      <strong>${problem ? "Unknown" : ready === "" ? "Ready" : "Not ready"}</strong> <${Text} value=${problem ? `${problem.message} What is shown may be out of date.` : ready} />
    </p>
    ${faults.length > 0 &&
    html`<ul>${faults.map(([name, advice]) => html`<li class="bad">${advice} <span class="muted">(<code>${name}</code> ${total(samples, name)})</span></li>`)}</ul>`}
    <${Load} samples=${samples} kept=${kept.current} />
    <h3>Clock</h3>
    <p class=${isInDoubt ? "bad" : ""}>
      ${isInDoubt
        ? "The time of day is in doubt: the clock of the server's host jumped. Nothing is revealed, closed or abandoned, and no attempt starts, until it is right or you confirm it."
        : "The time of day is not in doubt."} The server's time is <${Time} value=${value.at} both />.
    </p>
    ${isOrganizer && html`<${ConfirmClock} isInDoubt=${isInDoubt} done=${reload} />`}
  `;
}

/** @param {AbortSignal} signal */
async function load(signal) {
  const response = await send("/metrics", { signal });
  const date = response.headers.get("date");
  const at = new Date(date ?? Date.now()).toISOString();
  const samples = samplesOf(await response.text());
  return { samples, at, now: performance.now(), ready: await readiness(signal) };
}

/** The reason why the server is not ready, or an empty text. @param {AbortSignal} signal */
async function readiness(signal) {
  try {
    await request("/readyz", { signal });
    return "";
  } catch (error) {
    if (error instanceof Problem && error.status === 503) return error.message;
    throw error;
  }
}

/** @param {{samples: ReturnType<typeof samplesOf>, kept: any[]}} props */
function Load({ samples, kept }) {
  const of = (/** @type {string} */ name) => total(samples, name);
  const acts = ratesOf(kept, RATES.acts);
  const now = (/** @type {string} */ name) => ratesOf(kept, name).at(-1) ?? null;
  const cpu = now(RATES.cpu);
  const commits = now(RATES.commits);
  const commitMs = commits ? ((now(RATES.commitSeconds) ?? 0) / commits) * 1000 : null;
  const facts = [
    ["Rounds", `${short(now(RATES.rounds))} a second`],
    ["Requests", `${short(now(RATES.requests))} a second, ${short(of("swarmbench_waits"))} wait for a round`],
    ["Games", `${short(of("swarmbench_episodes_unfinished"))} have not ended, ${short(of("swarmbench_episodes_in_memory"))} are in memory`],
    ["Connections", short(of("swarmbench_connections"))],
    ["Queue of the disk", `${short(of("swarmbench_backlog_jobs"))} jobs, ${bytes(of("swarmbench_backlog_bytes"))}${commitMs === null ? "" : `; a commit takes ${short(commitMs)} ms`}`],
    ["Heavy work", `${short(of("swarmbench_heavy_running"))} jobs run, ${short(of("swarmbench_heavy_waiting"))} wait`],
    ["Memory", `${bytes(of("process_resident_memory_bytes"))}; ${bytes(of("swarmbench_memory_reserved_bytes"))} for worlds and answers`],
    ["Processor", `${cpu === null ? "–" : short(cpu * 100)} % of one core`],
    ["Disk", `${short(of("swarmbench_disk_free_percent"))} % free`],
    ["Refused", `${short(of("swarmbench_rate_limited_total"))} requests over a rate, ${short(of("swarmbench_connections_refused_total"))} connections over a limit, since the start`],
    ["Running for", duration(Date.now() - of("process_start_time_seconds") * 1000)],
  ];
  return html`<p class="load">
      <${Sparkline} values=${acts} range=${[0, Math.max(1, ...acts)]} width=${240} height=${48} label="Acts a second in the last minute" />
      <span><span class="large number">${short(acts.at(-1) ?? null)}</span> acts a second</span>
    </p>
    <dl class="facts">${facts.map(([name, text]) => html`<dt>${name}</dt><dd class="number">${text}</dd>`)}</dl>`;
}

/**
 * The growth of a counter per second, between samples. A restart of the server sets it to 0.
 * @param {any[]} kept @param {string} name
 */
const ratesOf = (kept, name) =>
  kept.slice(1).map((sample, index) => {
    const grown = total(sample.samples, name) - total(kept[index].samples, name);
    return Math.max(0, grown) / ((sample.now - kept[index].now) / 1000);
  });

/** @param {number} count */
const bytes = (count) => (count >= 1e9 ? `${(count / 1e9).toFixed(2)} GB` : `${(count / 1e6).toFixed(1)} MB`);

/** @param {{isInDoubt: boolean, done: () => void}} props */
const ConfirmClock = ({ isInDoubt, done }) => html`<p>
  <${ActButton}
    label="Confirm the host's clock"
    title="Is the clock of the server's host right?"
    isDangerous=${isInDoubt}
    act=${() => request("/api/v1/clock/confirm", { method: "POST" })}
    done=${done}
  >
    <p>
      Look at <code>date -u</code> on the server's machine first. From then on the server goes by that clock: competitions whose
      time has come close at once, and what is revealed stays revealed.
    </p>
  <//>
</p>`;
