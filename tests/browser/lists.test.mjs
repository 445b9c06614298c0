// Lists and boards with many rows: filtered, sorted, and read without a pointer.
import assert from "node:assert/strict";
import { NARROW, open, settled } from "./support/browser.mjs";
import { hosted, play, run, smallSuite, spoken, talkative } from "./support/games.mjs";
import { suite } from "./support/suite.mjs";

const { visit } = suite({ keys: true }, fill);

/** @param {import("./support/program.mjs").Program} program */
async function fill(program) {
  const short = { num_agents: 4, max_round: 12 };
  for (const [model, seed] of /** @type {[string, number][]} */ ([["alpha/one", 30], ["alpha/two", 10], ["beta", 20]])) {
    await hosted(program, { ...short, task: "Foraging", max_round: 40, seed, model });
  }
  const person = (await spoken(program, { ...short, task: "Pursuit", seed: 5, model: "Ada", agent_meta: { kind: "human" } })).id;
  const fork = await program.post(`/api/v1/episodes/${person}/fork`, { round: 2 });
  const mixed = await program.post("/api/v1/episodes", { ...short, task: "Transport", player: "default", open_seats: 1, visibility: "public" });
  // One rule-based player that scores much, and models that score next to nothing.
  const built = await run(program, { suite: smallSuite({ max_round: 25 }), model: undefined });
  for (const model of ["m-large", "m-small"]) {
    const made = await program.post("/api/v1/runs", { suite: smallSuite({ max_round: 25 }), model, visibility: "public", parallel: 8 });
    await play(program, made.swarm_token, talkative(model.length));
  }
  return { person, fork: fork.episodes[0].id, mixed: mixed.id, built };
}

/** The texts of a column of the games that have ended. @param {import("playwright-core").Page} page @param {string} name */
const column = (page, name) =>
  page.getByRole("region", { name: "Games", exact: true }).evaluate((region, name) => {
    const heads = [...region.querySelectorAll("thead th")].map((head) => head.textContent?.replace(/[ ▲▼]/g, ""));
    return [...region.querySelectorAll("tbody tr")].map((row) => row.children[heads.indexOf(name)].textContent?.trim() ?? "");
  }, name);

/** Presses a head, and waits for the games in its order. @param {import("playwright-core").Page} page @param {string} name @param {string} direction */
const sortedBy = async (page, name, direction) => {
  const sorted = page.waitForResponse(/\/api\/v1\/episodes\?.*sort=/);
  await page.getByRole("columnheader", { name }).getByRole("button").click();
  await page.locator(`th[aria-sort=${direction}]`, { hasText: name }).waitFor();
  await (await sorted).finished();
  await settled(page);
};

visit("games are sorted by the server, both ways, and a link keeps the order", async ({ page }) => {
  await open(page, "/episodes?task=Foraging");
  await sortedBy(page, "Seed", "ascending");
  const up = (await column(page, "Seed")).map(Number);
  assert.deepEqual(up, up.toSorted((one, other) => one - other));
  assert.ok(up.includes(10) && up.length >= 3, `${up}`);
  await sortedBy(page, "Seed", "descending");
  await page.reload();
  await page.getByRole("cell", { name: "alpha/one" }).waitFor();
  assert.deepEqual((await column(page, "Seed")).map(Number), up.toReversed());
  await sortedBy(page, "Score", "descending");
  const scores = (await column(page, "Score")).map(Number);
  assert.deepEqual(scores, scores.toSorted((one, other) => other - one));
  await page.locator("svg.sparkline").first().waitFor();
});

/** Answers of at most `count` items. @param {import("playwright-core").Page} page @param {string} list @param {number} count */
const inPagesOf = (page, list, count) =>
  page.route(new RegExp(`/api/v1/${list}\\?`), (route) => route.continue({ url: route.request().url().replace(/limit=\d+/, `limit=${count}`) }));

visit("a long board is sorted with all its rows, also those that were not read yet", async ({ page }) => {
  await inPagesOf(page, "leaderboard", 1);
  const players = () => page.locator("table.board tbody tr:not(.part) th a").allTextContents();
  await open(page, "/board/small");
  await page.getByRole("button", { name: "More" }).waitFor();
  assert.equal((await players()).length, 1);
  await page.getByRole("columnheader", { name: "Player" }).getByRole("button").click();
  await page.getByText("3 rows, sorted by player.").waitFor();
  await settled(page);
  assert.deepEqual((await players()).slice(0, 2), ["m-large", "m-small"]);
});

