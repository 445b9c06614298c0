// The health of the server, and its current load.
import { html, useRef } from "../ui.js";
import { Problem, request, send } from "../api.js";
import { ActButton } from "../parts/act.js";
import { Sparkline, short } from "../parts/chart.js";
import { duration } from "../parts/duration.js";
import { useLoaded } from "../parts/load.js";
import { Waiting } from "../parts/problem.js";
import { Facts } from "../parts/table.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

const EVERY_MS = 3000;

/** The number of stored samples: those of a minute. */
const SAMPLES_MAX = 21;

/** Metrics that must be 0, and what to do otherwise. */
const FAULTS = [
  ["swarmbench_commit_failures_total", "A commit failed: nothing is acknowledged. Repair the disk, then restart the server."],
  ["swarmbench_database_lost", "A file of the database was removed or replaced. Put it back, then restart the server."],
  ["swarmbench_jobs_refused_total", "The database rejected entries. The log says why; their senders may send them again."],
  ["swarmbench_closing_failures_total", "A competition could not be closed at once. It is tried again; the log says why."],
  ["swarmbench_errors_total", "Requests were answered with a fault of the server. The log says why."],
];

/** @param {{mayChange: boolean}} props */
export function Health({ mayChange }) {
  const kept = useRef(/** @type {any[]} */ ([]));
  const loaded = useLoaded(load, [], EVERY_MS);
  const { value, problem, reload } = loaded;
  if (value && kept.current.at(-1) !== value) kept.current = [...kept.current, value].slice(-SAMPLES_MAX);
  if (!value) return html`<${Waiting} of=${loaded} />`;
  const { samples, ready, at } = value;
  const isInDoubt = total(samples, "swarmbench_clock_in_doubt") > 0;
  const faults = FAULTS.filter(([name]) => total(samples, name) > 0);
  return html`
    <h2>Health</h2>
    <p role="status" class=${ready === "" && !problem ? "good" : "bad"}>
      <strong>${problem ? "Unknown" : ready === "" ? "Ready" : "Not ready"}</strong> <${Text} value=${problem ? `${problem.message} What is shown may be out of date.` : ready} />
    </p>
    ${faults.length > 0 &&
    (mayChange
      ? html`<ul>${faults.map(([name, advice]) => html`<li class="bad">${advice} <span class="muted">Since the start: ${total(samples, name)}.</span></li>`)}</ul>`
      : html`<p class="bad">The server has faults. Tell its organizer.</p>`)}
    <${Load} samples=${samples} kept=${kept.current} />
    <h3>Clock</h3>
    <p class=${isInDoubt ? "bad" : ""}>
      ${isInDoubt
        ? `The time of day is in doubt: the clock of the server's host jumped. Nothing is revealed, closed or abandoned, and no attempt starts, until it is right${mayChange ? " or you confirm it" : ""}.`
        : "The time of day is not in doubt."} The server's time is <${Time} value=${at} both />.
    </p>
    ${mayChange &&
    html`<p>
      <${ActButton} label="Confirm the host's clock" title="Is the clock of the server's host right?" isDangerous=${isInDoubt} done=${reload}
        act=${() => request("/api/v1/clock/confirm", { method: "POST" })}>
        <p>
          Look at <code>date -u</code> on the server's machine first. From then on the server goes by that clock: competitions whose
          time has come close at once, and what is revealed stays revealed.
        </p>
      <//>
    </p>`}
  `;
}

/** @param {AbortSignal} signal */
async function load(signal) {
  const response = await send("/metrics", { signal });
  const at = new Date(response.headers.get("date") ?? Date.now()).toISOString();
  const samples = samplesOf(await response.text());
  return { samples, at, now: performance.now(), ready: await readiness(signal) };
}

/** The reason why the server is not ready, or an empty text. @param {AbortSignal} signal @returns {Promise<string>} */
const readiness = (signal) =>
  request("/readyz", { signal }).then(() => "", (error) => (error instanceof Problem && error.status === 503 ? error.message : Promise.reject(error)));

/** The samples of metrics by their names, from the text format of Prometheus. @param {string} text @returns {Map<string, number[]>} */
function samplesOf(text) {
  const found = text.split("\n").flatMap((line) => [...line.matchAll(/^([a-zA-Z_:][\w:]*)(?:\{.*\})? (\S+)$/g)]);
  const byName = Map.groupBy(found, ([, name]) => name);
  return new Map([...byName].map(([name, samples]) => [name, samples.map(([, , value]) => Number(value))]));
}

/** The sum of all samples of a name; 0 if there is none. @param {ReturnType<typeof samplesOf>} samples @param {string} name */
const total = (samples, name) => (samples.get(name) ?? []).reduce((sum, value) => sum + value, 0);

/** @param {{samples: ReturnType<typeof samplesOf>, kept: any[]}} props */
function Load({ samples, kept }) {
  const of = (/** @type {string} */ name) => total(samples, `swarmbench_${name}`);
  const acts = ratesOf(kept, "swarmbench_acts_total");
  const now = (/** @type {string} */ name) => ratesOf(kept, name).at(-1) ?? null;
  const cpu = now("process_cpu_seconds_total");
  const commits = now("swarmbench_commit_seconds_count");
  const commit = commits ? `; a commit takes ${short(((now("swarmbench_commit_seconds_sum") ?? 0) / commits) * 1000)} ms` : "";
  const facts = [
    ["Rounds", `${short(now("swarmbench_rounds_total"))} a second`],
    ["Requests", `${short(now("swarmbench_http_requests_total"))} a second, ${short(of("waits"))} wait for a round`],
    ["Games", `${short(of("episodes_unfinished"))} have not ended, ${short(of("episodes_in_memory"))} are in memory`],
    ["Connections", short(of("connections"))],
    ["Queue of the disk", `${short(of("backlog_jobs"))} jobs, ${bytes(of("backlog_bytes"))}${commit}`],
    ["Heavy work", `${short(of("heavy_running"))} jobs run, ${short(of("heavy_waiting"))} wait`],
    ["Memory", `${bytes(total(samples, "process_resident_memory_bytes"))}; ${bytes(of("memory_reserved_bytes"))} for worlds and answers`],
    ["Processor", `${cpu === null ? "–" : short(cpu * 100)} % of one core`],
    ["Disk", `${short(of("disk_free_percent"))} % free`],
    ["Refused", `${short(of("rate_limited_total"))} requests over a rate, ${short(of("connections_refused_total"))} connections over a limit, since the start`],
    ["Running for", duration(Date.now() - total(samples, "process_start_time_seconds") * 1000)],
  ];
  return html`<p class="load">
      <${Sparkline} values=${acts} range=${[0, Math.max(1, ...acts)]} width=${240} height=${48} label="Acts a second in the last minute" />
      <span><span class="large number">${short(acts.at(-1) ?? null)}</span> acts a second</span>
    </p>
    <${Facts} facts=${facts} look="number" />`;
}

/** The growth of a counter per second, between samples. A restart of the server sets it to 0. @param {any[]} kept @param {string} name */
const ratesOf = (kept, name) =>
  kept.slice(1).map((sample, index) => {
    const grown = total(sample.samples, name) - total(kept[index].samples, name);
    return Math.max(0, grown) / ((sample.now - kept[index].now) / 1000);
  });

/** @param {number} count */
const bytes = (count) => (count >= 1e9 ? `${(count / 1e9).toFixed(2)} GB` : `${(count / 1e6).toFixed(1)} MB`);
