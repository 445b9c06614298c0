// A game that plays by itself, from its start to its end and again; without one of the server, a game that comes with the pages.
import { html, useEvery, useState } from "../ui.js";
import { request } from "../api.js";
import { useMoment } from "../parts/game.js";
import { useLoaded } from "../parts/load.js";
import { GameMap } from "../parts/map.js";
import { PackedGame } from "../parts/packed.js";
import { openGame } from "../parts/served.js";
import { Text } from "../parts/text.js";
import { short } from "../parts/chart.js";

/** The number of rounds before the end from which a long game plays. */
const ROUNDS = 60;

/** The time of a step, and the number of steps at the end before it plays again. */
const [STEP_MS, REST_STEPS] = [600, 4];

/** @param {any} game a summary, or null @param {AbortSignal} signal @returns {Promise<import("../parts/game.js").Game>} */
async function opened(game, signal) {
  if (!game) return new PackedGame(await request(new URL("./game.json", import.meta.url).href, { token: null, signal }));
  const found = await openGame(game.id, signal);
  found.follow(signal).catch(() => {});
  return found;
}

/** @param {{game: any}} props */
export function Moving({ game }) {
  const { value: shown } = useLoaded((signal) => opened(game, signal), []);
  const [isPlaying, setPlaying] = useState(() => !matchMedia("(prefers-reduced-motion: reduce)").matches);
  // A game that stands shows its newest round.
  const [step, setStep] = useState(isPlaying ? 0 : Infinity);
  const first = shown ? Math.max(shown.first, shown.last - ROUNDS) : 0;
  useEvery(shown && isPlaying ? STEP_MS : null, () => setStep(first + step >= Number(shown?.last) + REST_STEPS ? 0 : step + 1));
  const round = shown ? Math.min(first + step, shown.last) : 0;
  const { state, next } = useMoment(shown, round);
  if (!shown || !state) return null;
  const { head, summary } = shown;
  return html`<figure>
    <${GameMap} head=${head} state=${state} next=${next} label=${`${head.task}, round ${state.round}`} />
    <figcaption class="small muted">
      <button type="button" class="quiet" onClick=${() => setPlaying(!isPlaying)}>${isPlaying ? "Pause" : "Move"}</button>
      ${head.status === "running" && html`<span class="badge good">live</span> `}${!game && "Example: "}
      <b>${head.task}</b> · <${Text} value=${summary.model} /> · round${" "}
      <span class="number">${state.round}</span> · score <span class="number">${short(state.score)}</span>
    </figcaption>
  </figure>`;
}