visit("Back finds a list as long as it was, and its place", async ({ page }) => {
  await inPagesOf(page, "episodes", 2);
  await page.setViewportSize({ width: 1000, height: 300 });
  await open(page, "/episodes?task=Foraging");
  const rows = page.getByRole("region", { name: "Games", exact: true }).locator("tbody tr");
  await page.getByRole("button", { name: "More" }).click();
  await rows.nth(3).waitFor();
  await settled(page);
  const length = await rows.count();
  await rows.last().scrollIntoViewIfNeeded();
  const place = await page.evaluate(() => scrollY);
  assert.ok(place > 0);
  await rows.last().getByRole("link").first().click();
  await page.waitForURL("**/episodes/ep_*");
  await page.goBack();
  await rows.nth(length - 1).waitFor();
  await page.waitForFunction((place) => Math.abs(scrollY - place) < 20, place);
});

visit("a curve of zeros is not drawn", async ({ page }) => {
  await page.route(/\/api\/v1\/episodes\?/, async (route) => {
    const response = await route.fetch();
    const page = await response.json();
    await route.fulfill({ response, json: { ...page, items: page.items.map((/** @type {any} */ one) => ({ ...one, curve: one.model === "beta" ? [0, 0, 0] : one.curve })) } });
  });
  await open(page, "/episodes?task=Foraging");
  const curves = (/** @type {string} */ model) => page.getByRole("row").filter({ has: page.getByRole("cell", { name: model }) }).locator("svg.sparkline");
  await curves("alpha/one").first().waitFor();
  assert.equal(await curves("beta").count(), 0);
});

visit("a part of a model's name narrows the list at once, and its whole name asks the server", async ({ page }) => {
  await open(page, "/episodes");
  const model = page.getByRole("combobox", { name: "Model" }).or(page.getByRole("searchbox", { name: "Model" }));
  const asked = page.waitForResponse(/\/api\/v1\/models/);
  await model.focus();
  await asked;
  await page.waitForFunction(() => document.querySelectorAll("datalist option").length >= 4);
  const names = await page.locator("datalist option").evaluateAll((options) => options.map((option) => /** @type {HTMLOptionElement} */ (option).value));
  assert.ok(["Ada", "alpha/one", "beta", "m-large"].every((name) => names.includes(name)), `${names}`);
  await model.pressSequentially("ALPHA");
  await page.getByText(/^2 of the \d+ games below fit “ALPHA”/).waitFor();
  assert.deepEqual(new Set(await column(page, "Model")), new Set(["alpha/one", "alpha/two"]));
  await model.fill("alpha/two");
  await page.waitForURL(/model=alpha%2Ftwo/);
  await page.getByRole("cell", { name: "alpha/one" }).waitFor({ state: "hidden" });
  assert.deepEqual(await column(page, "Model"), ["alpha/two"]);
  await page.getByRole("button", { name: "Show all" }).click();
  await page.getByRole("cell", { name: "beta" }).waitFor();
});

visit("games with people, forks and mixed games are marked, and people are found", async ({ page }, { data }) => {
  await open(page, "/episodes");
  const row = (/** @type {string} */ id) => page.getByRole("row").filter({ has: page.locator(`a[href$="${id}"]`) });
  await row(data.person).getByText("people", { exact: true }).waitFor();
  await row(data.fork).getByText("fork", { exact: true }).waitFor();
  await row(data.mixed).getByText("mixed", { exact: true }).waitFor();
  await page.getByRole("checkbox", { name: "With people" }).check();
  await page.waitForURL(/people=true/);
  await row(data.mixed).waitFor({ state: "hidden" });
  assert.deepEqual(await column(page, "Model"), ["Ada"]);
});

