// Boards: their addresses and leaders; and their rows: players, marks, kinds that can be hidden, and scores with intervals.
import { html, useState } from "../ui.js";
import { Problem, request, route, withQuery } from "../api.js";
import { Interval, short } from "./chart.js";
import { useLoaded } from "./load.js";
import { PromptName, Text } from "./text.js";
import { samplingText } from "./words.js";

/** The rows that are read beyond the leaders of a board, as people and rule-based players may be before models. */
const OTHERS = 8;

/**
 * The suites of finished runs, newest first, then the built-in ones; each once. Attempts are on the board of their
 * competition.
 * @param {any[]} suites @param {any[]} runs
 */
export function arrange(suites, runs) {
  /** @type {Map<string, {suite: any, newest: string | null}>} */
  const boards = new Map();
  const add = (suite, newest) => boards.has(suite.digest) || boards.set(suite.digest, { suite, newest });
  for (const run of runs) if (run.status !== "running" && run.attempt === null) add(run.suite, run.created_at);
  for (const suite of suites) add(suite, null);
  return [...boards.values()];
}

/** The board of a suite. @param {{name: string, digest?: string, rules: string}} suite */
export const boardHref = ({ name, digest, rules }) => withQuery(route`/board/${digest ? `${name}@${digest}` : name}`, { rules });

/** A row of a board. Its page asks for imported rows only where it is one. @param {any} board @param {{id: string, imported?: boolean}} row */
export const rowHref = ({ suite, digest, rules }, { id, imported }) =>
  withQuery(route`/board/${`${suite}@${digest}`}/${id}`, { rules, imported: imported || null });

/** The suite of a run with its board, or the competition of an attempt, which is the name of its suite. */
export const SuiteLink = ({ run: { suite, attempt } }) =>
  attempt === null
    ? html`<a href=${boardHref(suite)}><${Text} value=${suite.name} /></a>`
    : html`<a href=${route`/competitions/${suite.name}`}>competition</a>, attempt ${attempt}`;

/** The first models of a board, or its first rows where no model has a rank. @param {any} suite @param {number} count */
export function useLeaders(suite, count) {
  const address = withQuery("/api/v1/leaderboard", { suite: `${suite.name}@${suite.digest}`, rules: suite.rules, limit: count + OTHERS });
  return useLoaded(async (signal) => {
    const board = await request(address, { signal });
    const ranked = board.items.filter((row) => row.rank !== null);
    const models = ranked.filter(KINDS[0].has);
    return { ...board, items: (models.length > 0 ? models : ranked).slice(0, count) };
  }, [address]);
}

/** @param {{of: ReturnType<typeof useLeaders>}} props */
export const Leaders = ({ of: { value, problem } }) => {
  const note = (/** @type {string} */ text) => html`<span class="muted">${text}</span>`;
  if (problem) return note(problem instanceof Problem && problem.status === 401 ? "only with a key" : "not available");
  if (!value) return note("…");
  if (value.items.length === 0) return note(value.rows === 0 ? "no rows yet" : "nobody has played every task");
  const half = (/** @type {ReturnType<typeof totalOf>} */ of) => (of?.high ? ` ± ${(of.high - of.mean).toFixed(2)}` : "");
  return html`<ol class="plain leaders">
    ${value.items.map((row) => html`<li>
      <${Text} value=${row.model} />${row.reference && html` <span class="muted small">paper</span>`}${" "}
      <span class="number muted">${row.total.toFixed(2)}${half(totalOf(row, value.tasks))}</span>
    </li>`)}
  </ol>`;
};

/** @typedef {any} Row a row of the leaderboard, as docs/protocol.md has it */

/**
 * A sign with its explanation, which a press shows where it stands: a pointer's hint is neither for touch nor for keys.
 * @param {{about: string, children: any}} props
 */
