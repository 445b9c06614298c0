// What a competition is: its phase and times, texts of its organizers, settings, and commitment.
import { html } from "../ui.js";
import { Copyable } from "../parts/copy.js";
import { duration } from "../parts/duration.js";
import { More } from "../parts/pages.js";
import { rulesText, seedsOf, settingsText, tieBreaksText } from "../parts/rules.js";
import { Facts } from "../parts/table.js";
import { TASKS } from "../parts/tasks.js";
import { Lines, Text, visible } from "../parts/text.js";
import { Countdown, Time } from "../parts/time.js";

/** Phases in words for visitors. */
const MEANING = {
  announced: "Entry is open; nobody can play yet.",
  open: "Entrants play their attempts.",
  closing: "No round begins any more. The last ones have their whole clock, then everything is revealed.",
  closed: html`Seeds, games and the board are public. <a href="#verify">Anybody can check them</a>.`,
  cancelled: "The organizer has ended it early. Nobody plays any more; its seeds are published at the time at which it would have closed.",
};

/** The difference above which a computer's clock is misleading. */
const CLOCK_DIFFERENCE_MS = 5000;

/** The phase, and the time until the next one. @param {{competition: any, aheadMs: number}} props aheadMs: by how much this computer's clock is ahead of the server's */
export function Phase({ competition, aheadMs }) {
  const { phase, cancel_reason, opens_at, closes_at } = competition;
  const next = phase === "announced" ? ["Opens", opens_at] : phase === "open" ? ["Closes", closes_at] : null;
  return html`
    <p class="phase">
      <strong>${phase[0].toUpperCase() + phase.slice(1)}.</strong> ${MEANING[phase]}
      ${cancel_reason && html`<br />The reason: <${Text} value=${cancel_reason} />`}
      ${next && html`<br />${next[0]} <span class="large"><${Countdown} value=${next[1]} isAhead /></span> <span class="muted"><${Time} value=${next[1]} both /></span>`}
    </p>
    ${Math.abs(aheadMs) > CLOCK_DIFFERENCE_MS &&
    html`<p class="bad">The clock of this computer is ${duration(Math.abs(aheadMs))} ${aheadMs > 0 ? "ahead of" : "behind"} the server's. The server's counts.</p>`}
  `;
}

/** The number of windows above which they have a list of their own. */
const WINDOWS_SHOWN = 3;

/** The name of the end of a window in the API. @param {number} place */
const endOf = (place) => `attempts[${place}].closes_at`;

/** All moments in their order. @param {{competition: any, firstEnds: Map<string, string>}} props firstEnds: of what was extended */
export function Moments({ competition, firstEnds }) {
  const { attempts, created_at, opens_at, closes_at, board_freezes_at, cancelled_at, revealed_at } = competition;
  const windows = attempts.flatMap((window, place) => [
    { name: `Attempt ${place + 1} opens`, at: window.opens_at },
    { name: `Attempt ${place + 1} closes`, at: window.closes_at, end: endOf(place) },
  ]);
  const hasWindows = windows.some(({ at }) => at !== opens_at && at !== closes_at);
  const isLong = attempts.length > WINDOWS_SHOWN;
  const moments = [
    { name: "Announced, with the commitment", at: created_at },
    { name: "Opens", at: opens_at },
    ...(hasWindows && !isLong ? windows : []),
    { name: "Board freezes", at: board_freezes_at },
    { name: cancelled_at ? "Would have closed" : "Closes: no round begins any more", at: closes_at, end: "closes_at" },
    { name: "Cancelled", at: cancelled_at },
  ];
  const all = [...moments.filter(({ at }) => at).sort((a, b) => a.at.localeCompare(b.at)), { name: "Revealed", at: revealed_at }];
  const now = new Date().toISOString();
  const next = all.findIndex(({ at }) => !at || at > now);
  const isPast = (/** @type {number} */ place) => next < 0 || place < next;
  const extended = (/** @type {string} */ end) =>
    firstEnds.has(end) && html` <span class="badge">extended</span> <span class="small">at first <${Time} value=${firstEnds.get(end)} /></span>`;
  return html`<ol class="moments">
      ${all.map(
        ({ name, at, end }, place) => html`<li class=${isPast(place) ? "past" : ""} aria-current=${place === next ? "step" : undefined}>
          <span>${name}${isPast(place) && html`<span class="unseen"> (past)</span>`}</span>
          <span>${at ? html`<${Time} value=${at} both />` : "when the last game has ended"}${extended(end)}</span>
        </li>`,
      )}
    </ol>
    ${hasWindows && isLong && html`<details>
      <summary>Windows of ${attempts.length} attempts</summary>
      <ol>${attempts.map((window, place) => html`<li>from <${Time} value=${window.opens_at} both /> to <${Time} value=${window.closes_at} both />${extended(endOf(place))}</li>`)}</ol>
    </details>`}`;
}