visit("empty pages of a sorted list lead on, a few of them by themselves", async ({ page }) => {
  let answers = 0;
  let empty = 3;
  await page.route(/api\/v1\/episodes\?.*sort=score/, (route) => {
    answers += 1;
    const address = route.request().url().replace(/&cursor=s\w+/, "");
    return answers > empty ? route.continue({ url: address }) : route.fulfill({ json: { items: [], next_cursor: `s${answers}` } });
  });
  await open(page, "/episodes?sort=score");
  await page.getByRole("cell", { name: "beta" }).waitFor();
  assert.equal(answers, 4);
  [answers, empty] = [0, 9];
  await open(page, "/episodes?sort=score&task=Foraging");
  await page.getByText("None of the games that were looked at fits. There are more.").waitFor();
  await page.waitForResponse(/cursor=s8/);
  await page.getByRole("button", { name: "More" }).click();
  await page.getByRole("cell", { name: "beta" }).waitFor();
});

/** Where the mean of each row's total is on its rail, from 0 to 1. @param {import("playwright-core").Page} page */
const means = (page) =>
  page.locator("table.board tbody tr:not(.part)").evaluateAll((rows) =>
    rows.map((row) => {
      const svg = row.querySelector("svg.interval");
      const axis = svg?.querySelector(".axis");
      const [from, to] = ["x1", "x2"].map((name) => Number(axis?.getAttribute(name)));
      return (Number(svg?.querySelector(".mean")?.getAttribute("cx")) - from) / (to - from);
    }),
  );

visit("models have a scale of their own beside rule-based players, and 0 is at its left", async ({ page }) => {
  await open(page, "/board/small");
  const parts = await page.locator("table.board tr.part").allTextContents();
  assert.deepEqual(parts, ["Models", "Rule-based players"]);
  assert.equal(await page.getByRole("checkbox", { name: "People" }).isChecked(), false);
  const places = await means(page);
  assert.equal(places.length, 3);
  const zeros = await page.locator("table.board tbody tr:not(.part)").evaluateAll((rows) => rows.map((row) => row.querySelector(".score .number")?.textContent === "0.00"));
  zeros.forEach((isZero, index) => isZero && assert.equal(places[index], 0, `${places}`));
  await page.getByRole("cell").getByText(/^-?[\d.]+ to [\d.]+$/).first().waitFor();
});

visit("scores of a column have equal decimals: games of a run, and runs of a player", async ({ page }, { program, data }) => {
  const run = await program.get(`/api/v1/runs/${data.built}`);
  run.games.forEach((/** @type {any} */ game, /** @type {number} */ index) => (game.score = index % 2 ? 1.5 : 1));
  await page.route(`**/api/v1/runs/${data.built}`, (route) => route.fulfill({ json: run }));
  await page.route("**/api/v1/runs?*", (route) => route.fulfill({ json: { items: [{ ...run, total: 1 }, { ...run, id: "run_other", total: 1.5 }] } }));
  const equal = async (/** @type {string} */ selector) => {
    await page.locator(selector).first().waitFor();
    assert.deepEqual(new Set(await page.locator(selector).allTextContents()), new Set(["1.00", "1.50"]), selector);
  };
  await open(page, `/runs/${data.built}`);
  await equal("a.game .number");
  await page.getByText("6 games with journals and verification").click();
  await equal("details td.number:nth-of-type(4)");
  await open(page, "/board/small");
  await page.locator("table.board tbody").last().locator("th.player a").click();
  await equal("li .number");
});

visit("a name that narrows a list keeps the focus", async ({ page }) => {
  await open(page, "/episodes");
  const model = page.getByRole("combobox", { name: "Model" });
  await model.focus();
  await page.waitForFunction(() => document.querySelectorAll("datalist option").length >= 4);
  await model.fill("beta");
  await page.waitForURL(/model=beta/);
  await page.getByRole("cell", { name: "alpha/one" }).waitFor({ state: "hidden" });
  assert.equal(await model.evaluate((input) => input === document.activeElement), true);
});

visit("a sign on a board is explained where it stands, by a press and by keys", async ({ page }) => {
  await page.setViewportSize(NARROW);
  await open(page, "/board/small");
  const sign = page.getByRole("button", { name: "one holder" }).first();
  await sign.click();
  await page.getByRole("note").getByText(/One holder had all seats/).waitFor();
  assert.equal(await sign.getAttribute("aria-expanded"), "true");
  await sign.press("Enter");
  await page.getByRole("note").waitFor({ state: "hidden" });
});

