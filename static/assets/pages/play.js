// The page on which people start a game, or take a seat in one.
import { html } from "../ui.js";
import { remembered, request, route, withQuery } from "../api.js";
import { Loaded, useLoaded } from "../parts/load.js";
import { NewGame, NewRun } from "../play/newgame.js";
import { EnterCode } from "../play/take.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

const [AGAIN_MS, LISTED] = [5000, 50];

/** @param {{query: URLSearchParams}} props */
export function Page({ query }) {
  return html`<h1>Play</h1>
    <p>
      You hold a seat of a swarm and see what its agent sees: a small window, the messages of neighbours, nothing else. After the end
      you see the whole game.
    </p>
    <div class="play">
      <${NewGame} query=${query} />
      <div><${OpenGames} /> <${EnterCode} /> <${NewRun} /></div>
    </div>`;
}

/** The games that wait for holders of their seats. */
function OpenGames() {
  const waiting = useLoaded((signal) => request(withQuery("/api/v1/episodes", { status: "waiting", limit: LISTED }), { signal }), [], AGAIN_MS);
  const games = waiting.value?.items.filter((game) => game.config.open_seats > 0) ?? [];
  return html`<h2>Games with open seats</h2>
    <${Loaded} of=${waiting}>${() => games.length === 0
      ? html`<p class="empty">None now. Start one with “People and programs”, and others find it here.</p>`
      : html`<ul class="open-games">
          ${games.map(({ id, task, config, model, created_at: createdAt }) => html`<li key=${id}>
            <a href=${route`/play/${id}`}>${remembered(`token:${id}`) ? "Back to your seat" : "Take a seat"}</a>
            ${" "}in ${task}, ${config.num_agents} agents, by <${Text} value=${model} /> <span class="muted"> · <${Time} value=${createdAt} /></span>
          </li>`)}
        </ul>`}<//>`;
}
