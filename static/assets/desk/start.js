// Starting a run or a game.
import { html, useState } from "../ui.js";
import { request } from "../api.js";
import { Secret } from "../parts/copy.js";
import { Form } from "../parts/form.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { TASKS } from "../parts/tasks.js";
import { RULES, TASK_OPTIONS, clockFields, settingsFields } from "./fields.js";

/** @typedef {import("../parts/form.js").Field} Field */

/** @type {Field} */
const VISIBILITY = { name: "visibility", label: "Who reads it before its end", kind: "choice", options: [["", "as the server has it"], ["public", "public: everybody"], ["owner", "owner: its creator and organizers"]] };

/** @type {Field} */
const RULES_FIELD = { name: "rules", label: "Rules", kind: "choice", initial: "paper", options: RULES };

/** @type {Field[]} */
const DECLARED = [
  { name: "prompt_template", label: "Prompt template of its own", kind: "long", help: "Left empty: the built-in prompt." },
  { name: "agent_meta", label: "Other facts, as a JSON object", kind: "json" },
];

/** @param {string} help @returns {Field} */
const player = (help) => ({ name: "player", label: "Built-in player", placeholder: "none", help: `${help} “default” is each task's own.` });

/** @type {(values: Record<string, any>) => boolean} */
const isOwnSuite = ({ suite }) => suite === "";

/** @param {string[]} suites @returns {(Field | import("../parts/form.js").Group)[]} */
const runFields = (suites) => [
  { name: "suite", label: "Suite", kind: "choice", initial: suites[0], options: [...suites.map((name) => /** @type {[string, string]} */ ([name, name])), ["", "one of my own"]] },
  { name: "suite.name", label: "Name of the suite", isRequired: true, max: 100, when: isOwnSuite },
  { name: "suite.tasks", label: "Tasks", kind: "checks", options: TASK_OPTIONS, initial: TASKS, when: isOwnSuite },
  { name: "suite.seeds", label: "Seeds", kind: "numbers", isRequired: true, placeholder: "27, 42", when: isOwnSuite, help: "Every task is played once on every seed." },
  ...settingsFields("suite.settings.").map((field) => ({ ...field, when: isOwnSuite })),
  RULES_FIELD,
  { name: "model", label: "Model", isRequired: true, max: 200 },
  player("The server plays all games with it, and there is no token."),
  { legend: "More", isFolded: true, fields: [
    { name: "parallel", label: "Games that are open at a time", kind: "number", min: 1, max: 64, placeholder: "4" },
    VISIBILITY,
    { name: "temperature", label: "Temperature, as declared", kind: "number", min: 0, max: 10, step: "any" },
    { name: "top_p", label: "Top-p, as declared", kind: "number", min: 0, max: 1, step: "any" },
    ...clockFields("", false),
    ...DECLARED,
  ] },
];

/** @type {(Field | import("../parts/form.js").Group)[]} */
const GAME_FIELDS = [
  { name: "task", label: "Task", kind: "choice", initial: TASKS[0], options: TASK_OPTIONS },
  { name: "seed", label: "Seed of the layout", kind: "number", min: 0, max: Number.MAX_SAFE_INTEGER, placeholder: "drawn at random" },
  RULES_FIELD,
  { name: "model", label: "Who plays", max: 200, placeholder: "unnamed" },
  player("The server holds the seats of the creator with it."),
  { legend: "Settings", isFolded: true, fields: settingsFields("") },
  { legend: "More", isFolded: true, fields: [
    VISIBILITY,
    { name: "start", label: "Start", kind: "choice", initial: "now", options: [["now", "now"], ["manual", "when its creator starts it"]] },
    { name: "open_seats", label: "Seats for others to claim", kind: "number", min: 0, max: 1024, placeholder: "0" },
    { name: "fill_after_s", label: "Built-in players take open seats after, in seconds", kind: "number", min: 0, max: 604_800, step: "any", placeholder: "never" },
    { name: "fill_with", label: "Built-in player for open seats", placeholder: "default" },
    ...clockFields("", false),
    ...DECLARED,
  ] },
];

export function View() {
  const { value, problem, reload } = useLoaded((signal) => request("/api/v1/suites", { signal }), []);
  const [run, setRun] = useState(/** @type {any} */ (null));
  const [game, setGame] = useState(/** @type {any} */ (null));
  const create = (/** @type {string} */ path, /** @type {(made: any) => void} */ set) => async (/** @type {any} */ body) => set(await request(path, { method: "POST", body }));
  const suites = [...new Set((value?.items ?? []).map((one) => one.name))];
  return html`
    <h2>New run</h2>
    <p>A model plays a suite of games, and its result is on the board of the suite.</p>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    ${run && html`<${Made} href=${`/runs/${encodeURIComponent(run.id)}`} what="run" token=${run.swarm_token} />`}
    ${value && html`<${Form} fields=${runFields(suites)} label="Start the run" send=${create("/api/v1/runs", setRun)} hasPreview />`}
    <h2>New game</h2>
    <p>One game. To play in it yourself, start it on the page <a href="/play">Play</a>.</p>
    ${game && html`<${Made} href=${`/episodes/${encodeURIComponent(game.id)}`} what="game" token=${game.swarm_token} />`}
    <${Form} fields=${GAME_FIELDS} label="Create the game" send=${create("/api/v1/episodes", setGame)} hasPreview />
  `;
}

/** @param {{href: string, what: string, token?: string | null}} props */
const Made = ({ href, what, token }) => html`<div role="status">
  <p class="good">The ${what} was created. <a href=${href}>Look at it</a></p>
  ${token && html`<${Secret} value=${token} label=${`The token of the ${what}`}><p>It plays all its seats, over <code>/swarm/obs</code> and <code>/swarm/act</code>.</p><//>`}
</div>`;
