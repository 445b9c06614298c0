// The statuses of games and runs in words.
import { html } from "../ui.js";
import { route } from "../api.js";
import { Text } from "./text.js";

/** @type {Record<string, string>} */
const GAMES = {
  planned: "Not opened yet",
  waiting: "Waits for players",
  running: "Rounds are played",
  finished: "Played to its end",
  aborted: "Ended by its creator or an organizer, or because its competition closed",
  abandoned: "Nobody acted for longer than the game waits",
};

/** @type {Record<string, string>} */
const RUNS = {
  running: "Games are open, or will be opened",
  finished: "All games have ended",
  aborted: "Ended by its creator or an organizer. Games that were never played count as 0",
  abandoned: "Nobody acted in one of its games for longer than it waits. Games that were never played count as 0",
  closed: "Its competition closed. Games that were never played count as 0",
};

/** Reasons why answers did not count. @type {Record<string, string>} */
const FAILURES = {
  refusal: "refused",
  content_filter: "filtered",
  truncated: "cut at the token limit",
  tool_call: "tool calls",
  reasoning_only: "reasoning only",
  rejected: "rejected by the endpoint",
  empty: "empty",
  no_marker: "without ACTION: or MSG:",
  unknown_action: "with an unknown action",
};

/** @param {string} kind */
export const failureText = (kind) => FAILURES[kind] ?? kind;

/** The numbers of answers that did not count, by reason. @param {Record<string, number>} [failures] */
export const failuresText = (failures = {}) =>
  Object.entries(failures).sort(([, one], [, other]) => other - one).map(([kind, count]) => `${count} ${failureText(kind)}`).join(", ");

/** @param {string} status */
export const runStatusText = (status) => RUNS[status] ?? "";

/** A status as a word with a mark. @param {{status: string, of?: "game" | "run"}} props */
export const Status = ({ status, of = "game" }) =>
  html`<span class=${`badge ${["aborted", "abandoned", "closed"].includes(status) ? "bad" : status === "running" ? "good" : ""}`}
    title=${(of === "run" ? RUNS : GAMES)[status]}>${status}</span>`;

/** @param {number | null | undefined} share 0 to 1 */
export function percent(share) {
  if (share === null || share === undefined) return "–";
  if (share === 0) return "0 %";
  return share < 0.001 ? "< 0.1 %" : `${(share * 100).toFixed(1)} %`;
}

/** Marks an attempt of a competition that is played in place of a voided one. */
export const OnSpareSeeds = () => html`<span class="badge" title="In place of a voided attempt, on other sealed seeds">on spare seeds</span>`;

/** The status of an attempt, and why it was voided. @param {{one: any, children?: any}} props */
export const AttemptStatus = ({ one: { status, voided }, children }) =>
  html`${status}${voided && html`<div class="small"><span class="badge">voided</span> <${Text} value=${voided} />${children}</div>`}`;

/** How many games of an attempt have ended. @param {{one: any}} props */
export const AttemptGames = ({ one: { games, games_ended, run } }) => html`<progress value=${games_ended} max=${games} aria-label="Games that have ended"></progress>${" "}
  <a class="number" href=${route`/runs/${run}`}>${games_ended} of ${games}</a>`;

/** Who reads a game or a run before its end. @param {string | undefined} visibility */
export const visibleTo = (visibility) => ({ public: "everybody", owner: "its creator", sealed: "nobody before the end" })[visibility ?? ""] ?? visibility;
