// A server with something on every page, with the texts that its users wrote.
import { spawnSync } from "node:child_process";
import { writeFile } from "node:fs/promises";
import path from "node:path";
import { competition, hosted, play, priced, run, smallSuite, spoken, spokenRun, talkative } from "./games.mjs";
import { BINARY } from "./program.mjs";

/**
 * Texts of strangers. Names have at most `chars` characters.
 * @typedef {object} Texts
 * @property {(what: string, chars?: number) => string} name
 * @property {(index: number) => string} message
 * @property {string} response
 * @property {string} reasoning
 * @property {string | undefined} template
 * @property {string} description
 * @property {string} terms
 * @property {string} reason
 * @property {object} meta
 */

/** @type {Texts} */
export const PLAIN = {
  name: (what) => what,
  message: (index) => ["I go up", "prey at (3,4)", "close from the left", "wait for me"][index % 4],
  response: "I look around and compare.",
  reasoning: "The prey is two cells to the left, and the agent beside me goes up.",
  template: undefined,
  description: "Two tasks on layouts that nobody knows. Do not pool what your agents see.",
  terms: "One entrant for each team.\nDo not pool what your agents see.",
  reason: "the disk was full",
  meta: { prompt: "v3", temperature_note: "as served" },
};

/** One of this many answers is invalid. */
const INVALID_EVERY = 97;

/** The time that a short competition is open: its games are played by then. */
const SHORT_MS = 6_000;

/**
 * @param {import("./program.mjs").Program} program with keys
 * @param {Texts} [texts]
 */
export async function full(program, texts = PLAIN) {
  const closed = shortCompetition(program, texts);
  const agents = { agent_meta: texts.meta, ...(texts.template && { prompt_template: texts.template }) };
  const decide = speaks(texts);

  const built = await run(program, { suite: smallSuite(), model: texts.name("careful walker") });
  await run(program, { suite: smallSuite(), player: "random", model: texts.name("wanderer") });
  const named = await run(program, { suite: { ...smallSuite(), name: texts.name("forest", 60) }, model: texts.name("explorer") });
  const row = (await program.get(`/api/v1/leaderboard?suite=small`)).items[0].id;
  const team = await models(program, texts, built);
  const model = texts.name("gpt-x", 200);
  const shown = { task: "Foraging", seed: 27, max_round: 60 };
  const known = await actionsOf(program, await hosted(program, { ...shown, model: texts.name("teacher") }));
  const talk = await spoken(program, { ...shown, model, ...agents }, { decide: speaks(texts, known) });
  const same = { task: "Foraging", seed: 42, max_round: 60 };
  const first = await hosted(program, { ...same, model: texts.name("first") });
  const second = await hosted(program, { ...same, player: "random", model: texts.name("second") });
  const live = await spoken(
    program,
    { task: "Synchronization", seed: 57, num_agents: 6, model: texts.name("still playing"), ...agents },
    { decide, rounds: 12 },
  );
  const voided = await hosted(program, { task: "Flocking", seed: 7, num_agents: 4, max_round: 10 });
  await program.post(`/api/v1/episodes/${voided}/void`, { reason: texts.reason });
  const mixed = await program.post("/api/v1/episodes", {
    ...{ task: "Foraging", seed: 3, num_agents: 4, max_round: 20, player: "default", open_seats: 1, visibility: "public" },
    model: texts.name("host of a mixed game"),
  });
  await program.post("/api/v1/keys", { name: texts.name("team blue") });
  const cup = await openCompetition(program, texts);
  const games = { built, named, row, team, talk: talk.id, first, second, live, voided, mixed: mixed.id, cup, closed: await closed };
  return { ...games, imported: await importOf(program, talk.id) };
}

/**
 * Runs of models that report what they cost: one with a harness, and one of a team. Returns the id of the last.
 * @param {import("./program.mjs").Program} program @param {Texts} texts @param {string} taught a run of the same games, whose choices they know
 */
