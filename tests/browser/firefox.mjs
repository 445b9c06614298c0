// The pages in Firefox: every page is whole and refuses nothing of its own, games are watched, followed by many tabs, and played.
import assert from "node:assert/strict";
import { play, spoken, talkative } from "./support/games.mjs";
import { roundIs, said, suite } from "./support/firefox.mjs";
import { PLACES, full } from "./support/site.mjs";

/** Browsers have six connections to a server over HTTP/1.1. */
const TABS = 20;

const WIDTHS = [380, 800, 860, 1440];

const LIVE = { task: "Synchronization", num_agents: 3, max_round: 2_000, model: "walker" };

const { visit } = suite({ keys: true }, full);

/** @typedef {import("./support/program.mjs").Program} Program */

/** A game of which some rounds are played. @param {Program} program @param {number} rounds */
const running = (program, rounds) => spoken(program, { ...LIVE, seed: rounds }, { rounds });

for (const { name, address } of PLACES.filter(({ needsKey }) => !needsKey)) {
  visit(`${name}: is whole at every width`, async (visitor, { data }) => {
    if (name === "missing") visitor.expected = [/404/];
    const page = await visitor.tab(address(data));
    for (const width of WIDTHS) {
      await page.setViewport({ width, height: 800 });
      const over = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
      assert.ok(over <= 1, `${width} px: ${over} px too wide`);
    }
  });
}

visit("a game is watched: keys, its scrubber, a link to a moment", async (visitor, { data }) => {
  const page = await visitor.tab(`/episodes/${data.talk}#r=31&a=2`);
  await roundIs(page, 31);
  await page.keyboard.press("ArrowRight");
  await roundIs(page, 32);
  await page.keyboard.press("End");
  await roundIs(page, 60);
  await page.keyboard.press("Home");
  await roundIs(page, 0);
  const { x, y, width, height } = await page.$eval(".scrubber .curve", (curve) => curve.getBoundingClientRect().toJSON());
  await page.mouse.click(x + width / 2, y + height / 2);
  await roundIs(page, 30);
  await page.waitForFunction(() => location.hash.includes("r=30"), { polling: 100 });
});

/** Tabs of one browser, opened one after the other. @param {any} visitor @param {string[]} addresses */
async function tabs(visitor, addresses) {
  const pages = [];
  for (const address of addresses) pages.push(await visitor.tab(address));
  return pages;
}

/** Looks at one tab after another: those in the background read nothing. @param {import("puppeteer-core").Page[]} pages @param {number} round */
async function allShow(pages, round) {
  for (const page of pages) {
    await page.bringToFront();
    await roundIs(page, round);
  }
}

visit("twenty tabs follow one game", async (visitor, { program }) => {
  const { id, token } = await running(program, 2);
  const pages = await tabs(visitor, Array(TABS).fill(`/episodes/${id}`));
  await allShow(pages, 1);
  await play(program, token, talkative(1), 5);
  await allShow(pages, 4);
});

visit("twenty tabs follow twenty games", async (visitor, { program }) => {
  const games = await Promise.all(Array.from({ length: TABS }, () => running(program, 1)));
  const pages = await tabs(visitor, games.map(({ id }) => `/episodes/${id}`));
  for (const rounds of [4, 6]) {
    await Promise.all(games.map(({ token }) => play(program, token, talkative(1), rounds)));
    await allShow(pages, rounds - 1);
  }
});

visit("a running game is followed to a round that is decided", async (visitor, { program }) => {
  const { id, token } = await running(program, 6);
  const page = await visitor.tab(`/episodes/${id}#a=1`);
  await roundIs(page, 5);
  await said(page, "● live");
  await said(page, "Said in round 5");
  await page.keyboard.press("Home");
  await roundIs(page, 0);
  await page.keyboard.press("End");
  await play(program, token, talkative(2), 8);
  await roundIs(page, 7);
});

visit("the front page plays a game, and leads to it", async (visitor) => {
  const page = await visitor.tab("/");
  await page.waitForSelector("main .map");
  await page.click("main a.button.primary");
  await page.waitForFunction(() => location.pathname.startsWith("/episodes/"), { polling: 100 });
  await page.waitForSelector('[role="img"][aria-label^="Map. Round"]');
});
