// The settings of a competition, and its commitment.
import { html } from "../ui.js";
import { Copyable } from "../parts/copy.js";
import { seedsOf, tieBreaksText } from "../parts/rules.js";
import { TASKS } from "../parts/tasks.js";
import { Text } from "../parts/text.js";
import { duration } from "../parts/time.js";

const COUNTS = { best: "the best one (of equal ones the first)", last: "the last one that was started", first: "the first one" };
const BOARDS = {
  public: "Ranks and totals are public. Scores of single tasks and games are not.",
  hidden: "The board is hidden.",
  frozen: "The board is public until it freezes.",
};

/** @param {{competition: any}} props */
export function Rules({ competition }) {
  const { suite, clocks } = competition;
  const tasks = suite.tasks ?? TASKS;
  const { seeds, publicSeeds } = seedsOf(competition);
  return html`<dl class="facts">
    <dt>An attempt</dt>
    <dd>${tasks.length * seeds} games: <${Text} value=${tasks.join(", ")} />, each on ${seeds} sealed ${seeds === 1 ? "seed" : "seeds"}${competition.seeds_by_task && " of its own"}. ${competition.parallel} are open at a time.</dd>
    <dt>Attempts</dt>
    <dd>${competition.attempts.length}. Attempt <i>n</i> has the same seeds for all, and no other attempt has these.${competition.attempts_per_day && ` An entrant may start ${competition.attempts_per_day} on one day (UTC).`}</dd>
    ${competition.spares > 0 && html`<dt>Voided attempts</dt><dd>are played again on other sealed seeds, ${competition.spares} of them at most.</dd>`}
    <dt>What counts</dt>
    <dd>${COUNTS[competition.counts]}. A game that was not played counts as 0.</dd>
    <dt>Equal totals</dt>
    <dd>${competition.tie_breaks.length > 0 ? `${tieBreaksText(competition.tie_breaks)}. Who is equal in all of it shares a rank.` : "share a rank."}</dd>
    ${publicSeeds > 0 && html`<dt>Seeds of the board</dt><dd>Until it closes ${publicSeeds} of ${seeds}, then ${seeds - publicSeeds === 1 ? "the other one" : `the other ${seeds - publicSeeds}`}.</dd>`}
    <dt>Clock</dt>
    <dd>${duration(clocks.round_deadline_s * 1000)} for a round${clocks.bank_s > 0 && `, and ${duration(clocks.bank_s * 1000)} in a game on top`}. A game without an act for ${duration(clocks.idle_timeout_s * 1000)} is abandoned.</dd>
    <dt>Entry</dt>
    <dd>${competition.entry === "codes" ? "with an invitation code from the organizer" : "for everybody"}. A key can have ${competition.entries_per_key} ${competition.entries_per_key === 1 ? "entrant" : "entrants"}.</dd>
    ${competition.categories.length > 0 && html`<dt>Categories</dt><dd>${competition.categories.map((name, index) => html`${index > 0 && ", "}<${Text} value=${name} />`)}</dd>`}
    <dt>Before the end</dt>
    <dd>${BOARDS[competition.board]}${competition.own_games === "ended" && " Entrants read their own games once the window of the attempt has closed."}</dd>
    <dt>Rules</dt>
    <dd>${suite.rules}; ${Object.entries(suite.settings ?? {}).map(([name, value]) => `${name.replaceAll("_", " ")} ${value}`).join(", ")}</dd>
    <dt>The closing moment</dt>
    <dd>
      The server's clock counts. From this moment on no round, game or attempt begins. A round that is open has its whole clock, then its game
      ends. An unfinished attempt counts with what it has. If the server is down at that moment, it closes when it is back.
    </dd>
  </dl>`;
}

/** @param {{competition: any}} props */
export function Commitment({ competition }) {
  return html`
    <p>
      The commitment is a hash of a secret salt and all seeds. It was published before anybody played: if the seeds that are
      revealed at the end fit it, nobody exchanged one. Note it now, to compare it then.
    </p>
    <p><${Copyable} value=${competition.commitment} label="the commitment" /></p>
    ${competition.salt &&
    html`<details>
      <summary>Salt and ${competition.seeds.length} seeds</summary>
      <p>Salt: <code class="foreign">${competition.salt}</code></p>
      <ol class="seeds">${competition.seeds.map((seed) => html`<li><code>${seed}</code></li>`)}</ol>
    </details>`}
  `;
}