visit("leaders of a board are models, with equal decimals", async ({ page }) => {
  const leaders = async (/** @type {import("playwright-core").Locator} */ place) => {
    await place.locator("ol.leaders li").first().waitFor();
    return (await place.locator("ol.leaders li").allInnerTexts()).map((text) => text.replaceAll(/\s+/g, " "));
  };
  await open(page, "/boards");
  const listed = await leaders(page.getByRole("row").filter({ has: page.getByRole("link", { name: "small" }) }));
  assert.deepEqual(listed.map((text) => text.split(" ")[0]).sort(), ["m-large", "m-small"]);
  assert.ok(listed.every((text) => /^\S+ \d+\.\d\d( ± \d+\.\d\d)?$/.test(text)), `${listed}`);
  await open(page, "/");
  assert.deepEqual(await leaders(page.locator(".columns li").filter({ has: page.getByRole("link", { name: "small" }) })), listed);
});

visit("a task: models have a scale of their own beside a rule-based player, and lead to their pages", async ({ page }) => {
  await page.route(/leaderboard\?suite=standard&task=Pursuit/, async (route) => {
    const board = await (await route.fetch()).json();
    const played = { mean: 92, deviation: 1, games: 5, planned: 5 };
    const program = { ...board.items[0], id: "program", model: "built-in/strong", reference: false, tasks: { Pursuit: played } };
    await route.fulfill({ json: { ...board, items: [program, ...board.items] } });
  });
  await open(page, "/tasks/Pursuit");
  const models = page.getByRole("region", { name: "Models" });
  await page.getByRole("region", { name: "Rule-based players" }).getByRole("link", { name: "built-in/strong" }).waitFor();
  const [mean, end] = await models.locator("svg.interval").first().evaluate((svg) =>
    [[".mean", "cx"], [".axis", "x2"]].map(([part, name]) => Number(svg.querySelector(part)?.getAttribute(name))));
  assert.ok(mean > end / 2, `the best model is at ${mean} of ${end}`);
  const best = models.getByRole("link").first();
  const name = await best.innerText();
  await best.click();
  await page.getByRole("heading", { level: 1, name }).waitFor();
});

visit("a long name takes one line in a list, and is whole at a press", async ({ page }) => {
  const long = "a model with a name ".repeat(8).trim();
  await page.route(/api\/v1\/episodes\?/, async (route) => {
    const games = await (await route.fetch()).json();
    await route.fulfill({ json: { ...games, items: games.items.map((/** @type {any} */ game) => ({ ...game, model: long })) } });
  });
  await page.setViewportSize({ width: 800, height: 900 });
  await open(page, "/episodes?task=Foraging");
  const summary = page.locator("details.name summary").first();
  await summary.waitFor();
  assert.ok(Number((await summary.boundingBox())?.height) < 30);
  await summary.click();
  await page.locator("details.name[open]").getByText(long, { exact: true }).waitFor();
});

visit("what is offered for chosen games stays in sight, and a filtered list has a title", async ({ page }) => {
  await open(page, "/episodes?status=finished");
  await page.getByRole("heading", { level: 2, name: "Finished", exact: true }).waitFor();
  const boxes = page.getByRole("checkbox", { name: /^Compare / });
  for (const box of [boxes.nth(-2), boxes.last()]) await box.check();
  assert.ok((await page.evaluate(() => scrollY)) > 50);
  const link = await page.getByRole("link", { name: "Compare the two chosen games" }).boundingBox();
  assert.ok(link && link.y >= 0 && link.y < 100, `${link?.y}`);
});

visit("the front page shows a game that has just begun where there is no other, and says that it is live", async ({ page }, { program }) => {
  await open(page, "/");
  await page.locator(".picture figcaption").waitFor();
  assert.equal(await page.locator(".picture").getByText("live", { exact: true }).count(), 0);
  await page.route("**/api/v1/episodes?status=finished*", (route) => route.fulfill({ json: { items: [], next_cursor: null } }));
  const { id } = await spoken(program, { task: "Synchronization", seed: 57, num_agents: 4, max_round: 40, model: "gamma" }, { rounds: 2 });
  await open(page, "/");
  await page.locator(".picture figcaption", { hasText: "gamma" }).getByText("live", { exact: true }).waitFor();
  await page.locator(`.picture a[href$="${id}"]`).waitFor();
});
