// Starts games for people: settings and fellow players.
import { html, submits, useState } from "../ui.js";
import { visit } from "../app.js";
import { onceKey, remember, request, route } from "../api.js";
import { Choice } from "../parts/filters.js";
import { GOALS, TASKS } from "../parts/goals.js";
import { useTask } from "../parts/load.js";
import { HUMAN, NameField, Refused, allSeats, holdAll, playerName } from "./player.js";
import { claimSeat } from "./take.js";

/** Sizes by their names. @type {Record<string, Record<string, number>>} */
const SIZES = {
  small: { num_agents: 4, side: 8, max_round: 30 },
  standard: { num_agents: 12, side: 10, max_round: 100 },
  large: { num_agents: 24, side: 16, max_round: 100 },
};

const BANK_ROUNDS = 3;

const FIRST = { task: "Pursuit", ...SIZES.standard, seed: "", clock: "", beside: "built-in", player: "default", fill: "60", control: "decentralized", watch: true };

/** @param {URLSearchParams} query */
function settingsOf(query) {
  const given = Object.keys(FIRST).filter((name) => query.has(name));
  return { ...FIRST, ...Object.fromEntries(given.map((name) => [name, name === "watch" ? query.get(name) === "true" : query.get(name)])) };
}

const gameOf = (form) => ({
  task: form.task,
  num_agents: Number(form.num_agents),
  width: Number(form.side),
  height: Number(form.side),
  max_round: Number(form.max_round),
  control: form.control,
  ...(form.seed === "" ? {} : { seed: Number(form.seed) }),
  ...(form.clock ? { round_deadline_s: Number(form.clock), bank_s: BANK_ROUNDS * Number(form.clock) } : {}),
});

/** The holders of seats, as fields of a creation. @type {Record<string, (form: any) => object>} */
const SEATS = {
  "built-in": (form) => ({ player: form.player, open_seats: 1, visibility: "owner" }),
  others: (form) => ({
    model: playerName(),
    agent_meta: HUMAN,
    open_seats: Number(form.num_agents),
    fill_after_s: Number(form.fill),
    fill_with: form.player,
    visibility: form.watch ? "public" : "owner",
  }),
  nobody: () => ({ ...allSeats(), visibility: "owner" }),
};

/** Creates a game, and takes a seat of it, or all. Returns its id. @param {any} form */
async function createGame(form) {
  const body = { ...gameOf(form), ...SEATS[form.beside](form) };
  const game = await request("/api/v1/episodes", { method: "POST", body, idempotencyKey: onceKey() });
  if (form.beside === "nobody") return holdAll(game);
  remember(`creator:${game.id}`, game.swarm_token);
  try {
    await claimSeat(game.id, "", onceKey());
  } catch (error) {
    // A game in which its creator gets no seat is ended.
    await request(route`/api/v1/episodes/${game.id}`, { method: "DELETE", token: game.swarm_token }).catch(() => {});
    throw error;
  }
  return game.id;
}

/** Creates a run of a suite that one person plays, for its board. @param {string} suite */
async function createRun(suite) {
  const body = { suite, ...allSeats(), parallel: 1 };
  return holdAll(await request("/api/v1/runs", { method: "POST", body, idempotencyKey: onceKey() }));
}

/** Runs one creation at a time, then opens the seat. */
function useCreation() {
  const task = useTask();
  return { ...task, start: (/** @type {() => Promise<string>} */ create) => task.run(async () => visit(route`/play/${await create()}`)) };
}

/** @param {{query: URLSearchParams}} props */
export function NewGame({ query }) {
  const [form, setForm] = useState(/** @type {any} */ (() => settingsOf(query)));
  const { problem, isBusy, start } = useCreation();
  /** @param {object} change */
  const set = (change) => setForm((form) => ({ ...form, ...change }));
  return html`<form onSubmit=${submits(() => start(() => createGame(form)))} class="new-game">
    <fieldset><legend>Task</legend><${Choices} field="task" of=${TASKS.map((task) => [task, task, GOALS[task][0]])} form=${form} set=${set} /></fieldset>
    <fieldset><legend>Who plays the other seats</legend><${Beside} form=${form} set=${set} /></fieldset>
    <fieldset><legend>Size</legend><${Size} form=${form} set=${set} /></fieldset>
    <details><summary>More settings</summary><${More} form=${form} set=${set} /></details>
    <${NameField} />
    <p><button type="submit" class="primary" aria-disabled=${isBusy}>${isBusy ? "Starting …" : "Play"}</button></p>
    ${problem && html`<${Refused} problem=${problem} what="The game" />`}
  </form>`;
}

