// Messages of built-in players: codes for players of the same kind (crates/players), in words.
import { html } from "../ui.js";

/** Said where people read them. */
export const CODES_HELP = "Built-in players say codes that only their like understand. What a code means stands behind it.";

/** @type {[RegExp, (numbers: string[]) => string][]} */
const CODES = [
  [/^Prey at (\d+) (\d+) in round (\d+)$/, ([i, j, round]) => `the prey was in row ${i}, column ${j} in round ${round}`],
  [/^Food and nest at (\d+) (\d+) (\d+) (\d+)$/, ([i, j, k, l]) => `food is in row ${i}, column ${j}, the nest in row ${k}, column ${l}`],
  [/^(Food|Nest) at (\d+) (\d+)$/, ([what, i, j]) => `${what === "Food" ? "food" : "the nest"} is in row ${i}, column ${j}`],
  [/^Beat of (\d+) ([01])$/, ([leader, light]) => `agent ${leader} sets the beat: lights go ${light === "1" ? "on" : "off"} in the round in which it was said`],
  [/^Square around (\d+) (\d+)$/, ([i, j]) => `the square is formed around row ${i}, column ${j}`],
  [/^Swarm (\d+) (\d+) (\d+)((?: \d+)*)$/,
    ([round, exits, pushes, seen]) => `in round ${round}: ${count(Number(exits).toString(2).split("1").length - 1, "possible gap")}, ${count(Number(pushes), "push", "es")} of the block, places of ${count(seen.split(" ").length - 1, "agent")}`],
];

/** @param {number} number @param {string} name @param {string} [ending] */
const count = (number, name, ending = "s") => `${number} ${name}${number === 1 ? "" : ending}`;

/** Characters of the news of `corner-traps`: numbers from `!` (0) to `~` (93). */
const [FIRST, BASE] = [33, 94];

/** The length of news without agents, and characters of each agent. */
const [NEWS, AGENT] = [8, 4];

/** News of `corner-traps`, whose last two characters are checks. @param {string} text */
function news(text) {
  if (!/^S[!-~]+$/.test(text) || text.length < NEWS || text.length % AGENT !== 0) return "";
  const codes = [...text].map((sign) => sign.charCodeAt(0));
  const checks = [3, 5].map((weight) => FIRST + codes.slice(0, -2).reduce((sum, code) => (sum * weight + code) % BASE, 0));
  if (String(checks) !== String(codes.slice(-2))) return "";
  const [i, j, ago] = codes.slice(3, 6).map((code) => code - FIRST);
  const prey = ago === BASE - 1 ? "the prey is not found" : `the prey was in row ${i}, column ${j} ${count(ago, "round")} before`;
  return `${prey}; places of ${count((text.length - NEWS) / AGENT, "agent")}`;
}

/** What a code of a built-in player means; empty for every other text. @param {string} text */
export function meaning(text) {
  for (const [pattern, words] of CODES) {
    const found = pattern.exec(text);
    if (found) return words(found.slice(1));
  }
  return news(text);
}

/** @param {{text: string}} props */
export const Meaning = ({ text }) => meaning(text) && html`<span class="muted small">(${meaning(text)})</span>`;
