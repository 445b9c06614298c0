// What pages say of models: what they cost, the harness around a prompt, teams and who has their seats, games that were played again.
import assert from "node:assert/strict";
import { open } from "./support/browser.mjs";
import { play as again, priced, spokenRun } from "./support/games.mjs";
import { suite } from "./support/suite.mjs";

const SUITE = { name: "priced", tasks: ["Synchronization"], seeds: [1, 2, 3], settings: { num_agents: 2, max_round: 4 } };

const HARNESS = { history: 1, scratchpad: 200, retries_on_invalid: 1 };

/** All lights on, then off, and so on: a point a round, as often as `isGood` says. @param {(round: number) => boolean} isGood */
const decides = (isGood) => (/** @type {any} */ { round, light_on: isOn }) => {
  const action = isOn === (round % 2 === 0) ? "STAY" : "SWITCH";
  return { response: `ACTION: ${isGood(round) ? action : "STAY"}`, usage: { prompt_tokens: 900, completion_tokens: 40, latency_ms: 700 } };
};

const good = decides(() => true);
const bad = decides(() => false);

/** What a program put around the prompts of a round. @param {any} observation */
const withHarness = (observation) => {
  const { round } = observation;
  const harness = { history: round > 0 ? [round - 1] : [], added: `You keep notes. (round ${round})`, scratchpad: `seen in ${round}`,
    tries: round === 1 ? [{ response: "I cannot decide.", told: "An action is missing." }] : [] };
  return { ...good(observation), harness };
};

const { visit } = suite({}, async (program) => {
  /** @param {string} model @param {any} decide @param {any} [cost] @param {object} [more] */
  const play = (model, decide, cost, more) => spokenRun(program, { suite: SUITE, model, ...more }, () => priced(decide, cost));
  await play("cheap", bad, 1_000);
  const dear = await play("dear", good, 90_000_000);
  await play("wasteful", bad, 90_000_000);
  await play("half told", good, ({ round }) => (round % 2 ? 50_000 : undefined));
  await play("silent", bad);
  const harnessed = await play("dear", withHarness, 120_000_000, { agent_meta: { eval: { effort: "low", extra: { top_k: 20 }, harness: HARNESS } } });
  const holders = [
    { model: "cheap", seats: [0], agent_meta: { eval: { harness: HARNESS } } },
    { model: "dear", seats: [1], temperature: 0.5 },
  ];
  const team = await spokenRun(program, { suite: SUITE, model: "one and one", holders }, (holder) => priced(holder ? good : bad, 1_000_000));
  const { games } = await program.get(`/api/v1/runs/${dear.id}`);
  const repeated = games[0].episode;
  await program.post(`/api/v1/episodes/${repeated}/repeat`, { reason: "the endpoint was ill" }, { token: dear.token });
  await again(program, dear.token, priced(good, 90_000_000));
  return { dear, harnessed, team, repeated, first: games[1].episode };
});

/** @param {import("playwright-core").Page} page @param {string} name */
const rowOf = (page, name) => page.locator("table.board tbody tr", { has: page.getByRole("rowheader", { name }) });

visit("a board has costs, sampling and prompts, and teams apart with who has their seats", async ({ page }) => {
  await open(page, "/board/priced");
  await page.getByRole("columnheader", { name: "$ a game" }).waitFor();
  assert.match(await rowOf(page, "wasteful").innerText(), /\t0\.72\t/);
  assert.match(await rowOf(page, "cheap").first().innerText(), /\t0\.000008\t/);
  assert.match(await rowOf(page, "half told").innerText(), /\t≥ 0\.0002\t/);
  assert.match(await rowOf(page, "silent").innerText(), /\t–\t/);
  await page.getByText("effort low, top_k 20").waitFor();
  await page.getByText(/prompt default\+harness:history=1,retries_on_invalid=1,scratchpad=200/).waitFor();
  const parts = page.locator("tr.part");
  assert.deepEqual(await parts.allInnerTexts(), ["Models", "Teams"]);
  await rowOf(page, "one and one").getByText("seats: cheap 0; dear 1").waitFor();
  await page.getByLabel("Teams").uncheck();
  await page.getByText("one and one").waitFor({ state: "hidden" });
});

visit("a figure of score against cost is read when it is opened, names what no other beats, and leads to rows", async ({ page }) => {
  const read = /** @type {string[]} */ ([]);
  page.on("request", (request) => read.push(new URL(request.url()).pathname));
  await open(page, "/board/priced");
  assert.equal(read.filter((path) => path.endsWith("/costs.js")).length, 0);
  await page.getByText("Score against cost").click();
  const figure = page.getByRole("group", { name: "Score against cost of 6 rows" });
  await figure.waitFor();
  const labels = await figure.getByRole("link").evaluateAll((links) => links.map((link) => link.getAttribute("aria-label") ?? ""));
  const best = labels.filter((label) => label.endsWith("none scores more for as little"));
  assert.deepEqual(best.map((label) => label.split(":")[0]).toSorted(), ["cheap", "dear"]);
  assert.ok(labels.some((label) => label.startsWith("half told: 4 for at least $0.0002")), labels.join("\n"));
  assert.ok(!labels.some((label) => label.startsWith("silent")));
  await figure.getByText("$ a game, by powers of ten").waitFor();
  assert.equal(await figure.getByText("dear", { exact: true }).count() > 0, true);
  assert.equal(await page.locator(".costs + p + p + ol > li").count(), 2);
  for (const width of [380, 800, 1440]) {
    await page.setViewportSize({ width, height: 900 });
    await page.waitForFunction((width) => Number(document.querySelector(".costs svg")?.getAttribute("width")) < width, width);
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `${width} px`);
  }
  await figure.getByRole("link", { name: /^wasteful/ }).focus();
  await page.keyboard.press("Enter");
  await page.getByRole("heading", { level: 1, name: "wasteful" }).waitFor();
});