const COUNTS = { best: "the best one (of equal ones the first)", last: "the last one that was started", first: "the first one" };
const BOARDS = {
  public: "Ranks and totals are public. Scores of single tasks and games are not.",
  hidden: "The board is hidden.",
  frozen: "The board is public until it freezes.",
};
const CLOSING = `The server's clock counts. From this moment on no round, game or attempt begins. A round that is open has its whole clock, then its game
  ends. An unfinished attempt counts with what it has. If the server is down at that moment, it closes when it is back.`;

/** @param {{competition: any}} props */
export function Rules({ competition }) {
  const { attempts, attempts_per_day, board, categories, clocks, counts, entries_per_key, entry, own_games, parallel, spares, suite, tie_breaks } = competition;
  const tasks = suite.tasks ?? TASKS;
  const { seeds, publicSeeds } = seedsOf(competition);
  const others = seeds - publicSeeds;
  const [round, bank, idle] = [clocks.round_deadline_s, clocks.bank_s, clocks.idle_timeout_s].map((seconds) => duration(seconds * 1000));
  const facts = [
    ["An attempt", html`${tasks.length * seeds} games: <${Text} value=${tasks.join(", ")} />, each on ${seeds} sealed ${seeds === 1 ? "seed" : "seeds"}${
      competition.seeds_by_task && " of its own"}. ${parallel} are open at a time.`],
    ["Attempts", html`${attempts.length}. Attempt <i>n</i> has the same seeds for all, and no other attempt has these.${
      attempts_per_day && ` An entrant may start ${attempts_per_day} on one day (UTC).`}`],
    spares > 0 && ["Voided attempts", `are played again on other sealed seeds, ${spares} of them at most.`],
    ["What counts", `${COUNTS[counts]}. A game that was not played counts as 0.`],
    ["Equal totals", tie_breaks.length > 0 ? `${tieBreaksText(tie_breaks)}. Who is equal in all of it shares a rank.` : "share a rank."],
    publicSeeds > 0 && ["Seeds of the board", `Until it closes ${publicSeeds} of ${seeds}, then the other ${others === 1 ? "one" : others}.`],
    ["Clock", `${round} for a round${clocks.bank_s > 0 ? `, and ${bank} in a game on top` : ""}. A game without an act for ${idle} is abandoned.`],
    ["Entry", html`${entry === "codes" ? "with an invitation code from the organizer" : "for everybody"}. A key can have ${entries_per_key} ${
      entries_per_key === 1 ? "entrant" : "entrants"}.`],
    categories.length > 0 && ["Categories", categories.map((name, place) => html`${place > 0 && ", "}<${Text} value=${name} />`)],
    ["Before the end", html`${BOARDS[board]}${own_games === "ended" && " Entrants read their own games once the window of the attempt has closed."}`],
    ["Rules", rulesText(suite.rules)],
    ["Games", `${settingsText(suite.settings ?? {})}.`],
    ["The closing moment", CLOSING],
  ];
  return html`<${Facts} facts=${facts} />`;
}

/** @param {{competition: any}} props */
export const Commitment = ({ competition: { commitment, salt, seeds } }) => html`
  <p>
    The commitment is a hash of a secret salt and all seeds. It was published before anybody played: if the seeds that are
    revealed at the end fit it, nobody exchanged one.${!salt && " Note it now, to compare it then."}
  </p>
  <p><${Copyable} value=${commitment} label="the commitment" /></p>
  ${salt && html`<details>
    <summary>Salt and ${seeds.length} seeds</summary>
    <p>Salt: <code class="foreign">${salt}</code></p>
    <ol class="seeds">${seeds.map((seed) => html`<li><code>${seed}</code></li>`)}</ol>
  </details>`}
`;

/** A longer text scrolls, so that the content below stays near. */
const SHOWN_CHARS = 800;

/** A text of organizers with its line breaks: a description, or terms. @param {{text: string, label: string}} props label: for those who hear that it scrolls */
export function Prose({ text, label }) {
  const isLong = text.length > SHOWN_CHARS;
  const scrolls = isLong ? { tabindex: 0, role: "region", "aria-label": label } : {};
  return html`<div class=${`foreign prose ${isLong ? "long" : ""}`} ...${scrolls}>${visible(text, true)}</div>`;
}

/** Announcements: the newest, and the earlier ones on request. @param {{list: ReturnType<typeof import("../parts/pages.js").usePages>}} props */
export function Announcements({ list }) {
  const [newest, ...earlier] = list.items.map(
    ({ at, text }) => html`<article class="inset"><p class="muted small"><${Time} value=${at} both /></p><${Lines} value=${text} /></article>`,
  );
  return newest && html`<section aria-labelledby="announcements">
    <h2 id="announcements">Announcements</h2>
    ${newest}
    ${earlier.length > 0 && html`<details><summary>Earlier ones</summary>${earlier}<${More} list=${list} /></details>`}
  </section>`;
}
