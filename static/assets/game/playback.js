// Playback of a game: one round after the other.
import { useEffect, useState } from "../ui.js";

/** @import { Game } from "../parts/game.js" */

/** Speeds, as multiples of two rounds per second. */
export const SPEEDS = [0.5, 1, 2, 4, 10];

const ROUND_MS = 500;

/**
 * @param {Game} game
 * @param {number} round
 * @param {(round: number) => void} go
 */
export function usePlayback(game, round, go) {
  const [isPlaying, setPlaying] = useState(false);
  const [speed, setSpeed] = useState(1);
  const isAtEnd = round >= game.last;

  useEffect(() => {
    if (!isPlaying) return;
    if (isAtEnd) return setPlaying(false);
    let isCurrent = true;
    const timer = setTimeout(async () => {
      // Wait for a round that is not read yet.
      await game.load(round + 1).catch(() => setPlaying(false));
      if (isCurrent) go(round + 1);
    }, ROUND_MS / speed);
    return () => {
      isCurrent = false;
      clearTimeout(timer);
    };
  }, [isPlaying, isAtEnd, round, speed, game]);

  /** @param {number} steps */
  const changeSpeed = (steps) => setSpeed(SPEEDS[Math.min(Math.max(SPEEDS.indexOf(speed) + steps, 0), SPEEDS.length - 1)]);
  const toggle = () => {
    if (game.first === game.last) return;
    if (!isPlaying && isAtEnd) go(game.first);
    setPlaying(!isPlaying);
  };
  return { isPlaying, speed, setSpeed, changeSpeed, toggle, stop: () => setPlaying(false) };
}
