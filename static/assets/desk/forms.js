// The forms of the desk: creating a competition, starting a run or a game, exports.
import { html, useState } from "../ui.js";
import { request, route, withQuery } from "../api.js";
import { visit } from "../app.js";
import { Secret } from "../parts/copy.js";
import { Download } from "../parts/download.js";
import { Entry, Form, initialValues } from "../parts/form.js";
import { DECLARED_FIELDS, SAMPLING_FIELDS, localTime } from "../parts/inputs.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { RULES, TIE_BREAKS } from "../parts/rules.js";
import { TASKS } from "../parts/tasks.js";
import { textFields } from "./change.js";

/** @typedef {import("../parts/form.js").Field} Field */

/** Options that are called by their values. @param {string[]} values @returns {[string, string][]} */
const named = (values) => values.map((value) => [value, value]);

/**
 * A field of a number.
 * @type {(name: string, label: string, min: number, max: number, placeholder: string, more?: Partial<Field>) => Field}
 */
const number = (name, label, min, max, placeholder, more) => ({ name, label, kind: "number", min, max, placeholder, ...more });

/** A field of a choice, at first of the first option. @type {(name: string, label: string, options: [string, string][], more?: Partial<Field>) => Field} */
const choice = (name, label, options, more) => ({ name, label, kind: "choice", options, initial: options[0]?.[0], ...more });

/** Settings of games. @param {string} prefix @returns {Field[]} */
const settingsFields = (prefix) => [
  choice(`${prefix}control`, "Control", [["", "decentralized"], ["centralized", "centralized: a commander sees all and sends orders"]]),
  number(`${prefix}num_agents`, "Agents", 1, 1024, "12"),
  number(`${prefix}width`, "Columns of the map", 8, 256, "10"),
  number(`${prefix}height`, "Rows of the map", 8, 256, "10"),
  number(`${prefix}view_size`, "Rows and columns of an agent's window, odd", 3, 513, "5"),
  number(`${prefix}memory`, "Rounds that an agent remembers", 0, 50, "5"),
  number(`${prefix}max_round`, "Rounds", 1, 100_000, "100"),
  number(`${prefix}noise`, "Probability that a message is corrupted", 0, 1, "0", { step: "any" }),
  number(`${prefix}max_delay`, "Most rounds that a message is late", 0, 100, "0"),
];

/** Clocks of games. @param {string} prefix @param {boolean} isRequired @returns {Field[]} */
const clockFields = (prefix, isRequired) => [
  number(`${prefix}round_deadline_s`, "Clock of a round, in seconds", 0.05, 86_400, isRequired ? "" : "none", {
    ...{ isRequired, step: "any" },
    help: isRequired ? "It ends the rounds that are open when the competition closes." : "An agent that does not answer in time does nothing in that round.",
  }),
  number(`${prefix}bank_s`, "Bank of a seat in a game, in seconds", 0, 604_800, "0", { step: "any", help: "What a seat may overspend in all rounds together." }),
  number(`${prefix}idle_timeout_s`, "A game is abandoned after, in seconds", 1, 31_536_000, "86400", { step: "any", help: "The time without any act." }),
];

const DAY_MS = 86_400_000;

