// What a game's page reads when it is first needed: tables and windows of all agents, texts of one, keys, pictures, commands, facts and
// the verification of the journal.
import { html, useEffect, useRef, useState } from "../ui.js";
import { request, route } from "../api.js";
import { actionOf, resultOf, saidBy } from "../parts/actions.js";
import { IN_WORDS, signsIn } from "../parts/cell.js";
import { short } from "../parts/chart.js";
import { Commands } from "../parts/copy.js";
import { save } from "../parts/download.js";
import { duration } from "../parts/duration.js";
import { isLive } from "../parts/game.js";
import { useTask } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { failureText } from "../parts/status.js";
import { Facts as FactList, Shown, SortHead, Table } from "../parts/table.js";
import { LongText, Text } from "../parts/text.js";
import { Time } from "../parts/time.js";
import { AgentWindow, surroundings } from "../parts/window.js";
import { Missing } from "../parts/worth.js";
import { Parent } from "./about.js";
import { isSecret } from "./agent.js";
import { PANELS } from "./place.js";
import { AgentLink } from "./round.js";

/** @import { Game, State } from "../parts/game.js" */
/** @import { Decision, Losses, Worth } from "../parts/worth.js" */
/** @import { Props } from "./round.js" */

/** @type {[string, string][]} */
const COLUMNS = [["agent", "Agent"], ["row", "Row"], ["column", "Column"], ["action", "Action"], ["result", "Result"], ["message", "Message"]];

/** All agents as a table: the map for screen readers. @param {Props} props */
export function AgentTable({ head, state, next, agent, onChoose }) {
  const [sort, setSort] = useState("agent");
  const signOf = signsIn(head, state);
  const by = sort.replace("-", "");
  const rows = Array.from({ length: head.num_agents }, (_, n) => rowOf(state, next, n, signOf(n))).sort((a, b) => compare(a[by], b[by]) * (sort === by ? 1 : -1));
  const marked = { Synchronization: "Light", Foraging: "Load" }[head.task];
  const heads = [...COLUMNS.map(([name, title]) => html`<${SortHead} name=${title} by=${name} back=${`-${name}`} sort=${sort} onSort=${setSort} isUp=${true} />`), ...(marked ? [marked] : [])];
  const table = (shown) => html`<${Table} label="Table of all agents" name="agents" caption=${`All agents in round ${state.round}`} heads=${heads}>
    <tbody>
      ${shown.map((row) => html`<tr key=${row.agent} class=${row.agent === agent ? "chosen" : ""}>
        <th scope="row"><${AgentLink} agent=${row.agent} onChoose=${onChoose} /></th>
        <td class="number">${row.row ?? "–"}</td><td class="number">${row.column ?? "–"}</td>
        <td>${row.action}</td><td>${row.result}</td><td><${Text} value=${row.message} /></td>
        ${marked && html`<td>${row.marked}</td>`}
      </tr>`)}
    </tbody>
  <//>`;
  return html`<${Shown} items=${rows} wrap=${table} />`;
}

/** @param {State} state @param {State | null} next @param {number} n @param {import("../parts/cell.js").Sign} sign @returns {Record<string, any>} */
function rowOf(state, next, n, sign) {
  const isGone = state.gone?.includes(n);
  return {
    agent: n,
    row: isGone ? null : state.at[2 * n],
    column: isGone ? null : state.at[2 * n + 1],
    action: isGone ? "not on the map" : (actionOf(next, n)?.name ?? ""),
    result: resultOf(next, n),
    message: saidBy(next, n),
    marked: sign ? IN_WORDS[sign] : "",
  };
}

const compare = (a, b) => (typeof a === "string" ? a.localeCompare(b) : (a ?? -1) - (b ?? -1));

/** The windows of all agents. @param {Props} props */
export function AllWindows({ head, state, next, onChoose }) {
  if (head.control === "centralized") return html`<p class="muted">Agents of this game see the whole map.</p>`;
  const signOf = signsIn(head, state);
  const there = Array.from({ length: head.num_agents }, (_, n) => n).filter((n) => !state.gone?.includes(n));
  /** @param {number} n */
  const one = (n) => html`<li key=${n}>
    <div><${AgentLink} agent=${n} onChoose=${onChoose} /> <span class="small">${actionOf(next, n)?.name ?? ""} <span class="bad">${resultOf(next, n)}</span></span></div>
    <${AgentWindow} cells=${surroundings(head, state, n)} rules=${head} agent=${n} sign=${signOf(n)} label=${`Around agent ${n}`} />
  </li>`;
  return html`<p class="muted small">The true surroundings on the map, without what the agents remember.</p>
    <${Shown} items=${there} wrap=${(/** @type {number[]} */ shown) => html`<ul class="all-windows">${shown.map(one)}</ul>`} />`;
}

