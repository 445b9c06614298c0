// A game's facts, seats and actions, and the verification of its journal.
import { html, useState } from "../ui.js";
import { request, route, send } from "../api.js";
import { save } from "../parts/download.js";
import { isLive } from "../parts/game.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Time, duration } from "../parts/time.js";
import { savePicture } from "./save.js";

/** @import { Game } from "../parts/game.js" */
/** @import { Shown } from "./title.js" */

/** @param {{game: Game}} props */
export function Facts({ game: { head, summary, kind } }) {
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
  return html`<h2>About this game</h2>
    <dl class="facts">
      ${facts.filter(([, value]) => value !== null && value !== undefined && value !== false && value !== "").map(([name, value]) => html`<dt>${name}</dt><dd>${value}</dd>`)}
    </dl>`;
}

/** The round of another game from which this one plays on. @param {{fork: {episode: string, round: number}}} props */
export const Parent = ({ fork }) => html`<a href=${`${route`/episodes/${fork.episode}`}#r=${fork.round}`}>round ${fork.round} of another game</a>`;

/** The holders of seats, if there can be several. @param {{game: Shown}} props */
export function Seats({ game }) {
  const isMixed = game.kind === "episodes" && game.summary.config?.open_seats > 0;
  const { value, problem, reload } = useLoaded(
    async (signal) => (isMixed ? request(route`/api/v1/episodes/${game.head.id}/claims`, { signal }) : null),
    [game, game.head.status],
    game.head.status === "waiting" ? 5000 : undefined,
  );
  if (!isMixed) return null;
  if (problem) return html`<h2>Seats</h2><${ProblemNote} problem=${problem} retry=${reload} />`;
  if (!value) return html`<h2>Seats</h2><p class="muted">Loading …</p>`;
  return html`<h2>Seats</h2>
    ${value.open > 0 && html`<p>${value.open} ${value.open === 1 ? "seat is" : "seats are"} open. <a href=${route`/play/${game.head.id}`}>Take a seat</a>.</p>`}
    <div class="scroll" tabindex="0" role="region" aria-label="Seats">
      <table>
        <thead><tr><th scope="col">Agent</th><th scope="col">Model</th><th scope="col">Holder</th></tr></thead>
        <tbody>
          ${value.seats.slice(0, 1024).map((/** @type {any} */ seat) => html`<tr>
            <th scope="row"><${Text} value=${String(seat.agent).replace("Agent_", "")} /></th>
            <td>${seat.claim === null ? html`<span class="muted">open</span>` : html`<${Text} value=${seat.model ?? ""} />`}</td>
            <td><${Text} value=${seat.holder ?? (seat.claim === 0 ? "creator" : "")} /></td>
          </tr>`)}
        </tbody>
      </table>
    </div>`;
}

/** @param {{game: Game}} props */
export function Verify({ game }) {
  const [state, setState] = useState(/** @type {any} */ ({}));
  if (game.kind === "imports") return html`<h2>Verify</h2><p>This game was imported from a file. It has no journal, so it cannot be verified.</p>`;
  const verify = async () => {
    if (state.isRunning) return;
    setState({ isRunning: true });
    try {
      setState({ answer: await request(route`/api/v1/episodes/${game.head.id}/verification`, { token: /** @type {any} */ (game).token }) });
    } catch (problem) {
      setState({ problem });
    }
  };
  const { answer, problem, isRunning } = state;
  return html`<h2>Verify</h2>
    <p>The server plays the journal again, and compares every hash, act, score and digest.</p>
    <p><button type="button" onClick=${verify} aria-disabled=${Boolean(isRunning)}>${isRunning ? "Playing it again …" : "Verify this game"}</button></p>
    <div aria-live="polite">
      ${problem && html`<${ProblemNote} problem=${problem} retry=${verify} />`}
      ${answer &&
      html`<p><strong class=${answer.ok ? "good" : "bad"}>${answer.ok ? "Verified" : "Not verified"}</strong>${answer.problem && html`: <${Text} value=${answer.problem} />`}</p>
        <dl class="facts">
          <dt>Rounds</dt><dd>${answer.rounds}</dd>
          <dt>Score</dt><dd>${answer.score}</dd>
          <dt>Head of the journal</dt><dd class="mono"><${Text} value=${answer.journal_head ?? "–"} /></dd>
          <dt>Digest of the first state</dt><dd class="mono"><${Text} value=${answer.layout_digest ?? "–"} /></dd>
          <dt>Digest of the last state</dt><dd class="mono"><${Text} value=${answer.final_digest ?? "–"} /></dd>
          <dt>Rules revision</dt><dd>${answer.rules_revision}</dd>
        </dl>`}
    </div>`;
}

/** Files. @param {{game: Game}} props */
export function Actions({ game }) {
  const [problem, setProblem] = useState(/** @type {any} */ (null));
  const { id } = game.head;
  const saveJournal = async () => {
    setProblem(null);
    try {
      const answer = await send(route`/api/v1/episodes/${id}/journal`, { token: /** @type {any} */ (game).token });
      save(await answer.blob(), `${id}.jsonl`);
    } catch (error) {
      setProblem(error);
    }
  };
  const isEpisode = game.kind === "episodes";
  return html`<h2>Take it with you</h2>
    <div class="buttons">
      ${isEpisode && html`<button type="button" onClick=${saveJournal}>Journal</button>`}
      <button type="button" onClick=${() => savePicture(`${id}-map`)}>Picture of the map</button>
    </div>
    ${problem && html`<${ProblemNote} problem=${problem} what="The journal" />`}`;
}