/** @returns {import("../parts/form.js").Group[]} */
const groupsOf = () => [
  { legend: "What it is", fields: textFields() },
  { legend: "When", fields: [
    { name: "opens_at", label: "Opens", kind: "time", isRequired: true, initial: localTime(new Date(Date.now() + DAY_MS)), help: "From then on attempts can be started; at once where it is past. One can enter before." },
    { name: "closes_at", label: "Closes", kind: "time", isRequired: true, initial: localTime(new Date(Date.now() + 8 * DAY_MS)), help: "From then on no round begins. Rounds that are open have their whole clock." },
  ] },
  { legend: "Who, and how often", fields: [
    choice("entry", "Entry", [["anybody", "anybody, under any number of names"], ["codes", "codes: each is for one entrant"]]),
    number("entries_per_key", "Entrants of one key", 1, 100, "1"),
    { name: "categories", label: "Categories, one a line", kind: "lines", placeholder: "models\npeople", help: "Each entrant chooses one of them, and the board can be read for each. Left empty: there are none." },
    choice("windows", "Attempts", [["", "a number, all open for the whole time"], ["own", "each has a window of its own"]], { isLocal: true, help: "Each attempt has seeds of its own, the same for all entrants. With windows nobody knows attempt 2 while others play attempt 1." }),
    number("attempts", "Number of attempts", 1, 100, "1", { when: ({ windows }) => !windows }),
    { name: "attempts", key: "attempt_windows", label: "Windows", kind: "windows", initial: [{ opens_at: "", closes_at: "" }], when: ({ windows }) => Boolean(windows), help: "A time that is left empty is that of the competition." },
    number("attempts_per_day", "Attempts that an entrant may start on one day (UTC)", 1, 100, "as many as there are"),
    number("spares", "Spare attempts", 0, 99, "0", { help: "They have sealed seeds of their own, for attempts that you have to void. Without them a voided attempt is played again on seeds that its entrant has seen." }),
    number("parallel", "Games of an attempt that are open at a time", 1, 100, "5"),
  ] },
  { legend: "Results", fields: [
    choice("counts", "Which attempt counts", [["best", "the best"], ["last", "the last"], ["first", "the first"]]),
    choice("own_games", "When entrants read their own games", [["sealed", "sealed: after the end, as everybody"], ["ended", "ended: after the attempt's window"]], { help: "Until a window closes others play on the same seeds." }),
    { name: "tie_breaks", label: "What decides between equal totals", kind: "order", initial: [], options: TIE_BREAKS, help: "Entrants that are equal in all of it share a rank." },
    choice("board", "Board before the end", [["public", "public: ranks and totals"], ["hidden", "hidden"], ["frozen", "frozen from a time on"]], { help: "It must be hidden where an attempt has one game only." }),
    { name: "board_freezes_at", label: "Freezes", kind: "time", isRequired: true, when: ({ board }) => board === "frozen" },
  ] },
  { legend: "What is played", fields: [
    { name: "suite.tasks", label: "Tasks", kind: "checks", options: named(TASKS), initial: TASKS },
    number("suite.seeds", "Sealed seeds of each attempt", 1, 100, "5", { help: "Every task is played once on each." }),
    number("suite.public_seeds", "Seeds that make the board before the end", 0, 99, "0: all seeds make one board", { help: "The others make the final board, when the competition has closed." }),
    choice("suite.rules", "Rules", RULES),
    ...clockFields("clocks.", true),
  ] },
  { legend: "Settings of all games", isFolded: true, fields: settingsFields("suite.settings.") },
];

