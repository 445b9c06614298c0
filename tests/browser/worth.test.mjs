// What could still be scored: the bar, the curve, the decisions that lost most, and how the reference would play on.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { readFile, writeFile } from "node:fs/promises";
import path from "node:path";
import { pathToFileURL } from "node:url";
import { open } from "./support/browser.mjs";
import { hosted, spoken } from "./support/games.mjs";
import { BINARY } from "./support/program.mjs";
import { suite } from "./support/suite.mjs";

const ROUNDS = 16;
const SETTINGS = { task: "Synchronization", seed: 27, num_agents: 4, max_round: ROUNDS };

/** Rounds that the reference plays on. */
const LINE_ROUNDS = 10;

/** The narrowest window. */
const NARROWEST = { width: 360, height: 800 };

const { visit } = suite({ keys: true }, async (program) => {
  const { id: lossy } = await spoken(program, SETTINGS);
  const good = await hosted(program, SETTINGS);
  const large = (await spoken(program, { ...SETTINGS, width: 96, height: 96 })).id;
  const live = (await spoken(program, { ...SETTINGS, model: "live" }, { rounds: 3 })).id;
  const worth = await program.get(`/api/v1/episodes/${lossy}/worth`);
  const { states } = await program.get(`/api/v1/episodes/${lossy}/replay`);
  return { lossy, good, large, live, worth, states };
});

/** @typedef {import("playwright-core").Page} Page */

/** @param {Page} page */
const bar = (page) => page.getByRole("img", { name: /^Worth\./ });

/** @param {Page} page */
const list = (page) => page.locator("details").filter({ hasText: "What decisions lost" });

/** @param {Page} page */
const playOn = (page) => page.getByRole("button", { name: "Play on from here as the reference would" });

/** @param {Page} page @param {number} round */
const roundIs = (page, round) => page.getByRole("img", { name: new RegExp(`^Map\\. Round ${round}\\.`) }).waitFor();

/** Requests of a page to the routes of worth, as they are sent. @param {Page} page */
function asked(page) {
  const paths = /** @type {string[]} */ ([]);
  page.on("request", (request) => {
    const { pathname, search } = new URL(request.url());
    if (/\/(worth|line)$/.test(pathname)) paths.push(pathname.replace(/.*\//, "") + search);
  });
  return paths;
}

/** A number as pages show it. @param {number} value */
const short = (value) => (Number.isInteger(value) ? String(value) : value.toFixed(2));

/** What the bar says of a state. @param {{worth: any, states: any[]}} data @param {number} round */
function said({ worth: { values }, states }, round) {
  const [value, { score }] = [values[round], states[round]];
  return `Worth. ${short(score)} scored, ${short(value - score)} can still be scored, ${short(values[0] - value)} lost.`;
}

visit("the bar says what is scored, open and lost, and follows the round", async ({ page }, { data }) => {
  const paths = asked(page);
  await open(page, `/episodes/${data.lossy}#r=0`);
  for (const round of [0, 5, ROUNDS]) {
    await page.getByRole("slider", { name: "Round" }).fill(String(round));
    await roundIs(page, round);
    await page.getByRole("img", { name: said(data, round), exact: true }).waitFor();
  }
  // The parts fill the bar in their shares.
  const heights = await bar(page).evaluate((bar) => [...bar.children].map((part) => part.getBoundingClientRect().height));
  const [all, first] = [heights.reduce((sum, height) => sum + height), data.worth.values[0]];
  const lost = first - data.worth.values[ROUNDS];
  assert.ok(lost > 0, "a game that lost something");
  assert.ok(Math.abs(heights[0] / all - lost / first) < 0.02, String(heights));
  assert.ok(all > 200, "as high as the map");
  assert.match(await page.getByRole("slider", { name: "Round" }).getAttribute("aria-valuetext") ?? "", /, worth [\d.]+$/);
  assert.deepEqual(paths, ["worth?seats=false"], "nothing slow is asked for by itself");
});

visit("a click on the curve goes to its round", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.lossy}#r=0`);
  const curve = page.locator(".future");
  await curve.locator(".worth").waitFor();
  const box = await curve.boundingBox();
  assert.ok(box);
  await page.mouse.click(box.x + box.width / 2, box.y + 20);
  await roundIs(page, ROUNDS / 2);
});

