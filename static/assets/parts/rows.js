// Rows of boards: players, marks, and kinds that can be hidden.
import { html } from "../ui.js";
import { Interval, short } from "./chart.js";
import { Text } from "./text.js";
import { interval } from "./statistics.js";

/** @typedef {any} Row a row of the leaderboard, as docs/protocol.md has it */

/** @param {Row} row */
const isPerson = (row) => row.kind === "human" || row.table === "humans";

/** @param {Row} row */
const isProgram = (row) => row.model.startsWith("built-in/") || row.table === "rules";

/**
 * Kinds of rows, each of which can be hidden: by player, and by source of the numbers.
 * @type {{name: string, label: string, has: (row: any) => boolean, isOffAtFirst?: boolean}[]}
 */
export const KINDS = [
  { name: "models", label: "Models", has: (row) => !isPerson(row) && !isProgram(row) },
  { name: "people", label: "People", has: isPerson },
  { name: "built-in", label: "Rule-based players", has: isProgram },
  { name: "paper", label: "The paper", has: (row) => row.reference },
  { name: "imported", label: "Imported games", has: (row) => row.imported, isOffAtFirst: true },
];

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

/** @param {Row} row */
const missing = (row) => {
  const planned = Object.values(row.tasks).filter((task) => task.planned !== null);
  const sum = (/** @type {"games" | "planned"} */ field) => planned.reduce((sum, task) => sum + (task[field] ?? 0), 0);
  return [sum("games"), sum("planned")];
};

/**
 * Marks beside a player, with reasons.
 * @type {{sign: string | ((row: any) => string), about: string, has: (row: any) => boolean, detail?: (row: any) => string}[]}
 */
export const MARKS = [
  { sign: "person", about: "A person played, not a model.", has: isPerson },
  { sign: "paper", about: "A number of the SwarmBench paper. It was not measured on this server.", has: (row) => row.reference },
  {
    sign: "from files",
    about: "Games that were read from files. This server neither played nor checked them.",
    has: (row) => row.imported,
  },
  {
    sign: "unconfirmed",
    about: "Only its owner says that this was the model. A server sees answers, not who wrote them.",
    has: (row) => row.vouched === false,
  },
  {
    sign: "one holder",
    about: "One holder had all seats (“declared”): each agent may have decided alone, but the holder could combine what they saw.",
    has: (row) => row.decentralization === "declared",
  },
  {
    sign: "separate seats",
    about: "Different holders had the seats, or the server played them (“enforced”): no agent could know what another one saw.",
    has: (row) => row.decentralization === "enforced",
  },
  {
    sign: "own prompt",
    about: "Played with a prompt template of its own, not with the built-in one.",
    has: (row) => Boolean(row.prompt_template),
    detail: (row) => `Template ${row.prompt_template}.`,
  },
  {
    sign: (row) => row.status ?? "aborted",
    about: "The run was broken off: “aborted” by its creator or an organizer, “abandoned” where nobody acted any more, “closed” with its competition.",
    has: (row) => Boolean(row.status) && row.status !== "finished",
  },
  {
    sign: (row) => (row.tasks ? missing(row).join(" of ") : "4 of 5"),
    about: "How many of the planned games were played. The others count as 0.",
    has: (row) => missing(row)[0] < missing(row)[1],
  },
  {
    sign: (row) => (row.voided ? `${row.voided} voided` : "1 voided"),
    about: "Games that an organizer voided. They do not count.",
    has: (row) => row.voided > 0,
  },
  {
    sign: "rescaled",
    about: "Played by the other rule set: its scores of Flocking are shown at the scale of this board.",
    has: (row) => row.converted?.length > 0,
  },
  {
    sign: "≠ rules",
    about: "Played by the other rule set, which defines some tasks in another way. Compare these scores with care.",
    has: (row) => row.other_rules?.length > 0,
    detail: (row) => `Here: ${row.other_rules.join(", ")}.`,
  },
];

/** @param {(typeof MARKS)[number]} mark @param {Row | {}} row */
export const signOf = (mark, row) => (typeof mark.sign === "string" ? mark.sign : mark.sign(row));

/** Signs of a row, explained where the pointer rests. @param {{row: Row}} props */
export const Marks = ({ row }) =>
  html`<span class="marks"
    >${MARKS.filter((mark) => mark.has(row)).map(
      (mark) => html`<abbr title=${`${mark.about} ${mark.detail?.(row) ?? ""}`.trim()}>${signOf(mark, row)}</abbr> `,
    )}</span
  >`;

/** The same explanations as terms of a list, of the marks that rows have. @param {{rows: Row[]}} props */
export function Legend({ rows }) {
  const used = MARKS.map((mark) => ({ mark, row: rows.find((row) => mark.has(row)) })).filter((found) => found.row);
  return used.map(({ mark, row }) => html`<dt>${signOf(mark, row)}</dt><dd>${mark.about}</dd>`);
}

/** The details that distinguish players of one model. @param {{row: any}} props */
export const Settings = ({ row }) => {
  const parts = [
    row.temperature !== null && row.temperature !== undefined && `temperature ${row.temperature}`,
    row.top_p !== null && row.top_p !== undefined && `top p ${row.top_p}`,
    row.runs > 1 && `${row.runs} runs`,
  ].filter(Boolean);
  return html`<span class="muted small">
    ${row.owner && html`of <${Text} value=${row.owner} />${parts.length > 0 && ", "}`}${parts.join(", ")}
  </span>`;
};

/**
 * Whether the order of a row and the one above it is uncertain. @param {Row} row
 */
export const isTied = (row) => row.difference !== null && row.difference.low !== null && row.difference.low < 0;

/** The samples of a row in some tasks. @param {Row} row @param {string[]} tasks */
export const samples = (row, tasks) => tasks.map((task) => row.tasks[task] ?? {});

/**
 * The scale that intervals of a column share, which has 0.
 * @param {(ReturnType<typeof interval>)[]} intervals
 * @returns {[number, number]}
 */
export function scale(intervals) {
  const known = intervals.filter((one) => one !== null);
  const low = Math.min(0, ...known.map((one) => one.low ?? one.mean));
  const high = Math.max(0, ...known.map((one) => one.high ?? one.mean));
  return low === high ? [low, low + 1] : [low, high];
}

/**
 * A score, its deviation, and its interval, over that of the leader.
 * @param {{of: ReturnType<typeof interval>, deviation?: number | null, range: [number, number], name: string,
 *   leader?: ReturnType<typeof interval>}} props
 */
export function Score({ of, deviation, range, name, leader = null }) {
  if (!of) return html`<span class="muted">–</span>`;
  /** @type {[number, number] | null} */
  const band = leader?.low != null && leader.high != null ? [leader.low, leader.high] : null;
  const overlaps = band && leader !== of && of.high !== null && of.high >= band[0];
  const label = `${name}: ${of.low === null ? "no interval" : `95 % interval ${short(of.low)} to ${short(of.high)}`}${overlaps ? ", overlaps with that of the leader" : ""}`;
  return html`<span class="score" title=${label}>
    <span class="number">${of.mean.toFixed(2)}</span>${typeof deviation === "number" && html`<span class="number muted small"> ± ${deviation.toFixed(2)}</span>`}
    <${Interval} mean=${of.mean} low=${of.low ?? of.mean} high=${of.high ?? of.mean} range=${range} band=${band} label=${label} width=${104} />
  </span>`;
}