export function Sign({ about, children }) {
  const [isOpen, setIsOpen] = useState(false);
  return html`<button type="button" class="sign" aria-expanded=${isOpen} title=${about} onClick=${() => setIsOpen(!isOpen)}>${children}</button>
    ${isOpen && html`<span class="about" role="note">${about}</span>`}`;
}

/** @param {Row} row */
const isPerson = (row) => row.kind === "human" || row.table === "humans";

/** @param {Row} row */
const isTeam = (row) => row.kind === "team";

/** Whether different holders had the seats. @param {Row} row */
const isShared = (row) => isTeam(row) && row.holders.length > 1;

/** @param {Row} row */
const isProgram = (row) => !isTeam(row) && (row.model.startsWith("built-in/") || row.table === "rules");

/** Numbers in ranges: 0–3, 7. @param {number[]} seats */
export const inRanges = (seats) => {
  const isNext = (/** @type {number} */ at) => at > 0 && seats[at] === seats[at - 1] + 1;
  const starts = seats.map((_, at) => at).filter((at) => !isNext(at));
  const ends = [...starts.slice(1), seats.length];
  return starts.map((start, at) => [...new Set([seats[start], seats[ends[at] - 1]])].join("–")).join(", ");
};

/**
 * Kinds of rows, each of which can be hidden: by player, and by source of the numbers.
 * @type {{name: string, label: string, has: (row: any) => boolean, isOffAtFirst?: boolean}[]}
 */
export const KINDS = [
  { name: "models", label: "Models", has: (row) => !isPerson(row) && !isProgram(row) && !isTeam(row) },
  { name: "people", label: "People", has: isPerson, isOffAtFirst: true },
  { name: "built-in", label: "Rule-based players", has: isProgram },
  { name: "teams", label: "Teams", has: isTeam },
  { name: "paper", label: "The paper", has: (row) => row.reference },
  { name: "imported", label: "Imported games", has: (row) => row.imported, isOffAtFirst: true },
];

/** The kinds that each have a part of the table, and scales of their own: one player with 250 would flatten all models to a dot. */
export const PARTS = KINDS.slice(0, 4);

const AT_FIRST = KINDS.filter((kind) => !kind.isOffAtFirst).map((kind) => kind.name).join();

/** The kinds that an address asks for. @param {string | null} text */
export const kindsOf = (text) => new Set((text || AT_FIRST).split(","));

/** The same as `kinds`, with one shown or hidden, for the address. @param {Set<string>} kinds @param {string} name @param {boolean} isOn */
export function withKind(kinds, name, isOn) {
  const shown = KINDS.map((kind) => kind.name).filter((kind) => (kind === name ? isOn : kinds.has(kind)));
  return shown.join() === AT_FIRST ? null : shown.join() || "none";
}

/** Whether none of the kinds of a row is hidden. @param {Row} row @param {Set<string>} kinds */
export const isShown = (row, kinds) => KINDS.every((kind) => kinds.has(kind.name) || !kind.has(row));

/** The numbers of games that were played and planned. @param {Row} row @returns {[number, number]} */
const played = ({ tasks }) => {
  const planned = Object.values(tasks).filter((task) => task.planned !== null);
  const sum = (/** @type {"games" | "planned"} */ field) => planned.reduce((sum, task) => sum + (task[field] ?? 0), 0);
  return [sum("games"), sum("planned")];
};

/**
 * Marks beside a player: whether a row has one, its sign, the reason, and details.
 * @type {[(row: Row) => boolean, string | ((row: Row) => string), string, ((row: Row) => string)?][]}
 */
