// Running games are followed, by one tab and by many.
import assert from "node:assert/strict";
import { open } from "./support/browser.mjs";
import { play, spoken, talkative } from "./support/games.mjs";
import { suite } from "./support/suite.mjs";

/** Browsers have six connections to a server over HTTP/1.1. */
const TABS = 20;

const SETTINGS = { task: "Synchronization", num_agents: 3, max_round: 2_000, model: "walker" };

const { visit } = suite({}, async () => ({}));

/** @typedef {import("./support/program.mjs").Program} Program */
/** @typedef {import("playwright-core").Page} Page */

/** A game of which some rounds are played. @param {Program} program @param {number} rounds @param {object} [settings] */
const running = (program, rounds, settings) => spoken(program, { ...SETTINGS, seed: rounds, ...settings }, { rounds });

/** @param {Page} page @param {number} round */
const roundIs = (page, round) => page.getByRole("img", { name: new RegExp(`^Map\\. Round ${round}\\.`) }).waitFor();

/** @param {Page} page @param {string} name */
const button = (page, name) => page.getByRole("main").getByRole("button", { name, exact: true });

/** Tabs of one browser. @param {import("playwright-core").BrowserContext} context @param {string[]} addresses */
const tabs = (context, addresses) => Promise.all(addresses.map(async (address) => {
  const page = await context.newPage();
  await open(page, address);
  return page;
}));

visit("twenty tabs follow one game", async ({ context }, { program }) => {
  const { id, token } = await running(program, 2);
  const pages = await tabs(context, Array(TABS).fill(`/episodes/${id}`));
  await Promise.all(pages.map((page) => roundIs(page, 1)));
  await play(program, token, talkative(1), 5);
  await Promise.all(pages.map((page) => roundIs(page, 4)));
});

visit("twenty tabs follow twenty games", async ({ context }, { program }) => {
  const games = await Promise.all(Array.from({ length: TABS }, () => running(program, 1)));
  const pages = await tabs(context, games.map(({ id }) => `/episodes/${id}`));
  for (const rounds of [4, 6]) {
    await Promise.all(games.map(({ token }) => play(program, token, talkative(1), rounds)));
    await Promise.all(pages.map((page) => roundIs(page, rounds - 1)));
  }
  // All tabs but one are closed: their streams go to others.
  await Promise.all(pages.slice(1).map((page) => page.close()));
  await play(program, games[0].token, talkative(1), 8);
  await roundIs(pages[0], 7);
});

visit("tabs of a browser without shared workers ask now and then", async ({ context }, { program }) => {
  await context.addInitScript(() => void delete (/** @type {any} */ (globalThis).SharedWorker));
  const { id, token } = await running(program, 2);
  const pages = await tabs(context, Array(8).fill(`/episodes/${id}`));
  await play(program, token, talkative(1), 5);
  await Promise.all(pages.map((page) => roundIs(page, 4)));
});

visit("a tab gets only what its own token may read", async ({ page, context, watch }, { program }) => {
  const { id, token } = await running(program, 2, { visibility: "owner" });
  await page.goto("/");
  await page.evaluate(([name, value]) => sessionStorage.setItem(name, value), [`swarmbench:token:${id}`, token]);
  await open(page, `/episodes/${id}`);
  await roundIs(page, 1);
  watch.expect(/40[134]/);
  const other = await context.newPage();
  await open(other, `/episodes/${id}`);
  await other.getByRole("main").getByText(/private|creator|found/i).first().waitFor();
  await play(program, token, talkative(1), 4);
  await roundIs(page, 3);
  assert.equal(await other.getByRole("img", { name: /^Map/ }).count(), 0);
});

visit("a running game shows the newest round that is decided", async ({ page }, { program }) => {
  const { id, token } = await running(program, 6);
  await open(page, `/episodes/${id}#a=1`);
  await roundIs(page, 5);
  await page.getByText("of 2,000").waitFor();
  await page.getByText("● live").waitFor();
  const panel = page.getByRole("region", { name: "Agent 1" });
  await panel.getByText(/^(UP|DOWN|LEFT|RIGHT|STAY|SWITCH)$/).waitFor();
  await page.getByText("Said in round 5").waitFor();
  assert.equal(await page.getByText("nothing has been said").count(), 0);

  await page.keyboard.press("Home");
  await roundIs(page, 0);
  await page.getByText("live", { exact: true }).waitFor();
  await page.keyboard.press("End");
  await page.getByText("● live").waitFor();
  await play(program, token, talkative(2), 8);
  await roundIs(page, 7);

  await page.keyboard.press("ArrowLeft");
  await page.keyboard.press("ArrowLeft");
  await roundIs(page, 5);
  await button(page, "Play").click();
  await roundIs(page, 7);
  await button(page, "Play").waitFor();
  await play(program, token, talkative(3), 10);
  await roundIs(page, 9);
});

visit("a game that waits for its players is not said to be live", async ({ page }, { program }) => {
  const { id } = await program.post("/api/v1/episodes", { task: "Foraging", seed: 3, num_agents: 4, max_round: 20, player: "default", open_seats: 1, visibility: "public" });
  await open(page, `/episodes/${id}`);
  await roundIs(page, 0);
  await page.getByText("This game waits for players.").waitFor();
  assert.equal(await page.getByText(/^(● )?live$/).count(), 0);
});
