// The choice of two games to compare.
import { html, useState } from "../ui.js";
import { visit } from "../app.js";
import { request, withQuery } from "../api.js";
import { short } from "../parts/chart.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { Text, visible } from "../parts/text.js";
import { readId } from "./pair.js";

/** The numbers of games that are read, and that are shown. */
const READ = 100;
const LISTED = 25;

/** @param {string} a @param {string} b */
export const addressOf = (a, b) => withQuery("/compare", { a, b });

/** @param {{a: string, b: string}} props */
export function Choose({ a, b }) {
  const [ids, setIds] = useState({ a, b });
  /** @param {Event} event */
  const submitted = (event) => {
    event.preventDefault();
    visit(addressOf(readId(ids.a), readId(ids.b)));
  };
  const field = (/** @type {"a" | "b"} */ name) => html`<label
    >Game ${name.toUpperCase()}
    <input
      required
      spellcheck="false"
      autocomplete="off"
      placeholder="id or link"
      value=${ids[name]}
      onInput=${(/** @type {any} */ event) => setIds({ ...ids, [name]: event.target.value })}
    />
  </label>`;
  return html`<form class="choose" onSubmit=${submitted}>
    ${field("a")} ${field("b")}
    <p class="buttons">
      <button type="submit" class="primary">Compare</button>
      <button type="button" onClick=${() => (a && b ? visit(addressOf(b, a)) : setIds({ a: ids.b, b: ids.a }))}><kbd>x</kbd> Swap</button>
    </p>
  </form>`;
}

/** Games that are worth comparing: with a game, or any. @param {{a: string}} props */
export function Suggestions({ a }) {
  const { value, problem, reload } = useLoaded(async (signal) => candidates(a, signal), [a]);
  if (problem) return html`<${ProblemNote} problem=${problem} retry=${reload} what="Games to compare" />`;
  if (!value) return html`<p class="muted" role="status">Loading …</p>`;
  if (value.length === 0) {
    return html`<p class="empty">No finished game fits. <a href="/play">Play one</a>, or enter the id or link of any game above.</p>`;
  }
  return html`<h2>${a ? "Games of the same task and seed come first" : "Newest games"}</h2>
    <ul class="suggestions">
      ${value.slice(0, LISTED).map(
        (game) => html`<li key=${game.id}>
          <a href=${addressOf(a || game.id, a ? game.id : "")}>${a ? "Compare with" : "Choose"} ${game.task}, seed ${game.config.seed ?? "unknown"}</a>
          ${" "}by <${Text} value=${game.model} />, <span class="number">${short(game.score)}</span>
        </li>`,
      )}
    </ul>`;
}

/** @param {string} a @param {AbortSignal} signal @returns {Promise<any[]>} */
async function candidates(a, signal) {
  const list = (/** @type {object} */ query) => request(withQuery("/api/v1/episodes", { limit: READ, status: "finished", ...query }), { signal });
  if (!a.startsWith("ep_")) return (await list({})).items;
  const game = await request(`/api/v1/episodes/${encodeURIComponent(a)}`, { signal });
  const { items } = await list({ task: game.task });
  const isOfSeed = (/** @type {any} */ other) => other.config.seed === game.config.seed && game.config.seed !== null;
  return items.filter((/** @type {any} */ other) => other.id !== a).sort((/** @type {any} */ x, /** @type {any} */ y) => Number(isOfSeed(y)) - Number(isOfSeed(x)));
}

/** A game in one line, for titles. @param {import("../parts/game.js").Game} game */
export const nameOf = ({ head, summary }) => `${head.task} by ${visible(summary.model)}`;