/** @param {{game: Game, heard: any[], panel: string, read: any, problem?: Error, isResting: boolean}} props */
export function ReadPanel({ game, heard, panel, read, problem, isResting }) {
  if (isSecret(game)) return html`<p class="muted">What agents read and answer can be seen by the creator of the game, and by everybody after its end.</p>`;
  if (problem) return html`<${ProblemNote} problem=${problem} what="This act" />`;
  if (!read) return html`<p class="muted" role="status">${isResting ? "Loading …" : "Pause to read it."}</p>`;
  if (read.isMissing) return html`<p class="muted">What this agent read and answered is not in this file.</p>`;
  if (panel === "inbox") return html`<${Inbox} inbox=${read.inbox ?? heard} />`;
  if (panel === "prompt") return html`<${Prompt} read=${read} />`;
  const text = panel === "answer" ? read.act?.response : read.act?.reasoning;
  const failure = panel === "answer" ? read.act?.failure : undefined;
  const why = failure && html`<p class="bad">The answer did not count: ${failureText(failure)}.</p>`;
  if (text) return html`${why}<${LongText} value=${text} label=${PANELS[panel]} />`;
  if (why) return why;
  return html`<p class="muted">${panel === "answer" ? noAnswer(read) : "No reasoning was sent with this act."}</p>`;
}

function noAnswer({ act }) {
  if (!act) return "There is no act: the round is not over, or the agent did not act in it.";
  if (act.source === "clock") return "No answer came in time.";
  const message = act.message ? ", with the message that is shown" : "";
  return `The player sent the action ${act.action ?? "none"}${message}, not a text.`;
}

/** @param {{inbox: any[]}} props */
const Inbox = ({ inbox }) =>
  inbox.length === 0
    ? html`<p class="muted">No message came with this round.</p>`
    : html`<ul class="plain inbox">
        ${inbox.map(
          ({ from, sent, text, original }) => html`<li>
            <span class="muted">agent ${String(from).replace("Agent_", "")}${sent !== undefined && `, said in round ${sent}`}</span><br />“<${Text} value=${text} />”
            ${original !== undefined && original !== null && html`<br /><span class="bad">changed by noise; sent was</span> “<${Text} value=${original} />”`}
          </li>`,
        )}
      </ul>`;

/** @param {{read: any}} props */
const Prompt = ({ read }) =>
  read.prompt
    ? html`<${Around} harness=${read.act?.harness}><${LongText} value=${read.prompt} label="Prompt" /><//>`
    : html`<p class="muted">${read.prompt_problem ? html`No prompt: <${Text} value=${read.prompt_problem} />` : "There is no prompt."}</p>`;

/** What the player's program put around the prompt, as far as it is stored, in the order in which the model got it. @param {{harness: any, children: any}} props */
function Around({ harness, children }) {
  if (!harness) return children;
  const { history = [], carried = [], added, tries = [], scratchpad } = harness;
  return html`<div class="pieces">
    ${history.length > 0 && html`<p class="muted small">Before it came the prompts and answers of this agent in ${roundsOf(history)}${carried.length > 0 && `, with the encrypted reasoning of ${roundsOf(carried)}, which is not stored`}.</p>`}
    ${children}
    ${added && html`<h3>Added to the prompt</h3><${LongText} value=${added} label="Added to the prompt" />`}
    ${tries.map(({ response, told }, n) => html`<h3>Invalid answer ${n + 1}</h3><${LongText} value=${`${response}\n\n→ ${told}`} label=${`Invalid answer ${n + 1}`} />`)}
    ${scratchpad && html`<h3>Notes after the answer</h3><${LongText} value=${scratchpad} label="Notes" />`}
  </div>`;
}

/** @param {number[]} rounds */
const roundsOf = (rounds) => `${rounds.length === 1 ? "round" : "rounds"} ${rounds.join(", ")}`;

