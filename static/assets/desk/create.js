// Creating a competition.
import { html } from "../ui.js";
import { request } from "../api.js";
import { visit } from "../app.js";
import { Form } from "../parts/form.js";
import { localTime } from "../parts/inputs.js";
import { TIE_BREAKS } from "../parts/rules.js";
import { TASKS } from "../parts/tasks.js";
import { RULES, TASK_OPTIONS, TERMS_CHARS_MAX, clockFields, settingsFields } from "./fields.js";

const DAY_MS = 86_400_000;

/** @returns {import("../parts/form.js").Group[]} */
const groupsOf = () => [
  {
    legend: "What it is",
    fields: [
      { name: "name", label: "Name", isRequired: true, max: 100 },
      { name: "description", label: "What entrants should know", kind: "long", max: 10_000, help: "Plain text; line breaks stay." },
      { name: "terms", label: "Terms that entrants accept", kind: "long", max: TERMS_CHARS_MAX, help: "Plain text; line breaks stay. Left empty: there is nothing to accept." },
    ],
  },
  {
    legend: "When",
    fields: [
      { name: "opens_at", label: "Opens", kind: "time", isRequired: true, initial: localTime(new Date(Date.now() + DAY_MS)), help: "From then on attempts can be started; at once where it is past. One can enter before." },
      { name: "closes_at", label: "Closes", kind: "time", isRequired: true, initial: localTime(new Date(Date.now() + 8 * DAY_MS)), help: "From then on no round begins. Rounds that are open have their whole clock." },
    ],
  },
  {
    legend: "Who, and how often",
    fields: [
      { name: "entry", label: "Entry", kind: "choice", initial: "anybody", options: [["anybody", "anybody: one person can enter under many names"], ["codes", "codes: with an invitation code, valid for one entrant"]] },
      { name: "entries_per_key", label: "Entrants of one key", kind: "number", min: 1, max: 100, placeholder: "1" },
      { name: "categories", label: "Categories, one a line", kind: "lines", placeholder: "models\npeople", help: "Each entrant chooses one of them, and the board can be read for each. Left empty: there are none." },
      { name: "windows", label: "Attempts", kind: "choice", initial: "", options: [["", "a number, all open for the whole time"], ["own", "each has a window of its own"]], isLocal: true, help: "Each attempt has seeds of its own, the same for all entrants. With windows nobody knows attempt 2 while others play attempt 1." },
      { name: "attempts", label: "Number of attempts", kind: "number", min: 1, max: 100, placeholder: "1", when: ({ windows }) => !windows },
      { name: "attempts", key: "attempt_windows", label: "Windows", kind: "windows", initial: [{ opens_at: "", closes_at: "" }], when: ({ windows }) => Boolean(windows), help: "A time that is left empty is that of the competition." },
      { name: "attempts_per_day", label: "Attempts that an entrant may start on one day (UTC)", kind: "number", min: 1, max: 100, placeholder: "as many as there are" },
      { name: "spares", label: "Spare attempts", kind: "number", min: 0, max: 99, placeholder: "0", help: "They have sealed seeds of their own, for attempts that you have to void. Without them a voided attempt is played again on seeds that its entrant has seen." },
      { name: "parallel", label: "Games of an attempt that are open at a time", kind: "number", min: 1, max: 100, placeholder: "5" },
    ],
  },
  {
    legend: "Results",
    fields: [
      { name: "counts", label: "Which attempt counts", kind: "choice", initial: "best", options: [["best", "the best"], ["last", "the last"], ["first", "the first"]] },
      { name: "own_games", label: "When entrants read their own games", kind: "choice", initial: "sealed", options: [["sealed", "sealed: after the end, as everybody"], ["ended", "ended: once the window of the attempt has closed"]], help: "Until a window closes others play on the same seeds." },
      { name: "tie_breaks", label: "What decides between equal totals", kind: "order", initial: [], options: TIE_BREAKS, help: "Entrants that are equal in all of it share a rank." },
      { name: "board", label: "Board before the end", kind: "choice", initial: "public", options: [["public", "public: ranks and totals"], ["hidden", "hidden"], ["frozen", "frozen from a time on"]], help: "It must be hidden where an attempt has one game only." },
      { name: "board_freezes_at", label: "Freezes", kind: "time", isRequired: true, when: ({ board }) => board === "frozen" },
    ],
  },
  {
    legend: "What is played",
    fields: [
      { name: "suite.tasks", label: "Tasks", kind: "checks", options: TASK_OPTIONS, initial: TASKS },
      { name: "suite.seeds", label: "Sealed seeds of each attempt", kind: "number", min: 1, max: 100, placeholder: "5", help: "Every task is played once on each." },
      { name: "suite.public_seeds", label: "Seeds that make the board before the end", kind: "number", min: 0, max: 99, placeholder: "0: all seeds make one board", help: "The others make the final board, when the competition has closed." },
      { name: "suite.rules", label: "Rules", kind: "choice", initial: "paper", options: RULES },
      ...clockFields("clocks.", true),
    ],
  },
  { legend: "Settings of all games", isFolded: true, fields: settingsFields("suite.settings.") },
];

export function View() {
  /** @param {any} body */
  const send = async (body) => {
    const made = await request("/api/v1/competitions", { method: "POST", body });
    visit(`/desk?view=competition&id=${encodeURIComponent(made.id)}`);
  };
  return html`
    <h2>New competition</h2>
    <p>
      The server draws the sealed seeds now, and publishes a commitment to them. Later you can extend its ends, correct its texts, and
      hide or cancel it. What is played never changes: rehearse with a competition that closes after a few minutes.
    </p>
    <${Form} fields=${groupsOf()} label="Create the competition" send=${send} hasPreview />
  `;
}