/** @type {[string, string, string][]} */
const BESIDE = [
  ["built-in", "Built-in players", "You hold one seat. The game begins at once."],
  ["others", "People and programs", "Each takes a seat. Built-in players take what is left."],
  ["nobody", "I do, in turn", "You decide for every agent, one after another, with what that agent sees."],
];

/** Values of a field, with their names and what they mean. @param {{field: string, of: [string, string, string][], form: any, set: (change: object) => void}} props */
const Choices = ({ field, of, form, set }) => of.map(([value, name, what]) => html`<label class="choice" key=${value}>
  <input type="radio" name=${field} checked=${form[field] === value} onChange=${() => set({ [field]: value })} />
  <span><b>${name}</b> <span class="muted">${what}</span></span>
</label>`);

/** @param {{form: any, set: (change: object) => void}} props */
const Beside = ({ form, set }) => html`<${Choices} field="beside" of=${BESIDE} form=${form} set=${set} />
  ${form.beside === "others" &&
  html`<div class="row">
    <label>Seconds until then <input type="number" min="0" max="604800" required value=${form.fill} onInput=${(event) => set({ fill: event.target.value })} /></label>
    <label><input type="checkbox" checked=${form.watch} onChange=${(event) => set({ watch: event.target.checked })} /> listed, and everybody may watch</label>
  </div>`}`;

/** @param {{form: any, set: (change: object) => void}} props */
function Size({ form, set }) {
  const isOf = (/** @type {Record<string, number>} */ size) => Object.entries(size).every(([field, value]) => Number(form[field]) === value);
  return html`<p class="buttons">
    ${Object.entries(SIZES).map(([name, size]) => html`<button type="button" key=${name} aria-pressed=${isOf(size)} onClick=${() => set(size)}>${name}</button>`)}
    <span class="muted">${form.num_agents} agents, ${form.side} × ${form.side} cells, ${form.max_round} rounds</span>
  </p>`;
}

/** @param {{form: any, set: (change: object) => void}} props */
function More({ form, set }) {
  const to = (/** @type {string} */ field) => (event) => set({ [field]: event.target.value });
  const number = (/** @type {string} */ field, /** @type {string} */ label, /** @type {number} */ min, /** @type {number} */ max) =>
    html`<label>${label} <input type="number" min=${min} max=${max} required value=${form[field]} onInput=${to(field)} /></label>`;
  const choice = (/** @type {string} */ field, /** @type {string} */ label, /** @type {(string | string[])[]} */ options) =>
    html`<${Choice} label=${label} value=${form[field]} options=${options} all=${null} onChange=${(/** @type {string} */ value) => set({ [field]: value })} />`;
  return html`<div class="row">
    ${number("num_agents", "Agents", 1, 1024)} ${number("side", "Cells on a side", 8, 256)} ${number("max_round", "Rounds", 1, 100_000)}
    <label>Seed <input inputmode="numeric" pattern="[0-9]*" placeholder="random" value=${form.seed} onInput=${to("seed")} /></label>
    <label>Seconds a round <input type="number" min="1" max="86400" placeholder="no clock" value=${form.clock} onInput=${to("clock")} /></label>
    ${choice("player", "Built-in player", [["default", "the task's own"], "random"])}
    ${choice("control", "Control", [["decentralized", "decentralized: small windows"], ["centralized", "centralized: Agent 0 commands"]])}
  </div>
  <p class="muted small">With a clock each seat also has a bank of ${BANK_ROUNDS} rounds. Who knows the seed can compute the map.</p>`;
}

/** The paper's human baselines: a suite, all seats in turn, on the board. */
export function NewRun() {
  const { problem, isBusy, start } = useCreation();
  return html`<h2>Be on a board</h2>
    <p>
      Play the suite <code>quick</code> alone: five tasks, 12 agents, 20 rounds each. You decide for every agent in turn, 1,200 times.
      You can stop and come back in the same tab. The result is on the board <a href="/board/quick">quick</a>, marked as human.
    </p>
    <p><button type="button" aria-disabled=${isBusy} onClick=${() => start(() => createRun("quick"))}>Play the suite quick</button></p>
    ${problem && html`<${Refused} problem=${problem} what="The run" />`}`;
}
