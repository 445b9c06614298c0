// Metrics of the rounds around the shown one.
import { html, useMemo, useState } from "../ui.js";
import { remember, remembered } from "../api.js";
import { extent, linePath, short } from "../parts/chart.js";

/** @import { Game } from "../parts/game.js" */

/** The maximum number of curves. */
const CURVES = 3;

/** The metrics that are shown first, if a game has them. */
const FIRST = ["polarization", "stillness", "blocked_share", "light_agreement", "components", "step_length"];

const [WIDTH, HEIGHT] = [300, 36];

/** @param {string} name */
const inWords = (name) => name.replaceAll("_", " ");

/** @param {{game: Game, round: number}} props */
export function Metrics({ game, round }) {
  const [chosen, setChosen] = useState(() => remembered("metrics")?.split(",") ?? null);
  const piece = game.piece(round);
  const names = Object.keys(piece?.metrics ?? {}).filter((name) => piece?.metrics[name].some((value) => value !== null));
  if (!piece || names.length === 0) return null;
  const first = [...FIRST.filter((name) => names.includes(name)), ...names.filter((name) => !FIRST.includes(name))];
  const shown = (chosen?.filter((name) => names.includes(name)) ?? first).slice(0, CURVES);
  /** @param {number} index @param {string} name */
  const choose = (index, name) => {
    const now = shown.map((one, at) => (at === index ? name : one));
    setChosen(now);
    remember("metrics", now.join(","));
  };
  return html`<div class="metrics" role="group" aria-label="Metrics">
    ${shown.map(
      (name, index) => html`<div>
        <div class="metric-head">
          <select aria-label=${`Metric ${index + 1}`} onChange=${(event) => choose(index, event.currentTarget.value)}>
            ${names.map((one) => html`<option value=${one} selected=${one === name}>${inWords(one)}</option>`)}
          </select>
          <span class="number">${short(piece.metrics[name][round - piece.from])}</span>
        </div>
        <${MetricCurve} values=${piece.metrics[name]} at=${round - piece.from} />
      </div>`,
    )}
  </div>`;
}

/** @param {{values: (number | null)[], at: number}} props */
function MetricCurve({ values, at }) {
  const last = Math.max(values.length - 1, 1);
  const x = (/** @type {number} */ index) => (index / last) * WIDTH;
  const path = useMemo(() => {
    const [low, high] = extent(values);
    return linePath(values, x, (value) => HEIGHT - 3 - ((value - low) / (high - low)) * (HEIGHT - 6));
  }, [values]);
  return html`<svg viewBox=${`0 0 ${WIDTH} ${HEIGHT}`} preserveAspectRatio="none" aria-hidden="true">
    <path class="metric" d=${path} />
    <line class="now" x1=${x(at)} x2=${x(at)} y1="0" y2=${HEIGHT} />
  </svg>`;
}