const MARKS = [
  [isPerson, "person", "A person played, not a model."],
  [isTeam, "team", "Several players had the seats of one swarm, which share its score."],
  [(row) => row.reference, "paper", "A number of the SwarmBench paper. It was not measured on this server."],
  [(row) => row.imported, "from files", "Games that were read from files. This server neither played nor checked them."],
  [(row) => row.vouched === false, "unconfirmed", "Only its owner says that this was the model. A server sees answers, not who wrote them."],
  [(row) => row.decentralization === "declared" && isShared(row), "played again",
    "A game was played again (“declared”): the holders of the seats could read the earlier one, which had the same layout."],
  [(row) => row.decentralization === "declared" && !isShared(row), "one holder",
    "One holder had all seats (“declared”): each agent may have decided alone, but the holder could combine what they saw."],
  [(row) => row.decentralization === "enforced", "separate seats",
    "Different holders had the seats, each with a token that reads only its own, or the server played them (“enforced”)."],
  [(row) => Boolean(row.prompt_template), "own prompt", "Played with a prompt template of its own, not with the built-in one.",
    (row) => `Template ${row.prompt_template}.`],
  [(row) => Boolean(row.status) && row.status !== "finished", (row) => row.status,
    "The run was broken off: “aborted” by its creator or an organizer, “abandoned” where nobody acted any more, “closed” with its competition."],
  [(row) => played(row)[0] < played(row)[1], (row) => played(row).join(" of "), "How many of the planned games were played. The others count as 0."],
  [(row) => row.voided > 0, (row) => `${row.voided} voided`, "Games that an organizer voided, or that were played again. They do not count."],
  [(row) => row.converted?.length > 0, "rescaled", "Played by the other rule set: its scores of Flocking are shown at the scale of this board."],
  [(row) => row.other_rules?.length > 0, "≠ rules",
    "Played by the other rule set, which defines some tasks in another way. Compare these scores with care.",
    (row) => `Here: ${row.other_rules.join(", ")}.`],
];

/** @param {(typeof MARKS)[number]} mark @param {Row} row */
const signOf = ([, sign], row) => (typeof sign === "string" ? sign : sign(row));

/** Signs of a row, each with its explanation. @param {{row: Row}} props */
export const Marks = ({ row }) =>
  MARKS.filter(([isOf]) => isOf(row)).map((mark) => {
    const [, , about, detail] = mark;
    return html`<${Sign} key=${about} about=${detail ? `${about} ${detail(row)}` : about}>${signOf(mark, row)}<//> `;
  });

/** The same explanations as terms of a list, of the marks that rows have. @param {{rows: Row[]}} props */
export const Legend = ({ rows }) =>
  MARKS.map((mark) => {
    const row = rows.find(mark[0]);
    return row && html`<dt>${signOf(mark, row)}</dt><dd>${mark[2]}</dd>`;
  });

/** The number of holders of a team that a row names; its page has all. */
const HOLDERS_SHOWN = 4;

/** Names of prompts and readers of answers that need no word: the usual ones, and those of players without a prompt. */
const USUAL = [undefined, null, "none", "default", "last-marker"];

/** The details that distinguish players of one name, and who has the seats of a team. @param {{row: Row}} props */
export const Settings = ({ row: { owner, prompt, answer_reader: reader, runs, holders = [], ...player } }) => {
  const parts = [
    owner && html`of <${Text} value=${owner} />`,
    samplingText(player) && html`<${Text} value=${samplingText(player)} />`,
    !USUAL.includes(prompt) && html`prompt <${PromptName} value=${prompt} />`,
    !USUAL.includes(reader) && `answers read by ${reader}`,
    runs > 1 && `${runs} runs`,
  ].filter(Boolean);
  const members = holders.slice(0, HOLDERS_SHOWN).map(({ name, seats }, at) => html`${at > 0 && "; "}<${Text} value=${name} /> ${inRanges(seats)}`);
  return html`<span class="muted small">${parts.map((part, at) => [at > 0 && ", ", part])}
    ${members.length > 0 && html`<span class="members">seats: ${members}${holders.length > HOLDERS_SHOWN && `; ${holders.length - HOLDERS_SHOWN} more holders`}</span>`}</span>`;
};

/** The quantile 0.9875 of the normal distribution. */
const Z = 2.2414027276;

/** The minimum size of a sample for an interval. */
const GAMES_MIN = 3;