visit("rows of one cost, and rows that are free, have places in the figure", async ({ page }) => {
  /** The board with these costs. @param {(number | undefined)[]} costs */
  const shown = async (costs) => {
    await page.route("**/api/v1/leaderboard?*", async (route) => {
      const board = await (await route.fetch()).json();
      board.items = board.items.slice(0, costs.length).map((/** @type {any} */ row, /** @type {number} */ place) => ({ ...row, cost_usd: costs[place], costs_are_whole: true }));
      await route.fulfill({ json: board });
    });
    await open(page, "/board/priced");
    await page.getByText("Score against cost").click();
    const marks = page.locator(".costs a");
    await marks.first().waitFor();
    const places = await marks.evaluateAll((marks) => marks.map((mark) => mark.getBoundingClientRect().x));
    const drawn = await page.locator(".costs svg").evaluate((figure) => figure.outerHTML);
    assert.doesNotMatch(drawn, /NaN|Infinity/);
    await page.unroute("**/api/v1/leaderboard?*");
    return places;
  };
  assert.equal((await shown([0.5, 0.5])).length, 2);
  assert.equal((await shown([0, 0])).length, 2);
  const [free, cheap, dear] = await shown([0, 0.0001, 1]);
  assert.ok(free < cheap && cheap < dear);
  await page.getByText("$ a game, by powers of ten").waitFor();
});

visit("a run of a team says who has which seats, what it cost, and gives each holder a new token", async ({ page }, { data, program }) => {
  await open(page, `/runs/${data.team.id}`);
  const table = page.getByRole("region", { name: "Holders of the team" });
  assert.deepEqual((await table.locator("tbody tr").allInnerTexts()).map((row) => row.split("\t")), [
    ["cheap", "0", "cheap", "–", "default+harness:history=1,retries_on_invalid=1,scratchpad=200"],
    ["dear", "1", "dear", "temperature 0.5", "default"],
  ]);
  await page.getByText("12,288 of them from a cache; 960 of answers, 288 of them reasoning").waitFor();
  await page.getByText("$0.024", { exact: true }).waitFor();
  await page.getByRole("button", { name: "New token of dear" }).click();
  await page.getByRole("dialog").getByRole("button", { name: "New token of dear" }).click();
  const made = await page.getByRole("group", { name: "New token of dear" }).innerText();
  const token = String(/swarm_\w+/.exec(made));
  assert.equal((await program.get("/swarm/obs", { token })).finished, true);
});

visit("a team's game, over, says who had its seats", async ({ page }, { data, program }) => {
  const { games } = await program.get(`/api/v1/runs/${data.team.id}`);
  await open(page, `/episodes/${games[0].episode}`);
  const seats = page.getByRole("region", { name: "Seats" });
  await seats.getByText("dear").waitFor();
  assert.equal(await seats.locator("tbody tr").count(), 2);
});

visit("a game that was played again is named with its reason and the game in its place", async ({ page }, { data }) => {
  await open(page, `/runs/${data.dear.id}`);
  const failed = page.getByRole("listitem").filter({ hasText: "played again: the endpoint was ill" });
  const next = failed.getByRole("link").nth(1);
  await failed.getByText("In its place:").waitFor();
  const address = String(await next.getAttribute("href"));
  assert.notEqual(address, `/episodes/${data.repeated}`);
  await open(page, `/episodes/${data.repeated}`);
  await page.getByRole("heading", { name: "This game was voided" }).waitFor();
  assert.equal(await page.getByRole("link", { name: "the game that was played again" }).getAttribute("href"), address);
});

visit("a game shows what was around a prompt, and what an answer cost", async ({ page }, { data, program }) => {
  const { games } = await program.get(`/api/v1/runs/${data.harnessed.id}`);
  await open(page, `/episodes/${games[0].episode}#r=1&a=0`);
  await page.getByText("900 tokens read (512 cached), 40 written (12 reasoning), $0.12, 0.7 s, first token 0.1 s").waitFor();
  await page.getByRole("button", { name: "Prompt", exact: true }).click();
  await page.getByText("Before it came the prompts and answers of this agent in round 0.").waitFor();
  assert.equal(await page.getByRole("region", { name: "Added to the prompt" }).innerText(), "You keep notes. (round 1)");
  assert.equal(await page.getByRole("region", { name: "Invalid answer 1" }).innerText(), "I cannot decide.\n\n→ An action is missing.");
  assert.equal(await page.getByRole("region", { name: "Notes" }).innerText(), "seen in 1");
});

visit("a player's page has the runs of its row alone", async ({ page }, { data, program }) => {
  const { items } = await program.get("/api/v1/leaderboard?suite=priced");
  const row = items.find((/** @type {any} */ { run }) => run === data.harnessed.id);
  await open(page, `/board/priced/${row.id}`);
  await page.getByRole("heading", { name: "Games of this run" }).waitFor();
  assert.equal(await page.getByRole("heading", { name: "Runs with this model and these settings" }).count(), 0);
  const team = items.find((/** @type {any} */ { kind }) => kind === "team");
  await open(page, `/board/priced/${team.id}`);
  await page.getByText("seats: cheap 0; dear 1").waitFor();
  await page.getByRole("region", { name: "Holders of the team" }).waitFor();
});