visit("the decisions that lost most are worked out when they are asked for, and lead to their rounds", async ({ page }, { data }) => {
  const paths = asked(page);
  await open(page, `/episodes/${data.lossy}#r=0`);
  await bar(page).waitFor();
  await list(page).getByText("What decisions lost").click();
  const buttons = list(page).getByRole("listitem").getByRole("button");
  await buttons.first().waitFor();
  assert.deepEqual(paths, ["worth?seats=false", "worth?seats=true"]);
  const { dearest } = data.worth;
  assert.equal(await buttons.count(), dearest.length);
  for (const index of [0, dearest.length - 1]) {
    const { round, words, loss, agent } = dearest[index];
    assert.equal((await buttons.nth(index).innerText()).replaceAll(/\s+/g, " "), `Round ${round} ${words} −${short(loss)}`);
    await buttons.nth(index).press("Enter");
    await roundIs(page, round);
    assert.equal(await buttons.nth(index).getAttribute("aria-current"), "true");
    // The seat is ringed, chosen, and named in the words of the map.
    const here = dearest.filter((/** @type {any} */ decision) => decision.round === round);
    assert.equal(await page.locator(".map .ring").count(), here.length);
    assert.match(await page.getByRole("img", { name: /^Map\./ }).getAttribute("aria-label") ?? "", new RegExp(words.replaceAll(/[.()]/g, ".")));
    await page.getByRole("region", { name: agent.replace("_", " ") }).waitFor();
  }
  const seats = (await page.locator(".future .marks span").allInnerTexts()).join().replaceAll("?", "").split(",");
  assert.deepEqual(seats.toSorted(), dearest.map((/** @type {any} */ { agent }) => agent.replace("Agent_", "")).toSorted());
});

visit("the reference plays on from the round that is shown, until another is shown", async ({ page }, { program, data }) => {
  const paths = asked(page);
  await open(page, `/episodes/${data.lossy}#r=3&a=2`);
  await roundIs(page, 3);
  await playOn(page).click();
  await page.locator(".map .ghost").first().waitFor();
  assert.equal(await playOn(page).getAttribute("aria-pressed"), "true");
  assert.ok(paths.includes(`line?round=3&rounds=${LINE_ROUNDS}`), String(paths));
  assert.equal(await page.locator(".map .ghost").count(), SETTINGS.num_agents);
  // Of the chosen agent each round has its number.
  assert.deepEqual(
    (await page.locator(".map .ghost").nth(2).locator("text").allTextContents()).map((text) => text.trim()),
    Array.from({ length: LINE_ROUNDS }, (_, step) => `+${step + 1}`),
  );
  const { rounds } = await program.get(`/api/v1/episodes/${data.lossy}/line?round=3&rounds=${LINE_ROUNDS}`);
  const actions = rounds.map((/** @type {any} */ { agents }) => agents[2].action).join(", ");
  await page.getByText(`to a score of ${short(rounds.at(-1).score)}. Agent 2 would choose ${actions}.`).waitFor();
  await page.keyboard.press("ArrowRight");
  await roundIs(page, 4);
  await page.locator(".map .ghost").first().waitFor({ state: "detached" });
  await page.keyboard.press("ArrowLeft");
  await roundIs(page, 3);
  assert.equal(await page.locator(".map .ghost").count(), 0);
  await page.keyboard.press("End");
  await roundIs(page, ROUNDS);
  assert.equal(await playOn(page).count(), 0, "nothing is played after the last round");
});

visit("a large map is drawn with rings and outlines, too", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.large}#r=2`);
  const map = page.locator("svg.map.crowded");
  await bar(page).waitFor();
  assert.equal(await map.locator("rect.body").count(), SETTINGS.num_agents);
  await playOn(page).click();
  await page.getByText("The outlines are its next").waitFor();
  assert.equal(await map.locator(".ghost").count(), SETTINGS.num_agents);
  await list(page).getByText("What decisions lost").click();
  const first = list(page).getByRole("listitem").getByRole("button").first();
  await first.click();
  const round = Number(/\d+/.exec(await first.innerText()));
  await roundIs(page, round);
  await map.locator(".ring").first().waitFor();
  // What is drawn of one agent is seen although cells are a few pixels wide.
  assert.ok(((await map.locator(".chosen").boundingBox())?.width ?? 0) > 3);
});

visit("nothing is asked about a game that its reader may not foresee", async ({ page }, { data }) => {
  const paths = asked(page);
  await open(page, `/episodes/${data.live}`);
  await roundIs(page, 2);
  await page.waitForLoadState("networkidle", { timeout: 2_000 }).catch(() => {});
  assert.equal(await bar(page).count(), 0);
  assert.deepEqual(paths, []);
});

visit(
  "who created a running game reads it",
  async ({ page }, { data }) => {
    await open(page, `/episodes/${data.live}`);
    await bar(page).waitFor();
    await page.getByRole("img", { name: /^Worth\. .* can still be scored/ }).waitFor();
  },
  { asOrganizer: true },
);

visit("what is not computed is said, and refusals are not shown", async ({ page, watch }, { data }) => {
  const missing = [{ part: "values", detail: "it takes up to 9000000 decisions" }];
  await page.route("**/worth?*", (route) => route.fulfill({ json: { reference: "x", values: null, missing } }));
  await open(page, `/episodes/${data.lossy}`);
  await page.getByText("What could still be scored is not computed: it takes up to 9000000 decisions.").waitFor();
  assert.equal(await bar(page).count(), 0);
  watch.expect(/403/);
  await page.route("**/worth?*", (route) => route.fulfill({ status: 403, json: { code: "forbidden", detail: "this game is sealed" } }));
  await open(page, `/episodes/${data.lossy}#r=1`);
  await page.reload();
  await roundIs(page, 1);
  await bar(page).waitFor({ state: "detached" });
  assert.equal(await page.getByText("this game is sealed").count(), 0);
});

