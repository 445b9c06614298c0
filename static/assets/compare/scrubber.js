// The scores of both games over each other, on which a click goes to a round.
import { html, useMemo } from "../ui.js";
import { extent, short } from "../parts/chart.js";
import { color, dashes } from "../parts/colors.js";
import { useLoaded } from "../parts/load.js";

const [WIDTH, HEIGHT] = [1000, 80];
const PAD = 5;

/** The interval between reads of the curves while a game runs. */
const RELOAD_MS = 10_000;

/**
 * @param {import("../parts/game.js").Game} game
 * @param {boolean} isLive
 * @returns {[number, number][]} rounds and scores
 */
function usePoints(game, isLive) {
  const { value } = useLoaded(() => game.scores(), [game, game.head.status], isLive ? RELOAD_MS : undefined);
  return useMemo(
    () => value?.scores.map((/** @type {number} */ score, /** @type {number} */ index) => [Math.min(index * value.every, value.rounds), score]) ?? [],
    [value],
  );
}

/** @import { Appraisal, Worth } from "../parts/worth.js" */

/** @param {Worth | null} worth @returns {[number, number][]} rounds and what the reference still reaches */
const worthPoints = (worth) => (worth?.values ?? []).map((value, round) => [round, value]);

/**
 * @param {{pair: import("./pair.js").Pair, worths: Appraisal[], round: number, parting: number | null, isLive: boolean, onGo: (round: number) => void}} props
 */
export function Scrubber({ pair, worths, round, parting, isLive, onGo }) {
  const scores = [usePoints(pair.a, isLive), usePoints(pair.b, isLive)];
  const values = worths.map(({ worth }) => worthPoints(worth));
  const isExpected = worths.some(({ worth, isExpected }) => isExpected || worth?.values);
  const last = Math.max(pair.last, 1);
  const plot = { last, round, parting, onGo: (/** @type {number} */ share) => onGo(Math.round(share * pair.last)) };
  return html`<div class="curves">
    <${Plot} name="score" curves=${scores} range=${extent(scores.flat().map(([, score]) => score))} ...${plot} />
    <input
      type="range"
      min="0"
      max=${pair.last}
      value=${round}
      aria-label="Round"
      aria-valuetext=${`round ${round} of ${pair.last}`}
      onInput=${(/** @type {any} */ event) => onGo(Number(event.target.value))}
    />
    ${isExpected && html`<${Plot} name="worth" curves=${values} range=${extent([0, ...[...values, ...scores].flat().map(([, value]) => value)])} ...${plot} />`}
    <p class="small muted">
      ${["A", "B"].map((name, index) => html`<span class="legend">
        <svg width="24" height="8" aria-hidden="true"><line x1="0" x2="24" y1="4" y2="4" stroke=${color(index)} stroke-dasharray=${dashes(index)} stroke-width="2" /></svg>
        ${isExpected ? "score and worth" : "score"} of ${name}
      </span>`)}
      ${parting !== null && html`<span class="legend"><svg width="8" height="14" aria-hidden="true"><line class="parting" x1="4" x2="4" y1="0" y2="14" /></svg> they part</span>`}
    </p>
    ${isExpected && html`<p class="small muted">Worth is the score that the reference reaches from a state on all seats.</p>`}
  </div>`;
}

/**
 * Curves of both games over each other.
 * @param {{name: string, curves: [number, number][][], range: [number, number], last: number, round: number, parting: number | null,
 *   onGo: (share: number) => void}} props
 */
function Plot({ name, curves, range: [low, high], last, round, parting, onGo }) {
  const x = (/** @type {number} */ at) => (at / last) * WIDTH;
  const y = (/** @type {number} */ value) => HEIGHT - PAD - ((value - low) / (high - low)) * (HEIGHT - 2 * PAD);
  /** @param {[number, number][]} points */
  const path = (points) => points.map(([at, value], index) => `${index ? "L" : "M"}${x(at).toFixed(1)} ${y(value).toFixed(1)}`).join("");
  /** @param {MouseEvent} event */
  const clicked = (event) => {
    const box = /** @type {Element} */ (event.currentTarget).getBoundingClientRect();
    onGo((event.clientX - box.left) / box.width);
  };
  return html`<div class="plot" onClick=${clicked}>
    <svg viewBox=${`0 0 ${WIDTH} ${HEIGHT}`} preserveAspectRatio="none" aria-hidden="true">
      ${parting !== null && html`<line class="parting" x1=${x(parting)} x2=${x(parting)} y1="0" y2=${HEIGHT} />`}
      ${curves.map((points, index) => html`<path d=${path(points)} stroke=${color(index)} stroke-dasharray=${dashes(index)} />`)}
      <line class="now" x1=${x(round)} x2=${x(round)} y1="0" y2=${HEIGHT} />
    </svg>
    <span class="high" aria-hidden="true">${short(high)}</span>
    <span class="low" aria-hidden="true">${name} ${short(low)}</span>
  </div>`;
}
