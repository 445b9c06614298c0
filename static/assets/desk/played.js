// What is played: games, runs, and attempts of competitions, which can be started, ended and voided.
import { html, useState } from "../ui.js";
import { request, route, withQuery } from "../api.js";
import { visit } from "../app.js";
import { ActMenu } from "../parts/act.js";
import { short } from "../parts/chart.js";
import { Secret } from "../parts/copy.js";
import { Choice } from "../parts/filters.js";
import { ListTable, unseen } from "../parts/listed.js";
import { usePages } from "../parts/pages.js";
import { AttemptGames, AttemptStatus, OnSpareSeeds, visibleTo } from "../parts/status.js";
import { Name, Text, visible } from "../parts/text.js";
import { Time } from "../parts/time.js";
import { ending, renewals } from "../parts/tokens.js";
import { roundsText } from "../parts/words.js";

const REFRESH_MS = 5000;

/** @param {string} shown a status, or empty */
const emptyText = (shown) => `There is none${shown && ` that is ${shown}`}.`;

/** @param {{query: URLSearchParams, mayChange: boolean, isJudge: boolean}} props mayChange: any game, and not only own ones */
export function Games({ query, mayChange, isJudge }) {
  const run = query.get("run");
  const shown = query.get("status") ?? (run ? "" : "running");
  const list = usePages(withQuery("/api/v1/episodes", { run, status: shown }), REFRESH_MS);
  const choose = (/** @type {string} */ status) => visit(`${withQuery("/desk", { view: "games", run })}&status=${status}`);
  const acts = (/** @type {any} */ one) => {
    const path = route`/api/v1/episodes/${one.id}`;
    return [
      !isJudge && one.status === "waiting" && {
        ...{ label: "Start", isDangerous: false, act: () => request(`${path}/start`, { method: "POST" }) },
        text: "Its round 0 opens, and its clock begins. Seats that nobody holds have to be claimed before.",
      },
      !isJudge && ["running", "waiting"].includes(one.status) && {
        ...{ label: "Abort", act: () => request(path, { method: "DELETE" }) },
        text: "This ends it now. What was played stays, and counts. This cannot be taken back.",
      },
      mayChange && !one.void_reason && {
        ...{ label: "Void", reason: /** @type {const} */ ("required") },
        act: (/** @type {string} */ reason) => request(`${path}/void`, { method: "POST", body: { reason } }),
        text: "For faults of the server. From then on it counts nowhere. If its run is running, the game is played again. This cannot be taken back.",
      },
    ];
  };
  return html`
    <h2>Games${run && html` of <code class="id"><${Text} value=${run} /></code>`}</h2>
    <p>
      <${Choice} label="Status" value=${shown} options=${["running", "waiting", "finished", "aborted", "abandoned"]} onChange=${choose} />
      ${run && html` <a href="/desk?view=games">Games of all runs</a>`}
    </p>
    <${ListTable} list=${list} label="Table of games" empty=${emptyText(shown)} columns=${[
      ["Game", (one) => html`<a href=${route`/episodes/${one.id}`}>${one.task} · <${Text} value=${one.model} /></a>`],
      ["Status", (one) => html`${one.status}${one.void_reason && html`<div class="small"><span class="badge">voided</span> <${Text} value=${one.void_reason} /></div>`}`],
      ["#Round", (one) => one.round],
      ["#Score", (one) => short(one.score)],
      ["Visible to", (one) => visibleTo(one.config?.visibility)],
      ["Created", (one) => html`<${Time} value=${one.created_at} />`],
      [unseen("Actions"), (one) => html`<${ActMenu} of=${`the game of ${one.task} by ${visible(one.model)}`} acts=${acts(one)} done=${list.reload} />`],
    ]} />
  `;
}