/** Keys that are told of: how they are shown, what they do, and one of them. @type {[string, string, string][]} */
const HELP = [
  ["← →", "one round back, one on", "ArrowLeft"],
  ["Shift ← →", "ten rounds", "ArrowLeft"],
  ["Home End", "the first round, the newest", "Home"],
  ["Space", "play, pause", " "],
  [", .", "slower, faster", ","],
  ["n p", "the next mark, the one before", "n"],
  ["0 … 9", "the agent with this number", "0"],
  ["[ ]", "the agent before, the next", "["],
  ["m", "lines to who heard a message", "m"],
  ["v", "the windows of all agents", "v"],
  ["t", "the table of all agents", "t"],
  ["z", "a large map", "z"],
  ["f", "follow a running game", "f"],
  ["l", "copy a link to this moment", "l"],
  ["c", "compare with another game", "c"],
  ["x", "swap the games", "x"],
  ["?", "this list", "?"],
];

/** @param {{keys: import("./keys.js").Keys, mark: string, onClose: () => void}} props `mark`: what `n` and `p` go to */
export function KeyHelp({ keys, mark, onClose }) {
  const dialog = useRef(/** @type {HTMLDialogElement | null} */ (null));
  useEffect(() => dialog.current?.showModal(), []);
  return html`<dialog ref=${dialog} aria-labelledby="keys-title" onClose=${onClose}>
    <h2 id="keys-title">Keys</h2>
    <table>
      <tbody>
        ${HELP.filter(([, , key]) => keys[key]).map(([shown, what]) => html`<tr>
          <th scope="row">${shown.split(" ").map((key) => (key === "…" ? " … " : html`<kbd>${key}</kbd> `))}</th><td>${what.replace("mark", mark)}</td>
        </tr>`)}
      </tbody>
    </table>
    <p><button type="button" onClick=${() => dialog.current?.close()}>Close</button></p>
  </dialog>`;
}

