// The player of a game, or of two in step: playback, keys, and controls.
import { html, useEffect, useState } from "../ui.js";
import { Menu } from "../parts/menu.js";
import { usePart } from "../parts/load.js";
import { useKeys } from "./keys.js";

/** Speeds, as multiples of two rounds per second. */
const SPEEDS = [0.5, 1, 2, 4, 10];

const ROUND_MS = 500;

/** The pause at a round before it is announced: passing rounds are not. */
const ANNOUNCE_MS = 500;

/** @typedef {ReturnType<typeof usePlayer>} Player */

/**
 * @param {object} options
 * @param {{load: (round: number) => Promise<unknown>}} options.game
 * @param {number} options.round the one that is shown
 * @param {number} options.first
 * @param {number} options.last the last round that can be shown
 * @param {number} options.agent
 * @param {number} options.agents how many there are
 * @param {(round: number) => void} options.onRound gets a round of the game
 * @param {(agent: number) => void} options.onAgent
 * @param {(direction: 1 | -1) => unknown} options.onMark
 * @param {string} options.mark what is sought: "mark" or "difference"
 * @param {import("./keys.js").Keys} options.keys of the page besides
 * @param {typeof import("./parts.js").PARTS} options.parts
 */
export function usePlayer({ game, round, first, last, agent, agents, onRound, onAgent, onMark, mark, keys: own, parts }) {
  const [isPlaying, setPlaying] = useState(false);
  const [speed, setSpeed] = useState(1);
  const [isHelped, setHelped] = useState(false);
  const isAtEnd = round >= last;
  useEffect(() => {
    if (!isPlaying) return;
    if (isAtEnd) return setPlaying(false);
    let isCurrent = true;
    const timer = setTimeout(async () => {
      // Wait for a round that is not read yet.
      await game.load(round + 1).catch(() => setPlaying(false));
      if (isCurrent) onRound(round + 1);
    }, ROUND_MS / speed);
    return () => {
      isCurrent = false;
      clearTimeout(timer);
    };
  }, [isPlaying, isAtEnd, round, speed, game]);

  const stop = () => setPlaying(false);
  const jump = (/** @type {number} */ to) => {
    stop();
    onRound(Math.min(Math.max(to, first), last));
  };
  const toggle = () => {
    if (first === last) return;
    if (!isPlaying && isAtEnd) onRound(first);
    setPlaying(!isPlaying);
  };
  const faster = (/** @type {number} */ steps) => setSpeed(SPEEDS[Math.min(Math.max(SPEEDS.indexOf(speed) + steps, 0), SPEEDS.length - 1)]);
  const choose = (/** @type {number} */ agent) => onAgent(Math.min(Math.max(agent, 0), agents - 1));
  const help = () => setHelped(true);
  /** @type {import("./keys.js").Keys} */
  const keys = {
    ArrowLeft: () => jump(round - 1),
    ArrowRight: () => jump(round + 1),
    "Shift+ArrowLeft": () => jump(round - 10),
    "Shift+ArrowRight": () => jump(round + 10),
    Home: () => jump(first),
    End: () => jump(last),
    " ": toggle,
    ",": () => faster(-1),
    ".": () => faster(1),
    n: () => void onMark(1),
    p: () => void onMark(-1),
    "[": () => choose(agent - 1),
    "]": () => choose(agent + 1),
    "?": help,
    ...Object.fromEntries(Array.from({ length: Math.min(10, agents) }, (_, n) => [String(n), () => choose(n)])),
    ...own,
  };
  useKeys(keys);
  return { round, first, last, mark, isPlaying, speed, setSpeed, toggle, stop, jump, onMark, help, isHelped, onHelped: () => setHelped(false), keys, parts };
}

/** @type {Record<string, string>} */
const ICONS = {
  back: "M4 3V13M13 3L6 8L13 13Z",
  play: "M4 2.5L13 8L4 13.5Z",
  pause: "M4 3H6.5V13H4ZM9.5 3H12V13H9.5Z",
  next: "M12 3V13M3 3L10 8L3 13Z",
  markBefore: "M10 4L14 12H6ZM5 5L2 8L5 11",
  nextMark: "M6 4L10 12H2ZM11 5L14 8L11 11",
  more: "M3 7H5V9H3ZM7 7H9V9H7ZM11 7H13V9H11Z",
};

/** An icon with its word. @param {{icon: string, word: string}} props */
const Tool = ({ icon, word }) => html`<svg viewBox="0 0 16 16" width="16" height="16" aria-hidden="true"><path d=${ICONS[icon]} /></svg><span>${word}</span>`;

/**
 * The controls of a player, with a menu of what one can do with the moment.
 * @param {{player: Player, canMark: (direction: 1 | -1) => boolean, menu: unknown, children?: unknown}} props children: facts of the moment
 */
export function Controls({ player, canMark, menu, children }) {
  const later = usePart(player.parts.later, player.isHelped);
  const { round, first, last, mark, isPlaying, speed, setSpeed, toggle, jump, onMark } = player;
  const [word, before, after] = mark === "difference" ? ["Differ", "Where they differ, before", "Where they differ, next"] : ["Mark", "Mark before", "Next mark"];
  return html`<div class="controls">
    <div class="transport" role="group" aria-label="Rounds">
      <button type="button" onClick=${() => jump(round - 1)} aria-disabled=${round <= first}><${Tool} icon="back" word="Back" /></button>
      <button type="button" class="primary" onClick=${toggle} aria-disabled=${first === last}><${Tool} ...${isPlaying ? { icon: "pause", word: "Pause" } : { icon: "play", word: "Play" }} /></button>
      <button type="button" onClick=${() => jump(round + 1)} aria-disabled=${round >= last}><${Tool} icon="next" word="Next" /></button>
      <button type="button" onClick=${() => onMark(-1)} aria-label=${before} title=${before} aria-disabled=${!canMark(-1)}><${Tool} icon="markBefore" word=${word} /></button>
      <button type="button" onClick=${() => onMark(1)} aria-label=${after} title=${after} aria-disabled=${!canMark(1)}><${Tool} icon="nextMark" word=${word} /></button>
      <label><select onChange=${(event) => setSpeed(Number(event.currentTarget.value))}>
        ${SPEEDS.map((one) => html`<option value=${one} selected=${one === speed}>${one}×</option>`)}
      </select><span>Speed</span></label>
      <${Menu} label=${html`<${Tool} icon="more" word="Share" />`} name="Share and more">${menu}<//>
    </div>
    <p class="now">${children}</p>
    ${later && player.isHelped && html`<${later.KeyHelp} keys=${player.keys} mark=${mark} onClose=${player.onHelped} />`}
  </div>`;
}

/**
 * Switches of what is shown, apart from what moves through the rounds.
 * @param {{player: Player, toggles: [string, boolean, () => void][]}} props names, whether they are on, and what switches them
 */
export const Toggles = ({ player, toggles }) => html`<div class="toggles" role="group" aria-label="What is shown">
  ${toggles.map(([words, isOn, toggle]) => html`<button type="button" aria-pressed=${isOn} onClick=${toggle}>${words}</button>`)}
  <button type="button" class="quiet" onClick=${player.help}>Keys ?</button>
</div>`;

/** Announces to screen readers what is shown, once it rests. @param {{text: string}} props */
export function Announcer({ text }) {
  const [said, setSaid] = useState("");
  useEffect(() => {
    const timer = setTimeout(() => setSaid(text), ANNOUNCE_MS);
    return () => clearTimeout(timer);
  }, [text]);
  return html`<p class="unseen" aria-live="polite">${said}</p>`;
}
