// Checks the published file of a competition during the download, and lists the checks.
import { html, useEffect, useRef, useState } from "../ui.js";
import { route, send } from "../api.js";
import { Commands, Copyable } from "../parts/copy.js";
import { Download } from "../parts/download.js";
import { eachPage } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Mismatch } from "./chain.js";

const SHOW_EVERY_MS = 200;

/** @param {{competition: any}} props */
export function Verification({ competition }) {
  const [state, setState] = useState(/** @type {any} */ ({}));
  const [given, setGiven] = useState({ commitment: "", head: "" });
  const running = useRef(/** @type {AbortController | null} */ (null));
  useEffect(() => () => running.current?.abort(), []);
  const path = route`/api/v1/exports/competitions/${competition.id}`;

  const verify = async () => {
    const { signal } = (running.current = new AbortController());
    let shownAt = 0;
    const onProgress = (/** @type {any} */ progress) => {
      if (performance.now() - shownAt < SHOW_EVERY_MS) return;
      shownAt = performance.now();
      setState({ progress: { ...progress } });
    };
    setState({ progress: { bytes: 0, lines: 0, games: 0 } });
    try {
      // Few visitors verify: the rest of the page does not wait for the checks.
      const { checkFile } = await import("./file.js");
      const { body } = await send(path, { signal });
      const findings = await checkFile(/** @type {any} */ (body), onProgress);
      setState({ findings, board: await compare(competition, findings, signal) });
    } catch (problem) {
      setState(signal.aborted ? {} : { problem });
    }
  };
  const { progress, findings, problem, board } = state;
  const entry = (/** @type {"commitment" | "head"} */ name, /** @type {string} */ label) => html`<label class="field">${label}
    <input value=${given[name]} spellcheck=${false} autocomplete="off" placeholder="64 hexadecimal digits"
      onInput=${(/** @type {any} */ event) => setGiven({ ...given, [name]: event.target.value.trim().toLowerCase() })} />
  </label>`;
  return html`
    <p>This page downloads the published file, and checks its hashes, seeds and totals in your browser. It does not ask the server whether they are right.</p>
    ${!globalThis.crypto?.subtle && html`<p class="bad">Browsers compute hashes on pages over https alone. Use the commands below.</p>`}
    <form onSubmit=${(/** @type {Event} */ event) => (event.preventDefault(), verify())}>
      <details>
        <summary>Compare with what was published elsewhere</summary>
        ${entry("commitment", "The commitment that was published at the beginning")}
        ${entry("head", "The head of the file that was published after the end")}
      </details>
      <p class="buttons">
        <button type="submit" class="primary" disabled=${Boolean(progress) || !globalThis.crypto?.subtle}>Verify</button>
        ${progress && html`<button type="button" onClick=${() => running.current?.abort()}>Stop</button>`}
        <${Download} href=${path} name=${`${competition.id}.jsonl`}>Download the file<//>
      </p>
    </form>
    ${progress &&
    html`<p role="status"><progress aria-label="Verifying"></progress> ${(progress.bytes / 1e6).toFixed(1)} MB, ${progress.lines.toLocaleString("en")} lines, ${progress.games} games</p>`}
    ${problem instanceof Mismatch &&
    html`<div class="problem" role="alert">
      <h3>The file does not pass</h3>
      <p><${Text} value=${problem.message} />.</p>
      <p>Load it again. If it fails again, tell the organizer: the file was changed, or it broke off.</p>
    </div>`}
    ${problem && !(problem instanceof Mismatch) && html`<${ProblemNote} problem=${problem} retry=${verify} />`}
    ${findings && html`<${Result} findings=${findings} board=${board} competition=${competition} given=${given} />`}
    <h3>What this page cannot check</h3>
    <p>
      That the rounds of each game follow from the answers, how many of these were invalid, and that it has the settings and times that it
      should: for that every game has to be played again. Nor does it check means of single tasks, the order of equal rows, what
      organizers changed, and whether a field stands twice. This program checks all of it, with no server:
    </p>
    <${Commands} label="How to verify everything" lines=${[`swarmbench verify --competition ${competition.id}.jsonl --commitment ${competition.commitment}`]} />
  `;
}

/** Compares the board on this page with that of the file. @param {any} competition @param {import("./file.js").Findings} findings @param {AbortSignal} signal */
async function compare(competition, findings, signal) {
  const inFile = new Map(findings.rows.map((row) => [row.entrant, row]));
  const rows = [];
  await eachPage(route`/api/v1/competitions/${competition.id}/board`, {}, signal, ({ items }) => void rows.push(...items));
  const differs = ({ entrant, rank, total }) => inFile.get(entrant.id)?.rank !== rank || inFile.get(entrant.id)?.total !== total;
  return { rows: rows.length, differ: rows.filter(differs).length };
}

/** @param {{findings: import("./file.js").Findings, board: {rows: number, differ: number}, competition: any, given: {commitment: string, head: string}}} props */
function Result({ findings, board, competition, given }) {
  const compared = [
    [findings.commitment === competition.commitment, "The commitment of the file is the one on this page."],
    [board.differ === 0, `Ranks and totals of ${board.rows} entrants are those on this page.`],
    given.commitment && [findings.commitment === given.commitment, "The commitment is the one that you entered."],
    given.head && [findings.head === given.head, "The head of the file is the one that you entered."],
  ].filter(Boolean);
  const isGood = compared.every(([holds]) => holds);
  const { lines, games, entrants, head } = findings;
  return html`<div role="status" class="result">
    <h3 class=${isGood ? "good" : "bad"}>${isGood ? "✓ The file passes" : "✗ The file passes in itself, but differs from what was published"}</h3>
    <ul>
      <li>✓ ${lines.toLocaleString("en")} lines: every hash covers the line before it, none was changed.</li>
      <li>✓ Salt and seeds give the commitment.</li>
      <li>✓ ${games} ${games === 1 ? "game was" : "games were"} played on the sealed seeds of ${games === 1 ? "its place" : "their places"}, each with a whole journal.</li>
      <li>✓ Totals and ranks of ${entrants} entrants follow from the scores of their games.</li>
      ${compared.map(([holds, text]) => html`<li class=${holds ? "" : "bad"}>${holds ? "✓ " : "✗ Not so: "}${text}</li>`)}
      ${!given.commitment && html`<li class="muted">Not checked: that the commitment is the one of the first day. Enter it above if you noted it.</li>`}
      ${!given.head && html`<li class="muted">Not checked: that nothing was left out. For that compare the head with the one that the organizer published.</li>`}
    </ul>
    <p>Head of the file: <${Copyable} value=${head} label="the head of the file" /></p>
  </div>`;
}