visit("losses that fail can be asked for again, and those that are missing say why", async ({ page, watch }, { data }) => {
  watch.expect(/500/);
  await open(page, `/episodes/${data.lossy}`);
  await bar(page).waitFor();
  await page.route("**/worth?seats=true", (route) => route.fulfill({ status: 500, json: { code: "internal", detail: "broken" } }));
  await list(page).getByText("What decisions lost").first().click();
  await list(page).getByRole("alert").waitFor();
  const missing = [{ part: "seats", detail: "losses of seats take too many decisions" }];
  const partial = { ...data.worth, seats: null, dearest: null, missing };
  await page.route("**/worth?seats=true", (route) => route.fulfill({ json: partial }));
  await list(page).getByRole("button", { name: "Try again" }).click();
  await page.getByText("What each decision lost is not computed: losses of seats take too many decisions.").waitFor();
});

visit("two games are compared by what could still be scored", async ({ page }, { data }) => {
  const paths = asked(page);
  await open(page, `/compare?a=${data.lossy}&b=${data.good}#r=5`);
  const side = (/** @type {string} */ name) => page.getByRole("region", { name: `Game ${name}`, exact: true });
  await side("A").getByRole("img", { name: said(data, 5), exact: true }).waitFor();
  await side("B").getByRole("img", { name: /^Worth\. .* (lost|start)\.$/ }).waitFor();
  await side("A").getByText("can still be scored").waitFor();
  const plot = page.locator(".future");
  assert.deepEqual((await plot.locator("path.worth").evaluateAll((paths) => paths.map((path) => (path.getAttribute("d") ?? "").length > 10))), [true, true]);
  const box = await plot.boundingBox();
  assert.ok(box);
  await plot.click({ position: { x: box.width - 1, y: 20 } });
  await page.getByRole("img", { name: `Map of game A in round ${ROUNDS}` }).waitFor();
  assert.deepEqual(paths, ["worth?seats=false", "worth?seats=false"]);
});

visit("a file has what was computed, and no server to play on", async ({ page, context, watch }, { program, data }) => {
  watch.allow("null");
  const file = path.join(program.folder, "worth.html");
  const done = spawnSync(BINARY, ["replay", data.lossy, "--html", file, "--server", program.url]);
  assert.equal(done.status, 0, String(done.stderr));
  const document = await readFile(file, "utf8");
  const content = /(<script type="application\/json" id="game">)(.*?)(<\/script>)/s;
  const written = document.replace(content, (_, begin, json, end) => begin + JSON.stringify({ ...JSON.parse(json), worth: data.worth }).replaceAll("<", "\\u003c") + end);
  assert.notEqual(written, document);
  await writeFile(file, written);
  await context.setOffline(true);
  await page.goto(`${pathToFileURL(file)}#r=5`);
  await page.getByRole("img", { name: said(data, 5), exact: true }).waitFor();
  await list(page).getByText("What decisions lost").click();
  const [first] = data.worth.dearest;
  await list(page).getByRole("listitem").getByRole("button").first().click();
  await roundIs(page, first.round);
  await page.locator(".map .ring").first().waitFor();
  assert.equal(await playOn(page).count(), 0);
});

visit("everything fits into a narrow window", async ({ page }, { data }) => {
  await page.setViewportSize(NARROWEST);
  for (const address of [`/episodes/${data.lossy}#r=3`, `/compare?a=${data.lossy}&b=${data.good}#r=3`]) {
    await open(page, address);
    await bar(page).first().waitFor();
    if (address.startsWith("/episodes")) {
      await playOn(page).click();
      await list(page).getByText("What decisions lost").click();
      await list(page).getByRole("listitem").first().waitFor();
    }
    const width = await page.evaluate(() => document.documentElement.scrollWidth);
    assert.ok(width <= NARROWEST.width, `${address}: ${width} px`);
  }
});

/** Shares of states: values, round, score, and the words. @type {[number[] | null, number, number, string | null][]} */
const SHARES = [
  [[10, 8, 8], 1, 3, "3 scored, 5 can still be scored, 2 lost."],
  [[10, 12], 1, 3, "3 scored, 9 can still be scored, 2 gained on what the reference would score from the start."],
  [[0, 0], 1, 0, "0 scored, 0 can still be scored, 0 lost."],
  [[0.3, 0.1 + 0.2], 1, 0, "0 scored, 0.30 can still be scored, 0 lost."],
  [[10, 8], 2, 3, null],
  [null, 0, 0, null],
];

visit("shares of what could be scored", async ({ page }) => {
  await open(page, "/");
  const words = await page.evaluate(async (rows) => {
    const script = /** @type {HTMLScriptElement} */ (document.querySelector("script[src$='/app.js']"));
    const { sharesInWords, sharesOf } = await import(script.src.replace("app.js", "parts/worth.js"));
    return rows.map(([values, round, score]) => {
      const shares = sharesOf({ reference: "x", values }, { round, score });
      return shares && sharesInWords(shares);
    });
  }, SHARES);
  assert.deepEqual(words, SHARES.map((row) => row[3]));
});
