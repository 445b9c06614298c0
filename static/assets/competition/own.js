// The entrant of the key of this tab: its place, its next step, its attempts, practice, and changes to itself.
import { html, useRef, useState } from "../ui.js";
import { onceKey, request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { short } from "../parts/chart.js";
import { Commands, Secret } from "../parts/copy.js";
import { Choice } from "../parts/filters.js";
import { Form } from "../parts/form.js";
import { Items, unseen } from "../parts/listed.js";
import { More, usePages } from "../parts/pages.js";
import { Waiting } from "../parts/problem.js";
import { AttemptGames, AttemptStatus, OnSpareSeeds } from "../parts/status.js";
import { Text } from "../parts/text.js";
import { Countdown, Time } from "../parts/time.js";
import { Accepted, OwnEntrant } from "./entrant.js";
import { useOwnRows } from "./standings.js";

const REFRESH_MS = 5000;

/** @param {{competition: any, own: any[], changed: () => void, erased: (name: string) => void}} props */
export function Own({ competition, own, changed, erased }) {
  const list = usePages(route`/api/v1/competitions/${competition.id}/attempts`, REFRESH_MS);
  const board = useOwnRows(competition, own);
  const [chosen, setChosen] = useState("");
  const [token, setToken] = useState(/** @type {{run: string, swarm_token: string} | null} a token is shown once */ (null));
  const one = own.find(({ id }) => id === chosen) ?? own[0];
  const attempts = list.items.filter(({ entrant }) => entrant === one.id);
  const started = (/** @type {any} */ answer) => (setToken(answer), list.reload());
  const renew = async (/** @type {string} */ run) => setToken({ ...(await request(route`/api/v1/runs/${run}/token`, { method: "POST" })), run });
  return html`
    ${own.length > 1 &&
    html`<p><${Choice} label="Entrant" value=${one.id} options=${own.map(({ id, name }) => [id, name])} all=${null} onChange=${setChosen} /></p>`}
    <${Place} one=${one} board=${board} row=${board?.rows.find((row) => row.entrant.id === one.id)} />
    ${competition.terms && !one.erased && html`<${Accepted} competition=${competition} one=${one} changed=${changed} />`}
    ${list.value ? html`<${Next} competition=${competition} one=${one} attempts=${attempts} started=${started} />` : html`<${Waiting} of=${list} />`}
    ${token && html`<${HowToPlay} run=${token.run} token=${token.swarm_token} />`}
    ${attempts.length > 0 && html`<${Attempts} key=${one.id} attempts=${attempts} renew=${renew} />`}
    <${More} list=${list} />
    <${Practice} competition=${competition} entrant=${one} />
    <${OwnEntrant} key=${one.id} competition=${competition} one=${one} changed=${changed} erased=${erased} />
  `;
}

/** The rank of an entrant, or why it has none. @param {{one: any, board: ReturnType<typeof useOwnRows>, row?: any}} props */
function Place({ one, board, row }) {
  const rank = () => {
    if (!row?.run && row?.rank == null) return "No rank: none of your attempts is on the board.";
    const total = html`total <span class="number">${row.total === null ? "not shown yet" : short(row.total)}</span>`;
    if (row.rank === null) return html`No rank, ${total}.`;
    return html`<span class="large">Rank ${row.rank}</span> of ${board?.ranked}, ${total}${row.isTied && ", tied"}.`;
  };
  const badges = [one.category, one.status !== "active" && one.status, one.erased && "erased"].filter(Boolean);
  return html`<p class="place">
    <strong><${Text} value=${one.name} /></strong>${badges.map((badge) => html` <span class="badge"><${Text} value=${badge} /></span>`)}
    ${one.reason && html`<br />The reason: <${Text} value=${one.reason} />`}
    ${board && html`<br />${board.shows === "nothing" ? "The board is hidden until the end." : rank()}`}
  </p>`;
}

/** The next step of an entrant. @param {{competition: any, one: any, attempts: any[], started: (answer: any) => void}} props */
function Next({ competition, one, attempts, started }) {
  const { phase } = competition;
  if (phase === "cancelled") return html`<p>It was cancelled: no attempt can be started.</p>`;
  if (phase === "closing") return html`<p>No attempt can be started any more. Rounds that are open have their whole clock; then everything is revealed.</p>`;
  if (phase === "closed") return html`<p>It is over. <a href="#verify">Check the results</a>: the file has the journals of all games, yours too.</p>`;
  if (one.status !== "active") return html`<p>${one.erased ? "It is erased, and" : `It is ${one.status}, and`} starts no attempts.${!one.erased && " Only an organizer can take it back."}</p>`;
  const counted = attempts.filter(({ voided }) => !voided);
  const now = Date.now();
  const isOpen = (/** @type {any} */ { opens_at }) => Date.parse(opens_at) <= now;
  // A voided attempt may be replaced until the competition closes, while spare seeds are left.
  const { opens_at, closes_at, spares, attempts_per_day: daily } = competition;
  const again = attempts.filter((one) => one.on_spare_seeds).length < spares ? { opens_at, closes_at } : {};
  const left = competition.attempts
    .map((window, index) => ({ ...window, number: index + 1, ...(attempts.some((one) => one.attempt === index + 1) && { isAgain: true, ...again }) }))
    .filter(({ number, closes_at }) => counted.every((one) => one.attempt !== number) && Date.parse(closes_at) > now);
  const next = left.find(isOpen) ?? left[0];
  if (!next) return html`<p>You have no attempt left.</p>`;
  const today = new Date(now).toISOString().slice(0, 10);
  const isSpent = daily && counted.filter(({ created_at }) => created_at.startsWith(today)).length >= daily;
  return html`<p>
      ${left.length} of ${competition.attempts.length} ${competition.attempts.length === 1 ? "attempt" : "attempts"} left${daily && `, ${daily} on one day (UTC)`}.
      ${next.isAgain && ` Attempt ${next.number} was voided: you may start it again.`}
      ${isOpen(next) && next.closes_at !== closes_at && html` Attempt ${next.number} closes <${Countdown} value=${next.closes_at} isAhead />, <${Time} value=${next.closes_at} />.`}
      ${!isOpen(next) && html` Attempt ${next.number} opens <${Countdown} value=${next.opens_at} isAhead />, <${Time} value=${next.opens_at} />: practise until then.`}
      ${isSpent && " Those of today are used: the next one can be started tomorrow (UTC)."}
    </p>
    ${isOpen(next) && !isSpent && html`<p class="buttons"><${Start} competition=${competition} entrant=${one.id} closes=${next.closes_at} started=${started} /></p>`}`;
}

/** @param {{attempts: any[], renew: (run: string) => Promise<void>}} props */
const Attempts = ({ attempts, renew }) => html`<${Items} items=${attempts} label="Table of your attempts" columns=${[
  ["Attempt", (one) => html`${one.attempt}${one.on_spare_seeds && html` <${OnSpareSeeds} />`}`],
  ["Status", (one) => html`<${AttemptStatus} one=${one} />`],
  ["Games", (one) => html`<${AttemptGames} one=${one} />`],
  ["#Total", (one) => (one.status === "running" ? "after its end" : short(one.total))],
  ["Tasks", (one) => one.tasks?.map(({ task, mean }) => html`<div class="small"><${Text} value=${task} /> <span class="number">${short(mean)}</span></div>`)],
  ["Started", (one) => html`<${Time} value=${one.created_at} />`],
  [unseen("Token"), ({ attempt, run, status }) => status === "running" &&
    html`<${ActButton} label="New token" of=${`for attempt ${attempt}`} title="Replace the token of this attempt?" act=${() => renew(run)}
      text="The earlier token is revoked at once: a player that uses it stops. Its games continue, and their clocks run." />`],
]} />`;

/** @param {{competition: any, entrant: string, closes: string, started: (answer: any) => void}} props closes: the window of the attempt */
function Start({ competition, entrant, closes, started }) {
  // A retry after a lost answer is the same start.
  const start = useRef(onceKey());
  const send = async () => {
    const path = route`/api/v1/competitions/${competition.id}/attempts`;
    started(await request(path, { method: "POST", body: { entrant }, idempotencyKey: start.current }));
    start.current = onceKey();
  };
  return html`<${ActButton} label="Start the next attempt" title="Start the next attempt?" isDangerous=${false} isPrimary act=${send}>
    <p>
      Its clocks begin at once: a round that is not answered times out. Have your player ready. An attempt cannot be taken back,
      and games that are not played count as 0.
    </p>
    <p>No round of it begins after <${Time} value=${closes} both />.</p>
  <//>`;
}

/** @param {{run: string, token: string, label?: string}} props */
const HowToPlay = ({ run, token, label = "The token of this attempt" }) => html`<div role="status">
  <${Secret} value=${token} label=${label}>
    <p>
      It plays all agents of all its games: look with <code>GET /swarm/obs</code>, act with <code>POST /swarm/act</code>${" "}
      (<a href="/docs">API</a>). To see it work, a built-in player plays with these lines. Put the token in the place of the dots.
    </p>
    <${Commands} label="How to play" lines=${[`export SWARMBENCH_RUN_TOKEN=…`, `swarmbench play --server ${location.origin} --run ${run}`]} />
    <p class="muted">The same in any language:</p>
    <${Commands} label="The same with curl" lines=${[
      `curl "${location.origin}/swarm/obs?wait=30" -H "Authorization: Bearer $SWARMBENCH_RUN_TOKEN"`,
      `curl "${location.origin}/swarm/act" -H "Authorization: Bearer $SWARMBENCH_RUN_TOKEN" -H "Content-Type: application/json" \\`,
      `  -d '{"acts": [{"episode": "ep_…", "agent": "Agent_0", "round": 0, "action": "STAY"}]}'`,
    ]} />
  <//>
</div>`;

/** Practice: the tasks and settings of a competition on open seeds. @param {{competition: any, entrant: any}} props */
function Practice({ competition, entrant }) {
  const [started, setStarted] = useState(/** @type {any} */ (null));
  if (entrant.status !== "active" || !["announced", "open"].includes(competition.phase)) return null;
  const send = async (/** @type {{seeds?: number[]}} */ { seeds }) => {
    setStarted(null);
    const body = { entrant: entrant.id, ...(seeds?.length && { seeds }) };
    setStarted(await request(route`/api/v1/competitions/${competition.id}/practice`, { method: "POST", body }));
  };
  const help = "Up to 10 numbers. Every task is played once on each. Left empty, the server draws one.";
  const seeds = { name: "seeds", label: "Seeds", kind: "numbers", placeholder: "1, 2, 3", help };
  return html`<details>
    <summary>Practise</summary>
    <p class="muted">The same tasks and settings on open seeds. It counts nowhere, and everybody may see the games once they have ended. A practice run that still runs ends when you start another.</p>
    <${Form} fields=${[seeds]} label="Start a practice run" send=${send} />
    ${started &&
    html`<p>${started.games} games on ${started.seeds.length === 1 ? "the seed" : "the seeds"} ${started.seeds.join(", ")}: <a href=${route`/runs/${started.run}`}>see how they go</a>.</p>
      <${HowToPlay} run=${started.run} token=${started.swarm_token} label="The token of this practice run" />`}
  </details>`;
}
