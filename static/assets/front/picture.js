// The last rounds of a game, one after another.
import { html, useEffect, useState } from "../ui.js";
import { route } from "../api.js";
import { openGame, useMoment } from "../parts/game.js";
import { GameMap } from "../parts/map.js";
import { Text } from "../parts/text.js";
import { short } from "../parts/chart.js";

/** The number of rounds shown. */
const ROUNDS = 30;
const STEP_MS = 600;

/** @param {{game: any}} props */
export function Moving({ game }) {
  const [opened, setOpened] = useState(/** @type {import("../parts/game.js").Game | null} */ (null));
  const [round, setRound] = useState(0);
  const [isPlaying, setIsPlaying] = useState(() => !matchMedia("(prefers-reduced-motion: reduce)").matches);
  const { state, next } = useMoment(opened, round);

  useEffect(() => {
    const aborted = new AbortController();
    openGame({ kind: "episodes", id: game.id }, aborted.signal).then(
      (opened) => {
        setRound(Math.max(opened.first, opened.last - ROUNDS));
        setOpened(opened);
        opened.follow(aborted.signal).catch(() => {});
      },
      () => {},
    );
    return () => aborted.abort();
  }, []);

  useEffect(() => {
    if (!opened || !isPlaying) return;
    const timer = setInterval(() => document.hidden || setRound((round) => Math.min(round + 1, opened.last)), STEP_MS);
    return () => clearInterval(timer);
  }, [opened, isPlaying]);

  if (!opened || !state) return null;
  const again = () => {
    if (round >= opened.last) setRound(Math.max(opened.first, opened.last - ROUNDS));
    setIsPlaying(!isPlaying || round >= opened.last);
  };
  const isMoving = isPlaying && round < opened.last;
  return html`<figure>
    <a href=${route`/episodes/${game.id}`}>
      <${GameMap} head=${opened.head} state=${state} next=${next} label=${`${game.task}, round ${state.round}`} />
    </a>
    <figcaption class="small muted">
      <button type="button" class="quiet" onClick=${again}>${isMoving ? "Pause" : "Play"}</button>
      ${game.task}, round ${state.round}, score <span class="number">${short(state.score)}</span>: <${Text} value=${game.model} />
    </figcaption>
  </figure>`;
}