export function Create() {
  const send = async (/** @type {any} */ body) => {
    const { id } = await request("/api/v1/competitions", { method: "POST", body });
    visit(route`/desk?view=competition&id=${id}`);
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

const VISIBILITY = choice("visibility", "Who reads it before its end", [["", "as the server has it"], ["public", "public: everybody"], ["owner", "owner: its creator and organizers"]]);

const RULES_FIELD = choice("rules", "Rules", RULES);

/** @param {string} help @returns {Field} */
const player = (help) => ({ name: "player", label: "Built-in player", placeholder: "none", help: `${help} “default” is each task's own.` });

/** @param {string[]} suites @returns {(Field | import("../parts/form.js").Group)[]} */
const runFields = (suites) => [
  choice("suite", "Suite", [...named(suites), ["", "one of my own"]]),
  ...[
    { name: "suite.name", label: "Name of the suite", isRequired: true, max: 100 },
    { name: "suite.tasks", label: "Tasks", kind: "checks", options: named(TASKS), initial: TASKS },
    { name: "suite.seeds", label: "Seeds", kind: "numbers", isRequired: true, placeholder: "27, 42", help: "Every task is played once on every seed." },
    ...settingsFields("suite.settings."),
  ].map((/** @type {any} */ field) => ({ ...field, when: ({ suite }) => suite === "" })),
  RULES_FIELD,
  { name: "model", label: "Model", isRequired: true, max: 200 },
  player("The server plays all games with it, and there is no token."),
  { legend: "More", isFolded: true, fields: [
    number("parallel", "Games that are open at a time", 1, 64, "4"),
    ...[VISIBILITY, ...SAMPLING_FIELDS, ...clockFields("", false), ...DECLARED_FIELDS],
  ] },
];

/** @type {(Field | import("../parts/form.js").Group)[]} */
const GAME_FIELDS = [
  choice("task", "Task", named(TASKS)),
  number("seed", "Seed of the layout", 0, Number.MAX_SAFE_INTEGER, "drawn at random"),
  RULES_FIELD,
  { name: "model", label: "Who plays", max: 200, placeholder: "unnamed" },
  player("The server holds the seats of the creator with it."),
  { legend: "Settings", isFolded: true, fields: settingsFields("") },
  { legend: "More", isFolded: true, fields: [
    VISIBILITY,
    choice("start", "Start", [["now", "now"], ["manual", "when its creator starts it"]]),
    number("open_seats", "Seats for others to claim", 0, 1024, "0"),
    number("fill_after_s", "Built-in players take open seats after, in seconds", 0, 604_800, "never", { step: "any" }),
    { name: "fill_with", label: "Built-in player for open seats", placeholder: "default" },
    ...[...clockFields("", false), ...DECLARED_FIELDS],
  ] },
];

export function Start() {
  const { value, problem, reload } = useLoaded((signal) => request("/api/v1/suites", { signal }), []);
  const [made, setMade] = useState({ run: null, game: null });
  const create = (/** @type {string} */ what, /** @type {string} */ path) => async (/** @type {any} */ body) =>
    setMade({ ...made, [what]: await request(path, { method: "POST", body }) });
  const suites = [...new Set((value?.items ?? []).map((one) => one.name))];
  return html`
    <h2>New run</h2>
    <p>A model plays a suite of games, and its result is on the board of the suite.</p>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    <${Created} one=${made.run} path="/runs" what="run" />
    ${value && html`<${Form} fields=${runFields(suites)} label="Start the run" send=${create("run", "/api/v1/runs")} hasPreview />`}
    <h2>New game</h2>
    <p>One game. To play in it yourself, start it on the page <a href="/play">Play</a>.</p>
    <${Created} one=${made.game} path="/episodes" what="game" />
    <${Form} fields=${GAME_FIELDS} label="Create the game" send=${create("game", "/api/v1/episodes")} hasPreview />
  `;
}

/** @param {{one: any, path: string, what: string}} props */
const Created = ({ one, path, what }) => html`<div role="status">
  ${one && html`<p class="good">The ${what} was created. <a href=${`${path}/${encodeURIComponent(one.id)}`}>Look at it</a></p>`}
  ${one?.swarm_token && html`<${Secret} value=${one.swarm_token} label=${`The token of the ${what}`}>
    <p>It plays all its seats, over <code>/swarm/obs</code> and <code>/swarm/act</code>.</p>
  <//>`}
</div>`;

const TABLES = {
  episodes: "a row a game",
  acts: "a row an act, with answers and reasoning",
  rounds: "a row a state",
  heard: "a row a message that an agent received",
  views: "a row an agent's window",
};

/** Formats of each table, and all tables as the public toolkit has them. @type {[string, string][]} */
const FILES = [
  ...Object.entries(TABLES).flatMap(([name, text]) => ["jsonl", "parquet"].map((form) => /** @type {[string, string]} */ ([`${name}.${form}`, `${name}.${form}: ${text}`]))),
  ["dataset.zip", "dataset.zip: the files of the public toolkit"],
];

const EXPORT_FIELDS = [
  choice("file", "File", FILES),
  choice("task", "Task", [["", "all"], ...named(TASKS)]),
  choice("status", "Status", [["", "all that have ended"], ...named(["finished", "aborted", "abandoned", "running"])]),
  choice("mixed", "Seats", [["", "any"], ["true", "of several holders"], ["false", "of one holder"]]),
  ...[["model", "Model"], ["run", "Id of a run"], ["episode", "Id of a game"]].map(([name, label]) => ({ name, label })),
];

/** Games as files, for analysis. */
export function Exports() {
  const [values, setValues] = useState(initialValues(EXPORT_FIELDS));
  const { file, ...filters } = Object.fromEntries(Object.entries(values).map(([name, value]) => [name, value.trim()]));
  return html`
    <h2>Exports</h2>
    <p>Games that have ended, in one file. What is left empty does not filter.</p>
    <form onSubmit=${(/** @type {Event} */ event) => event.preventDefault()}>
      ${EXPORT_FIELDS.map((field) => html`<${Entry} field=${field} value=${values[field.name]} set=${(/** @type {string} */ value) => setValues({ ...values, [field.name]: value })} />`)}
      <p class="buttons"><${Download} href=${withQuery(`/api/v1/exports/${file}`, filters)} name=${file}>Download<//></p>
    </form>
  `;
}