/** @param {{query: URLSearchParams, isJudge: boolean}} props */
export function Runs({ query, isJudge }) {
  const shown = query.get("status") ?? "running";
  const list = usePages(withQuery("/api/v1/runs", { status: shown }), REFRESH_MS);
  const [made, setMade] = useState({ swarm_token: "", holder: "" });
  const acts = (/** @type {any} */ one) => (isJudge || one.status !== "running" ? [] : [...renewals(one, setMade), ending(one)]);
  const suite = (/** @type {any} */ { attempt, suite: { name } }) =>
    attempt ? html`attempt ${attempt} in <a href=${route`/desk?view=competition&id=${name}`}>a competition</a>` : html`<${Text} value=${name} />`;
  return html`
    <h2>Runs</h2>
    <p><${Choice} label="Status" value=${shown} options=${["running", "finished", "aborted", "abandoned", "closed"]}
      onChange=${(/** @type {string} */ status) => visit(`/desk?view=runs&status=${status}`)} /></p>
    ${made.swarm_token && html`<div role="status"><${Secret} value=${made.swarm_token} label=${`The new token of ${visible(made.holder || "the run")}`} /></div>`}
    <${ListTable} list=${list} label="Table of runs" empty=${emptyText(shown)} columns=${[
      ["Model", (one) => html`<a href=${route`/runs/${one.id}`}><${Text} value=${one.model} /></a>`],
      ["Suite", suite],
      ["Status", (one) => html`${one.status}${one.waits_for && html`<div class="small">waits for <code><${Text} value=${one.waits_for.name ?? one.waits_for} /></code></div>`}`],
      ["#Games", (one) => `${one.played} of ${one.planned}`],
      ["Visible to", (one) => visibleTo(one.visibility)],
      ["Created", (one) => html`<${Time} value=${one.created_at} />`],
      [unseen("Actions"), (one) => html`<${ActMenu} of=${`the run of ${visible(one.model)}`} acts=${acts(one)} done=${list.reload}>
        <a href=${route`/desk?view=games&run=${one.id}`}>Its games</a>
      <//>`],
    ]} />
  `;
}

/** The consequences for the seeds. @param {number} spares */
const voidedText = (spares) =>
  spares > 0
    ? "The entrant may start it again, as long as the competition is open: on spare seeds, or, if it has used all of them, on the same ones within its window."
    : "This competition has no spare seeds. The entrant may start it again as long as its window is open, on the same seeds, of which it may have seen some.";

/** Attempts of all entrants. @param {{competition: any, names: Map<string, string>, mayChange: boolean}} props names: of all entrants */
export function Attempts({ competition, names, mayChange }) {
  const path = route`/api/v1/competitions/${competition.id}/attempts`;
  const list = usePages(path, REFRESH_MS);
  const [token, setToken] = useState("");
  const [seen, setSeen] = useState(/** @type {any} the entrant's knowledge of seeds on which it will play again */ (null));
  const nameOf = (/** @type {any} */ { entrant }) => names.get(entrant) ?? entrant;
  const acts = (/** @type {any} */ one) => {
    if (!mayChange) return [];
    const run = { id: one.run };
    const isRunning = one.status === "running";
    return [
      ...(isRunning ? renewals(run, ({ swarm_token }) => setToken(swarm_token)) : []).map((act) => ({
        ...act, title: html`Replace the token of attempt ${one.attempt} of <${Text} value=${nameOf(one)} />?`,
      })),
      !one.voided && {
        ...{ label: "Void", reason: /** @type {const} */ ("required") },
        act: async (/** @type {string} */ reason) => {
          const { seen } = await request(path + route`/${one.run}/void`, { method: "POST", body: { reason } });
          setSeen(seen && { ...seen, name: nameOf(one), attempt: one.attempt, games: one.games });
        },
        text: `For faults of the server. It ends, and does not count. ${voidedText(competition.spares)} This cannot be taken back.`,
      },
      isRunning && { ...ending(run), title: undefined, text: "It ends now, and counts with what it has: games that were not played count as 0. To let it be played again, void it instead." },
    ];
  };
  return html`
    ${token && html`<div role="status"><${Secret} value=${token} label="The new token of the attempt"><p>Give it to the entrant alone.</p><//></div>`}
    <div role="status">
      ${seen &&
      html`<div class="problem">
        <p><strong>Warning: <${Text} value=${seen.name} /> has seen seeds of attempt ${seen.attempt}.</strong></p>
        <p>${seen.games_opened} of ${seen.games} games were opened, and ${roundsText(seen.rounds)} played. <${Text} value=${seen.warning} /></p>
      </div>`}
    </div>
    <${ListTable} list=${list} label="Table of attempts" empty="Nobody has started an attempt."
      filter=${{
        ...{ name: "attempts", textOf: (one) => [nameOf(one), one.voided, one.run].join("\n"), placeholder: "a name, a reason" },
        statusOf: (one) => (one.voided ? "voided" : one.status),
      }}
      columns=${[
        ["Entrant", (one) => html`<${Name} value=${nameOf(one)} />`],
        ["#Attempt", (one) => html`${one.attempt}${one.on_spare_seeds && html` <${OnSpareSeeds} />`}`],
        ["Status", (one) => html`<${AttemptStatus} one=${one} />`],
        ["Games", (one) => html`<${AttemptGames} one=${one} />`],
        ["#Total", (one) => short(one.total)],
        ["Started", (one) => html`<${Time} value=${one.created_at} />`],
        [unseen("Actions"), (one) => html`<${ActMenu} of=${`attempt ${one.attempt} of ${visible(nameOf(one))}`} acts=${acts(one)} done=${list.reload}>
          <a href=${route`/runs/${one.run}`}>Its scores</a><a href=${route`/desk?view=games&run=${one.run}`}>Its games</a>
        <//>`],
      ]} />
  `;
}