/**
 * The quantile 0.9875 of Student's t: exact for two degrees of freedom, else by the expansion of Cornish and Fisher, to half
 * a percent.
 * @param {number} f degrees of freedom, at least 2
 */
function studentQuantile(f) {
  if (f < 2.5) return 6.2053;
  const z2 = Z * Z;
  const terms = [
    (z2 + 1) / 4,
    ((5 * z2 + 16) * z2 + 3) / 96,
    (((3 * z2 + 19) * z2 + 17) * z2 - 15) / 384,
    ((((79 * z2 + 776) * z2 + 1482) * z2 - 1920) * z2 - 945) / 92_160,
  ];
  return Z * terms.reduce((sum, term, index) => sum + term / f ** (index + 1), 1);
}

/**
 * The mean of a task, or the sum of the means of several, with an interval of 95 % by the method that docs/evaluate/boards.md gives
 * for differences of rows; null where a mean is missing. `low` and `high` are null where a task has too few games.
 * @param {{mean?: number | null, deviation?: number | null, games?: number | null}[]} samples `deviation`: of the population
 * @returns {{mean: number, low: number | null, high: number | null} | null}
 */
export function interval(samples) {
  let [mean, variance, freedom] = [0, 0, 0];
  let isKnown = samples.length > 0;
  for (const { mean: of = null, deviation, games } of samples) {
    if (of === null) return null;
    mean += of;
    isKnown &&= typeof deviation === "number" && (games ?? 0) >= GAMES_MIN;
    const part = Number(deviation) ** 2 / (Number(games) - 1);
    variance += part;
    freedom += part ** 2 / (Number(games) - 1);
  }
  if (!isKnown) return { mean, low: null, high: null };
  const half = variance === 0 ? 0 : studentQuantile(variance ** 2 / freedom) * Math.sqrt(variance);
  return { mean, low: mean - half, high: mean + half };
}

/** The sum of the means of a row in some tasks, with its interval. @param {Row} row @param {string[]} tasks */
export const totalOf = (row, tasks) => interval(tasks.map((task) => row.tasks[task] ?? {}));

/**
 * The scale that intervals of a column share, from 0: bounds below it are cut off.
 * @param {(ReturnType<typeof interval>)[]} intervals
 * @returns {[number, number]}
 */
export function scale(intervals) {
  const known = intervals.filter((one) => one !== null);
  const low = Math.min(0, ...known.map((one) => one.mean));
  const high = Math.max(0, ...known.map((one) => one.high ?? one.mean));
  return low === high ? [low, low + 1] : [low, high];
}

/**
 * A score, its deviation, and its interval, over that of the leader; `hasBounds`: the interval in numbers, too.
 * @param {{of: ReturnType<typeof interval>, deviation?: number | null, range: [number, number], name: string,
 *   leader?: ReturnType<typeof interval>, hasBounds?: boolean}} props
 */
export function Score({ of, deviation, range, name, leader = null, hasBounds }) {
  if (!of) return html`<span class="muted">–</span>`;
  const { mean, low, high } = of;
  /** @type {[number, number] | null} */
  const band = leader?.low != null && leader.high != null ? [leader.low, leader.high] : null;
  const overlaps = band && leader !== of && high !== null && high >= band[0];
  const bounds = `${short(low)} to ${short(high)}`;
  const label = `${name}: ${low === null ? "no interval" : `95 % interval ${bounds}`}${overlaps ? ", overlaps with that of the leader" : ""}`;
  return html`<span class="score" title=${label}>
    <span class="number">${mean.toFixed(2)}</span>
    ${typeof deviation === "number" && html`<span class="number muted small"> ± ${deviation.toFixed(2)}</span>`}
    <${Interval} mean=${mean} low=${low ?? mean} high=${high ?? mean} range=${range} band=${band} label=${label} width=${104} />
    ${hasBounds && low !== null && low !== high && html`<span class="number muted small">${bounds}</span>`}
  </span>`;
}
