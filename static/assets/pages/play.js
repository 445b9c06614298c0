// The page on which people start a game, or take a seat in one.
import { html } from "../ui.js";
import { remembered, request, withQuery } from "../api.js";
import { useLoaded } from "../parts/load.js";
import { NewGame, NewRun } from "../play/newgame.js";
import { ProblemNote } from "../parts/problem.js";
import { EnterCode } from "../play/take.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

const AGAIN_MS = 5000;
const LISTED = 50;

/** @param {{query: URLSearchParams}} props */
export function Page({ query }) {
  return html`<h1>Play</h1>
    <p>
      You hold a seat of a swarm and see what its agent sees: a small window, the messages of neighbours, nothing else. After the end
      you see the whole game.
    </p>
    <div class="play">
      <${NewGame} query=${query} />
      <div>
        <${OpenGames} />
        <${EnterCode} />
        <${NewRun} />
      </div>
    </div>`;
}

/** The games that wait for holders of their seats. */
function OpenGames() {
  const { value, problem, reload } = useLoaded(
    (signal) => request(withQuery("/api/v1/episodes", { status: "waiting", limit: LISTED }), { signal }),
    [],
    AGAIN_MS,
  );
  const games = value?.items.filter((/** @type {any} */ game) => game.config.open_seats > 0) ?? [];
  return html`<h2>Games with open seats</h2>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    ${value && games.length === 0 && html`<p class="empty">None now. Start one with “People and programs”, and others find it here.</p>`}
    ${games.length > 0 &&
    html`<ul class="open-games">
      ${games.map(
        (/** @type {any} */ game) => html`<li key=${game.id}>
          <a href=${`/play/${encodeURIComponent(game.id)}`}>${remembered(`token:${game.id}`) ? "Back to your seat" : "Take a seat"}</a>
          ${" "}in ${game.task}, ${game.config.num_agents} agents, by <${Text} value=${game.model} />
          <span class="muted"> · <${Time} value=${game.created_at} /></span>
        </li>`,
      )}
    </ul>`}`;
}