/** The decisions that lost most, each a button to its round. @param {{worth: Worth, losses: Losses, round: number, onShow: (decision: Decision) => void}} props */
export function LossList({ worth, losses: { known, decisions, problem, reload, ask }, round, onShow }) {
  useEffect(ask, []);
  const isEmpty = known?.dearest && decisions.length === 0;
  return html`<div class="losses">
    <p class="muted small">
      The worth of a state is the score that the reference, <${Text} value=${worth.reference} />, reaches from it on all seats. A decision lost as much as the worth would be higher if this agent alone had done what the reference does.
      ${worth.reference_is_weak && " It is weak here: from the start it would have scored less than this game did."}
    </p>
    <p role="status">${problem || known ? (isEmpty ? "No decision lost anything." : "") : "Each decision is replaced by the reference’s. That takes up to a minute …"}</p>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${reload} what="What decisions lost" />`}
    <${Missing} worth=${known} part="seats" />
    <ol class="plain">
      ${decisions.map(
        (decision) => html`<li><button type="button" class="quiet" aria-current=${decision.round === round} onClick=${() => onShow(decision)}>
          <span class="number">Round ${decision.round}</span> <${Text} value=${decision.words} /> <b class="number">−${short(decision.loss)}</b>
        </button></li>`,
      )}
    </ol>
  </div>`;
}

/** Properties of shapes that come from style sheets, which a saved file lacks. */
const DRAWN = ["fill", "stroke", "stroke-width", "stroke-dasharray", "opacity", "font-family", "font-size", "font-weight", "text-anchor", "transform"];

/** The map as it is drawn now. @param {string} name */
export function savePicture(name) {
  const map = document.querySelector("svg.map");
  if (map instanceof SVGSVGElement) save(new Blob([standalone(map)], { type: "image/svg+xml" }), `${name}.svg`);
}

/** @param {SVGSVGElement} map */
function standalone(map) {
  const copy = /** @type {SVGSVGElement} */ (map.cloneNode(true));
  const [from, to] = [map.querySelectorAll("*"), copy.querySelectorAll("*")];
  from.forEach((element, index) => {
    const style = getComputedStyle(element);
    for (const property of DRAWN) {
      const value = style.getPropertyValue(property);
      if (property === "transform" ? value !== "none" && !to[index].hasAttribute("transform") : value) to[index].setAttribute(property, value);
    }
    to[index].removeAttribute("style");
    to[index].removeAttribute("class");
  });
  const { width, height } = map.viewBox.baseVal;
  copy.setAttribute("width", String(width * 2));
  copy.setAttribute("height", String(height * 2));
  copy.removeAttribute("class");
  return new XMLSerializer().serializeToString(copy);
}

/** @param {{id: string}} props */
export function GameCommands({ id }) {
  const server = location.origin;
  return html`<p>An animated GIF:</p>
    <${Commands} label="Command for the animation" what="the command for the animation" lines=${[`swarmbench replay ${id} --gif game.gif --messages --server ${server}`]} />
    <p>This page as one file, which opens without a server:</p>
    <${Commands} label="Command for one file" what="the command for one file" lines=${[`swarmbench replay ${id} --html game.html --server ${server}`]} />
    <p>Check the journal without trusting this server:</p>
    <${Commands} label="Command for the check" what="the command for the check" lines=${[`swarmbench verify ${id}.jsonl`]} />`;
}

/** @param {{game: Game}} props */
export function Facts({ game }) {
  const { head, summary, kind } = game;
  const config = summary.config ?? summary.settings ?? summary;
  /** @type {[string, unknown][]} */
  const facts = [
    ["Task", head.task],
    ["Model", html`<${Text} value=${summary.model} />`],
    ["Run", kind !== "file" && summary.run && html`<a href=${route`/runs/${summary.run}`}><${Text} value=${summary.run} /></a>`],
    ["Plays on from", kind !== "file" && summary.fork && html`<${Parent} fork=${summary.fork} />`],
    ["Run", summary.run_id && html`<${Text} value=${summary.run_id} />`],
    ["Seed", config.seed ?? summary.seed ?? (isLive(head) ? "shown after the end" : null)],
    ["Rules", head.rules],
    ["Map", `${head.width} × ${head.height}`],
    ["Agents", head.num_agents],
    ["Window", head.control === "centralized" ? "the whole map" : head.view_size && `${head.view_size} × ${head.view_size}`],
    ["Memory", config.memory !== undefined ? `${config.memory} rounds` : null],
    ["Control", head.control],
    ["Noise", config.noise ? `${config.noise} of messages` : null],
    ["Delay", config.max_delay ? `up to ${config.max_delay} rounds` : null],
    ["Clock", config.round_deadline_s ? `${duration(config.round_deadline_s * 1000)} a round, bank ${duration(config.bank_s * 1000)}` : null],
    ["Template", config.prompt_template ? "its own" : null],
    ["Created", summary.created_at && html`<${Time} value=${summary.created_at} both=${true} />`],
    ["Ended", summary.ended_at && html`<${Time} value=${summary.ended_at} both=${true} />`],
    ["Id", kind === "file" ? null : html`<span class="mono">${head.id}</span>`],
  ];
  return html`${kind !== "file" && html`<${Verify} game=${game} />`}
    <h2>About this game</h2>
    <${FactList} facts=${facts} />`;
}

/** @param {{game: Game}} props */
function Verify({ game }) {
  const [answer, setAnswer] = useState(/** @type {any} */ (null));
  const { problem, isBusy, run } = useTask();
  if (game.kind === "imports") return html`<h2>Verify</h2><p>This game was imported from a file. It has no journal, so it cannot be verified.</p>`;
  const verify = () => run(async () => setAnswer(await request(route`/api/v1/episodes/${game.head.id}/verification`, { token: /** @type {any} */ (game).token })));
  return html`<h2>Verify</h2>
    <p>The server plays the journal again, and compares every hash, act, score and digest.</p>
    <p><button type="button" onClick=${verify} aria-disabled=${isBusy}>${isBusy ? "Playing it again …" : "Verify this game"}</button></p>
    <div aria-live="polite">
      ${problem && html`<${ProblemNote} problem=${problem} retry=${verify} />`}
      ${answer &&
      html`<p><strong class=${answer.ok ? "good" : "bad"}>${answer.ok ? "Verified" : "Not verified"}</strong>${answer.problem && html`: <${Text} value=${answer.problem} />`}</p>
        <${FactList} look="mono" facts=${[
          ["Rounds", answer.rounds],
          ["Score", answer.score],
          ["Head of the journal", answer.journal_head],
          ["Digest of the first state", answer.layout_digest],
          ["Digest of the last state", answer.final_digest],
          ["Rules revision", answer.rules_revision],
        ]} />`}
    </div>`;
}