async function models(program, texts, taught) {
  const suite = smallSuite();
  const harness = { history: 2, scratchpad: 200 };
  const gamesOf = async (/** @type {string} */ run) => (await program.get(`/api/v1/runs/${run}`)).games;
  const nameOf = (/** @type {any} */ { task, seed }) => `${task} ${seed}`;
  const choices = new Map(await Promise.all((await gamesOf(taught)).map(async (/** @type {any} */ game) => [nameOf(game), await actionsOf(program, game.episode)])));
  /** Plays as it was taught for some rounds. @param {number} rounds @param {number} cost */
  const decide = (rounds, cost) => async (/** @type {number} */ _, /** @type {string} */ run) => {
    const known = (/** @type {any} */ game) => Object.fromEntries(Object.entries(choices.get(nameOf(game)) ?? {}).filter(([name]) => Number.parseInt(name) < rounds));
    const speakers = new Map((await gamesOf(run)).map((/** @type {any} */ game) => [game.episode, priced(speaks(texts, known(game)), cost)]));
    return (/** @type {any} */ observation) => speakers.get(observation.episode)(observation);
  };
  await spokenRun(program, { suite, model: texts.name("model-small") }, decide(8, 40_000));
  await spokenRun(program, { suite, model: texts.name("model-mid") }, decide(12, 1_100_000));
  const large = decide(20, 9_000_000);
  await spokenRun(program, { suite, model: texts.name("model-large"), temperature: 0.5, agent_meta: { eval: { effort: "low", harness } } }, large);
  const holders = [
    { model: texts.name("model-small"), seats: [0, 1, 2, 3] },
    { model: texts.name("model-large"), seats: [4, 5], agent_meta: { eval: { harness } } },
  ];
  const players = [decide(8, 40_000), large];
  return (await spokenRun(program, { suite, model: texts.name("four and two"), holders }, (holder, run) => players[holder](holder, run))).id;
}

/**
 * The choices of all agents in all rounds of a game.
 * @param {import("./program.mjs").Program} program
 * @param {string} id
 * @returns {Promise<Record<string, string>>}
 */
async function actionsOf(program, id) {
  const { states } = await program.get(`/api/v1/episodes/${id}/replay`);
  const names = { U: "UP", D: "DOWN", L: "LEFT", R: "RIGHT", S: "STAY", X: "SWITCH" };
  const chosen = states.flatMap(({ round, actions = "" }) =>
    [...actions].map((letter, agent) => [`${round - 1}/Agent_${agent}`, names[/** @type {keyof typeof names} */ (letter)] ?? ""]),
  );
  return Object.fromEntries(chosen);
}

/**
 * Answers like those of a language model, with the texts; with the action of `known`, if it has one.
 * @param {Texts} texts
 * @param {Record<string, string>} [known]
 */
function speaks(texts, known = {}) {
  const draw = talkative(27);
  let count = 0;
  return (/** @type {any} */ observation) => {
    const drawn = draw(observation);
    count += 1;
    const chosen = known[`${observation.round}/${observation.agent}`];
    const action = chosen ? `ACTION: ${chosen}` : (/ACTION: \w+/.exec(drawn.response)?.[0] ?? "");
    const answer = count % INVALID_EVERY === 0 ? "" : `${action}\nMSG: ${texts.message(count)}`;
    const response = `${texts.response}\n${answer}`;
    return { ...drawn, response, reasoning: texts.reasoning };
  };
}

/** @param {import("./program.mjs").Program} program @param {Texts} texts */
async function openCompetition(program, texts) {
  const categories = [texts.name("models", 40), texts.name("people", 40)];
  const made = await competition(program, {
    ...{ name: texts.name("Spring cup"), description: texts.description, spares: 1 },
    ...{ terms: texts.terms, categories, tie_breaks: ["invalid", "earliest"] },
    suite: { tasks: ["Pursuit", "Foraging"], seeds: 2, public_seeds: 1, settings: { num_agents: 4, max_round: 10 } },
  });
  const base = `/api/v1/competitions/${made.id}`;
  const later = new Date(Date.parse(made.closes_at) + 3_600_000).toISOString();
  await program.call("PATCH", base, { body: { name: texts.name("Spring cup again"), closes_at: later, reason: texts.reason } });
  for (const who of ["blue", "red"]) {
    const category = categories[who === "blue" ? 0 : 1];
    const key = await enter(program, base, texts, who, { category, accepts_terms: 1, contact: texts.name(`${who} at example.org`) });
    const { swarm_token: token } = await program.post(`${base}/attempts`, {}, { token: key });
    await play(program, token, speaks(texts), who === "blue" ? Infinity : 3);
  }
  const { items } = await program.get(`${base}/entrants`);
  await program.call("PATCH", `${base}/entrants/${items[0].id}`, {
    body: { status: "disqualified", reason: texts.reason },
  });
  await program.post(`${base}/entrants/${items[1].id}/members`, { name: texts.name("Ada") });
  await program.call("PATCH", base, { body: { terms: `${texts.terms} The logs are published.` } });
  await program.post(`${base}/codes`, { labels: [texts.name("team green")] });
  return made.id;
}

