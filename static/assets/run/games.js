// The games of a run as a list: failures with reasons, journals, and their verification.
import { html, useEffect, useState } from "../ui.js";
import { Problem, request, route } from "../api.js";
import { Text } from "../parts/text.js";
import { short } from "../parts/chart.js";
import { Status, failuresText, percent, roundsText } from "../parts/status.js";
import { Download } from "../parts/download.js";
import { failed, whyOf } from "../parts/grid.js";

/** @param {any} game */
const nameOf = (game) => (game.seed === null ? `${game.task}, game ${game.slot + 1}` : `${game.task}, seed ${game.seed}`);

/** The number of games listed at first. */
const LISTED = 50;

/** The failures of a run. @param {{run: any}} props */
export function Failures({ run }) {
  const games = failed(run);
  const { acts } = run;
  const why = failuresText(acts.failures);
  if (games.length === 0 && acts.invalid === 0 && acts.timeouts === 0) return null;
  return html`
    <h2>What failed</h2>
    <ul>
      ${acts.invalid > 0 && html`<li>${short(acts.invalid)} of ${short(acts.sent)} answers could not be read (${percent(acts.invalid_share)}): their agents did nothing. ${why && `${why}. `}A game's page shows each.</li>`}
      ${acts.timeouts > 0 && html`<li>${short(acts.timeouts)} times a clock expired (${percent(acts.timeout_share)} of all moves).</li>`}
      ${games.slice(0, LISTED).map(
        (/** @type {any} */ game) => game.episode ? html`<li>
          <a href=${route`/episodes/${game.episode}`}>${nameOf(game)}</a>: ${whyOf(game)}, after ${roundsText(game.round)} with score ${short(game.score)}${game.void_reason !== null &&
          html`. Voided: <${Text} value=${game.void_reason} />`}
        </li>` : html`<li>${nameOf(game)}: never played, counts as 0</li>`,
      )}
      ${games.length > LISTED && html`<li>${games.length - LISTED} more, in the list below</li>`}
    </ul>
  `;
}

/** @param {{games: any[]}} props */
export function Games({ games }) {
  const [isOpen, setIsOpen] = useState(false);
  const [shown, setShown] = useState(LISTED);
  const verified = useVerified(games);
  return html`<details onToggle=${(/** @type {any} */ event) => setIsOpen(event.currentTarget.open)}>
    <summary>${games.length} games with journals and verification</summary>
    ${isOpen &&
    html`
      <p class="buttons">
        <button type="button" onClick=${verified.toggle}>${verified.isRunning ? "Stop" : "Verify all games"}</button>
        <span role="status">${verified.text}</span>
      </p>
      <div class="scroll" tabindex="0" role="region" aria-label="Games of the run">
        <table>
          <thead>
            <tr>
              ${["Game", "Status", "Why it ended"].map((name) => html`<th scope="col">${name}</th>`)}
              ${["Rounds", "Score"].map((name) => html`<th scope="col" class="number">${name}</th>`)}
              <th scope="col">Journal</th>
              <th scope="col">Verified</th>
            </tr>
          </thead>
          <tbody>
            ${games.slice(0, shown).map((game) => html`<${Line} key=${game.episode ?? game.slot} game=${game} result=${verified.results.get(game.episode)} />`)}
          </tbody>
        </table>
      </div>
      ${shown < games.length && html`<p><button type="button" onClick=${() => setShown(shown + LISTED)}>More</button></p>`}
    `}
  </details>`;
}

/** @param {{game: any, result?: {ok: boolean, text: string}}} props */
const Line = ({ game, result }) => html`<tr>
  <th scope="row">${game.episode ? html`<a href=${route`/episodes/${game.episode}`}>${nameOf(game)}</a>` : nameOf(game)}</th>
  <td><${Status} status=${game.status} /></td>
  <td>${game.reason ? whyOf(game) : ""}${game.void_reason !== null && html` (voided: <${Text} value=${game.void_reason} />)`}</td>
  <td class="number">${game.round}</td>
  <td class="number">${short(game.score)}</td>
  <td>${game.episode && html`<${Download} href=${route`/api/v1/episodes/${game.episode}/journal`} name=${`${game.episode}.jsonl`}>journal</${Download}>`}</td>
  <td>${result && html`<span class=${result.ok ? "good" : "bad"}><${Text} value=${result.text} /></span>`}</td>
</tr>`;

/** Has the server play the journals again, one after another. @param {any[]} games */
function useVerified(games) {
  const [results, setResults] = useState(/** @type {Map<string, {ok: boolean, text: string}>} */ (new Map()));
  const [running, setRunning] = useState(/** @type {AbortController | null} */ (null));
  useEffect(() => () => running?.abort(), [running]);
  const ended = games.filter((game) => game.episode && game.status !== "running" && game.status !== "waiting");

  async function start() {
    const aborted = new AbortController();
    setRunning(aborted);
    for (const { episode } of ended) {
      const result = await verify(episode, aborted.signal);
      if (aborted.signal.aborted) return;
      setResults((results) => new Map(results).set(episode, result));
    }
    setRunning(null);
  }

  const toggle = () => {
    running?.abort();
    if (running) setRunning(null);
    else void start();
  };
  const bad = [...results.values()].filter((result) => !result.ok).length;
  const text = results.size > 0 ? `${results.size - bad} of ${ended.length} verified${bad > 0 ? `, ${bad} not` : ""}` : "The server plays each journal again and checks every hash, act and score.";
  return { results, toggle, isRunning: running !== null, text };
}

/** @param {string} episode @param {AbortSignal} signal */
async function verify(episode, signal) {
  try {
    const answer = await request(route`/api/v1/episodes/${episode}/verification`, { signal });
    return { ok: answer.ok, text: answer.ok ? `✓ ${answer.journal_head.slice(0, 12)}` : `✗ ${answer.problem}` };
  } catch (error) {
    return { ok: false, text: error instanceof Problem ? error.message : "stopped" };
  }
}
