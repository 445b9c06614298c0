// The choice of two games to compare.
import { html, submits, useState } from "../ui.js";
import { visit } from "../app.js";
import { request, route, withQuery } from "../api.js";
import { short } from "../parts/chart.js";
import { Loaded, useLoaded } from "../parts/load.js";
import { Text, visible } from "../parts/text.js";
import { readId } from "./pair.js";

/** The numbers of games that are read, and that are shown. */
const [READ, LISTED] = [100, 25];

/** @param {string} a @param {string} b */
export const addressOf = (a, b) => withQuery("/compare", { a, b });

/** @param {{a: string, b: string}} props */
export function Choose({ a, b }) {
  const [ids, setIds] = useState({ a, b });
  const field = (/** @type {"a" | "b"} */ name) => html`<label>Game ${name.toUpperCase()}
    <input required spellcheck="false" autocomplete="off" placeholder="id or link"
      value=${ids[name]} onInput=${(event) => setIds({ ...ids, [name]: event.target.value })} />
  </label>`;
  return html`<form class="choose" onSubmit=${submits(() => visit(addressOf(readId(ids.a), readId(ids.b))))}>
    ${field("a")} ${field("b")}
    <p class="buttons">
      <button type="submit" class="primary">Compare</button>
      <button type="button" onClick=${() => (a && b ? visit(addressOf(b, a)) : setIds({ a: ids.b, b: ids.a }))}><kbd>x</kbd> Swap</button>
    </p>
  </form>`;
}

/** Games that are worth comparing: with a game, or any. @param {{a: string}} props */
export function Suggestions({ a }) {
  const games = useLoaded((signal) => candidates(a, signal), [a]);
  return html`<${Loaded} of=${games} what="Games to compare">${(found) => found.length === 0
    ? html`<p class="empty">No finished game fits. <a href="/play">Play one</a>, or enter the id or link of any game above.</p>`
    : html`<h2>${a ? "Games of the same task and seed come first" : "Newest games"}</h2>
      <ul class="suggestions">
        ${found.slice(0, LISTED).map((game) => html`<li key=${game.id}>
          <a href=${addressOf(a || game.id, a ? game.id : "")}>${a ? "Compare with" : "Choose"} ${game.task}, seed ${game.config.seed ?? "unknown"}</a>
          ${" "}by <${Text} value=${game.model} />, <span class="number">${short(game.score)}</span>
        </li>`)}
      </ul>`}<//>`;
}

/** @param {string} a @param {AbortSignal} signal @returns {Promise<any[]>} */
async function candidates(a, signal) {
  const game = a.startsWith("ep_") ? await request(route`/api/v1/episodes/${a}`, { signal }) : null;
  const { items } = await request(withQuery("/api/v1/episodes", { limit: READ, status: "finished", task: game?.task }), { signal });
  const isOfSeed = (other) => Number(other.config.seed === game?.config.seed && other.config.seed !== null);
  return items.filter((other) => other.id !== a).sort((one, other) => isOfSeed(other) - isOfSeed(one));
}

/** A game in one line, for titles. @param {import("../parts/game.js").Game} game */
export const nameOf = ({ head, summary }) => `${head.task} by ${visible(summary.model)}`;