/** A competition that is over when this returns. @param {import("./program.mjs").Program} program @param {Texts} texts */
async function shortCompetition(program, texts) {
  const closes = Date.now() + SHORT_MS;
  const made = await competition(program, {
    name: texts.name("Winter cup"),
    description: texts.description,
    closes_at: new Date(closes).toISOString(),
    clocks: { round_deadline_s: 1 },
  });
  const base = `/api/v1/competitions/${made.id}`;
  const key = await enter(program, base, texts, "grey");
  const { run: id, swarm_token: token } = await program.post(`${base}/attempts`, {}, { token: key });
  await play(program, token, speaks(texts));
  await program.get(`/api/v1/runs/${id}/events`, { text: true });
  for (;;) {
    const { phase } = await program.get(base);
    if (phase === "closed") return made.id;
    await new Promise((resolve) => setTimeout(resolve, 200));
  }
}

/**
 * @param {import("./program.mjs").Program} program
 * @param {string} base
 * @param {Texts} texts
 * @param {string} who
 * @param {object} [more] what the competition asks for
 */
async function enter(program, base, texts, who, more) {
  const body = { name: texts.name(who), model: texts.name(`model of ${who}`), agent_meta: texts.meta, ...more };
  // Sent without the organizer's key: an entrant gets a key of its own.
  const { key } = await program.post(`${base}/entrants`, body, { token: "" });
  return key;
}

/** A game as it comes back from a file. @param {import("./program.mjs").Program} program @param {string} id */
async function importOf(program, id) {
  const answer = await fetch(`${program.url}/api/v1/exports/dataset.zip?episode=${id}`);
  const file = path.join(program.folder, "games.zip");
  await writeFile(file, Buffer.from(await answer.arrayBuffer()));
  await program.restart(async () => {
    const done = spawnSync(BINARY, ["import", file, "--db", program.database]);
    if (done.status !== 0) throw new Error(`not imported: ${done.stderr}`);
  });
  return (await program.get("/api/v1/imports")).items[0].id;
}

/**
 * Every page, with something on it. `needsKey`: an organizer's; `unfolds`: the summary of what is opened on it.
 * @type {{name: string, address: (data: Awaited<ReturnType<typeof full>>) => string, needsKey?: boolean, unfolds?: string}[]}
 */
export const PLACES = [
  { name: "front", address: () => "/" },
  { name: "boards", address: () => "/boards" },
  { name: "board", address: () => "/board/small" },
  { name: "costs", address: () => "/board/small", unfolds: "Score against cost" },
  { name: "player", address: ({ row }) => `/board/small/${encodeURIComponent(row)}` },
  { name: "runs", address: () => "/runs" },
  { name: "run", address: ({ built }) => `/runs/${built}` },
  { name: "team", address: ({ team }) => `/runs/${team}` },
  { name: "games", address: () => "/episodes" },
  { name: "game", address: ({ talk }) => `/episodes/${talk}#r=31&a=2` },
  { name: "live", address: ({ live }) => `/episodes/${live.id}` },
  { name: "voided", address: ({ voided }) => `/episodes/${voided}` },
  { name: "embedded", address: ({ talk }) => `/embed/episodes/${talk}` },
  { name: "imports", address: () => "/imports" },
  { name: "import", address: ({ imported }) => `/imports/${imported}` },
  { name: "compare", address: ({ first, second }) => `/compare?a=${first}&b=${second}` },
  { name: "play", address: () => "/play" },
  { name: "seat", address: ({ mixed }) => `/play/${mixed}`, needsKey: true },
  { name: "competitions", address: () => "/competitions" },
  { name: "competition", address: ({ cup }) => `/competitions/${cup}` },
  { name: "revealed", address: ({ closed }) => `/competitions/${closed}` },
  { name: "desk", address: () => "/desk", needsKey: true },
  { name: "desk-keys", address: () => "/desk?view=keys", needsKey: true },
  { name: "desk-games", address: () => "/desk?view=games", needsKey: true },
  { name: "desk-audit", address: () => "/desk?view=audit", needsKey: true },
  { name: "desk-create", address: () => "/desk?view=create", needsKey: true },
  { name: "desk-cup", address: ({ cup }) => `/desk?view=competition&id=${cup}`, needsKey: true },
  { name: "missing", address: () => "/nowhere" },
];

/** Opens what is folded on a place, and shows it. @param {import("playwright-core").Page} page @param {string | undefined} summary */
export async function unfold(page, summary) {
  if (!summary) return;
  const folded = page.getByText(summary, { exact: true });
  await folded.click();
  await folded.evaluate((summary) => summary.scrollIntoView());
  await page.getByText("Loading …").first().waitFor({ state: "hidden" });
}

/** Tells the watch which faults a place causes. @param {string} name */
export const expectedAt = (name) => (name === "missing" ? [/404.*\/nowhere|404.*\(Not Found\) \(.*\/nowhere/] : []);
