// The times of a competition: opening, freeze, close, reveal.
import { html } from "../ui.js";
import { Text } from "../parts/text.js";
import { Countdown, Time, duration } from "../parts/time.js";

/** Phases in words for visitors. */
const MEANING = {
  announced: "Nobody can play yet. One can enter.",
  open: "Attempts can be started and played.",
  closing: "No round begins any more. The last ones have their whole clock, then everything is revealed.",
  closed: "Seeds, games and the board are public. Anybody can check them.",
  cancelled: "The organizer has ended it early. Nobody plays any more; its seeds are published at the time at which it would have closed.",
};

/** The number of windows above which they have a list of their own. */
const WINDOWS_SHOWN = 3;

/** The difference above which a computer's clock is misleading. */
const CLOCK_DIFFERENCE_MS = 5000;

/**
 * @param {{competition: any, aheadMs: number, firstEnds: Map<string, string>}} props aheadMs: by how much this computer's clock is
 *   ahead of the server's; firstEnds: of what was extended
 */
export function Phases({ competition, aheadMs, firstEnds }) {
  const { phase } = competition;
  const next = phase === "announced" ? ["Opens", competition.opens_at] : phase === "open" ? ["Closes", competition.closes_at] : null;
  return html`
    <p class="phase">
      <strong>${phase[0].toUpperCase() + phase.slice(1)}.</strong> ${MEANING[phase]}
      ${competition.cancel_reason && html`<br />The reason: <${Text} value=${competition.cancel_reason} />`}
      ${next && html`<br />${next[0]} <span class="large"><${Countdown} value=${next[1]} /></span>`}
    </p>
    ${Math.abs(aheadMs) > CLOCK_DIFFERENCE_MS &&
    html`<p class="bad">
      The clock of this computer is ${duration(Math.abs(aheadMs))} ${aheadMs > 0 ? "ahead of" : "behind"} the server's. The server's counts.
    </p>`}
    <ol class="moments">
      ${momentsOf(competition).map(
        ({ name, at, isPast, isNext, field }) => html`<li class=${isPast ? "past" : ""} aria-current=${isNext ? "step" : undefined}>
          <span>${name}${isPast && html`<span class="unseen"> (past)</span>`}</span>
          <span>${at ? html`<${Time} value=${at} both />` : "when the last game has ended"}${field && html`<${Extended} from=${firstEnds.get(field)} />`}</span>
        </li>`,
      )}
    </ol>
    ${hasWindows(competition) &&
    competition.attempts.length > WINDOWS_SHOWN &&
    html`<details>
      <summary>Windows of ${competition.attempts.length} attempts</summary>
      <ol>${competition.attempts.map((window, index) => html`<li>from <${Time} value=${window.opens_at} both /> to <${Time} value=${window.closes_at} both /><${Extended} from=${firstEnds.get(endOf(index))} /></li>`)}</ol>
    </details>`}
  `;
}

/** The name of the end of a window in the API. @param {number} index */
const endOf = (index) => `attempts[${index}].closes_at`;

/** @param {{from?: string}} props from: the end at first */
const Extended = ({ from }) => from && html` <span class="badge">extended</span> <span class="small">at first <${Time} value=${from} /></span>`;

/** Whether attempts have windows of their own. @param {any} competition */
const hasWindows = ({ attempts, opens_at, closes_at }) =>
  attempts.some((window) => window.opens_at !== opens_at || window.closes_at !== closes_at);

/** @param {any} competition */
function momentsOf(competition) {
  const { attempts, opens_at, closes_at } = competition;
  const showsWindows = hasWindows(competition) && attempts.length <= WINDOWS_SHOWN;
  /** @type {{name: string, at: string, field?: string}[]} */
  const moments = [
    { name: "Announced, with the commitment", at: competition.created_at },
    { name: "Opens", at: opens_at },
    ...(showsWindows ? attempts.flatMap((window, index) => windowMoments(window, index + 1)) : []),
    ...(competition.board_freezes_at ? [{ name: "Board freezes", at: competition.board_freezes_at }] : []),
    competition.cancelled_at
      ? { name: "Would have closed", at: closes_at, field: "closes_at" }
      : { name: "Closes: no round begins any more", at: closes_at, field: "closes_at" },
    ...(competition.cancelled_at ? [{ name: "Cancelled", at: competition.cancelled_at }] : []),
  ].sort((a, b) => a.at.localeCompare(b.at));
  const all = [...moments, { name: "Revealed", at: competition.revealed_at, field: undefined }];
  const now = new Date().toISOString();
  const next = all.findIndex(({ at }) => !at || at > now);
  return all.map((moment, index) => ({ ...moment, isPast: next < 0 || index < next, isNext: index === next }));
}

/** @param {{opens_at: string, closes_at: string}} window @param {number} number */
const windowMoments = (window, number) => [
  { name: `Attempt ${number} opens`, at: window.opens_at },
  { name: `Attempt ${number} closes`, at: window.closes_at, field: endOf(number - 1) },
];
