// Pages look the same however one comes to them, and show everything at every width.
import assert from "node:assert/strict";
import { NARROW, open, settled } from "./support/browser.mjs";
import { hosted, priced, run, smallSuite, spoken, talkative } from "./support/games.mjs";
import { suite } from "./support/suite.mjs";

const { visit } = suite({}, async (program) => {
  await run(program, { suite: smallSuite(), model: "walker" });
  const game = { task: "Foraging", seed: 42, max_round: 20 };
  const talk = await spoken(program, { task: "Pursuit", seed: 27, max_round: 10, num_agents: 4 }, { decide: priced(talkative(27), 4_280_000) });
  return { first: await hosted(program, game), second: await hosted(program, { ...game, player: "random" }), talk: talk.id };
});

/** The time in which nothing moves on a page that has loaded all. */
const REST_MS = 500;

/** Widths between a phone and a desk. */
const WIDTHS = [380, 760, 761, 800, 860, 861, 960];

for (const path of ["/episodes/", "/embed/episodes/"]) {
  visit(`${path}: an agent's decision is whole at every width`, async ({ page }, { data }) => {
    for (const width of WIDTHS) {
      await page.setViewportSize({ width, height: 1_000 });
      await open(page, `${path}${data.talk}#r=4&a=1`);
      const panel = page.locator(".panel-content");
      await page.locator(".decision").waitFor();
      const { cut, wide } = await panel.evaluate((panel) => {
        const box = panel.getBoundingClientRect();
        const parts = [...panel.querySelectorAll("dt, dd, svg")].map((part) => part.getBoundingClientRect());
        return { cut: parts.filter((part) => part.right > box.right + 1 || part.bottom > box.bottom + 1).length, wide: panel.scrollWidth > panel.clientWidth };
      });
      assert.equal(cut, 0, `${width} px`);
      assert.ok(!wide, `${width} px`);
      assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `${width} px: the page scrolls to the side`);
    }
  });
}

visit("a server without games plays the one of the pages, and offers none to watch", async ({ page }) => {
  await page.route("**/api/v1/episodes?*", (route) => route.fulfill({ json: { items: [], next_cursor: null } }));
  await open(page, "/");
  await page.getByRole("img", { name: /^Foraging, round 60/ }).waitFor();
  await page.getByText("one-way-loop").waitFor();
  const offered = page.locator(".picture").getByRole("link");
  assert.deepEqual(await offered.allInnerTexts(), ["Play"]);
  await page.locator(".picture figcaption").getByText(/Example: *Foraging/).waitFor();
  await page.getByRole("banner").getByRole("link", { name: "Games" }).click();
  await page.getByText(/^No game has ended yet, or none that can be read without a key: those of competitions are sealed/).waitFor();
});

visit("the front page: map and tasks stand side by side but on a phone", async ({ page }) => {
  for (const width of [380, 641, 761, 800, 860]) {
    await page.setViewportSize({ width, height: 900 });
    await open(page, "/");
    await page.locator(".picture .map").waitFor();
    await page.getByText(/^best /).first().waitFor();
    const { map, tasks, lines } = await page.evaluate(() => {
      const box = (/** @type {string} */ part) => /** @type {Element} */ (document.querySelector(part)).getBoundingClientRect();
      return { map: box(".picture .map").toJSON(), tasks: box(".tasks").toJSON(), lines: box(".tasks .number").height };
    });
    assert.equal(tasks.left > map.right, width > 640, `${width} px`);
    assert.ok(map.width > width * 0.38, `${width} px: a map of ${map.width} px`);
    assert.ok(lines < 30, `${width} px: a score takes two lines`);
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `${width} px: the page scrolls to the side`);
  }
  // A phone of 380 px with a scroll bar has fewer.
  await page.setViewportSize({ width: 360, height: 800 });
  assert.ok(Number((await page.getByRole("navigation", { name: "Pages" }).boundingBox())?.height) < 50, "the links take two lines");
});

visit("what is beside a table that is wider than a phone stays there: its caption, and the players of a board", async ({ page }, { data }) => {
  await page.setViewportSize(NARROW);
  await open(page, `/compare?a=${data.first}&b=${data.second}#r=3`);
  const caption = page.locator("table.pairs caption");
  await caption.waitFor();
  const text = await caption.evaluate((caption) => {
    const range = document.createRange();
    range.selectNodeContents(caption);
    return range.getBoundingClientRect().right;
  });
  assert.ok(text <= NARROW.width, `the caption ends at ${text} px`);
  await open(page, "/board/small");
  const table = page.getByRole("region", { name: "Rows of the board" });
  await page.locator("th.player").first().waitFor();
  await table.evaluate((table) => table.scrollTo(200, 0));
  const [player, left] = [await page.locator("th.player").first().boundingBox(), await table.boundingBox()];
  assert.equal(Math.round(Number(player?.x)), Math.round(Number(left?.x)));
});

/** Boxes of all elements of a page, by their place in it. @param {import("playwright-core").Page} page */
const boxes = (page) => page.getByRole("main").evaluate((main) =>
  [...main.querySelectorAll("*")].map((part) => {
    const { x, width, height } = part.getBoundingClientRect();
    return `${part.tagName}.${part.getAttribute("class") ?? ""} ${Math.round(x)} ${Math.round(width)} ${Math.round(height)}`;
  }),
);

/** Boxes that did not change for a while. @param {import("playwright-core").Page} page */
async function resting(page) {
  for (let before = await boxes(page); ; ) {
    await page.waitForTimeout(REST_MS);
    const now = await boxes(page);
    if (now.join() === before.join()) return now;
    before = now;
  }
}

visit("a page looks the same on whichever way one comes to it", async ({ page }, { data }) => {
  const places = ["/board/small", "/episodes", `/compare?a=${data.first}&b=${data.second}`, "/boards", "/play", `/episodes/${data.first}#r=3`, "/"];
  /** @type {Map<string, string[]>} */
  const alone = new Map();
  /** @param {string} place */
  const drawn = async (place) => {
    await settled(page);
    const now = await resting(page);
    if (!alone.has(place)) alone.set(place, now);
    assert.deepEqual(now, alone.get(place), place);
  };
  for (const place of places) {
    await page.goto("about:blank");
    await open(page, place);
    await drawn(place);
  }
  for (const order of [places, [...places].reverse(), [places[0], places[1], places[2]]]) {
    await open(page, order[0]);
    for (const place of order.slice(1)) {
      const before = await page.locator("h1").innerText();
      // As links do, without loading the document again.
      await page.evaluate((to) => {
        const link = Object.assign(document.createElement("a"), { href: to });
        document.body.append(link);
        link.click();
        link.remove();
      }, place);
      await page.waitForFunction((before) => ![null, before].includes(document.querySelector("h1")?.innerText ?? null), before);
      await drawn(place);
    }
  }
});
