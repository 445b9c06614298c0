// From one page to the next, as a first visitor goes.
import assert from "node:assert/strict";
import { open } from "./support/browser.mjs";
import { full } from "./support/site.mjs";
import { suite } from "./support/suite.mjs";

const { visit } = suite({ keys: true }, full);

/** @param {import("playwright-core").Page} page */
const heading = (page) => page.getByRole("heading", { level: 1 });

visit("from the front page over a board, a player and a run to a round", async ({ page }, { data }) => {
  await open(page, "/");
  await page.getByRole("navigation", { name: "Pages" }).getByRole("link", { name: "Boards" }).click();
  await page.waitForURL("**/boards");
  await page.getByRole("rowheader", { name: "small" }).getByRole("link").click();
  await heading(page).filter({ hasText: "small" }).waitFor();
  await page.getByRole("link", { name: "careful walker" }).first().click();
  await heading(page).filter({ hasText: "careful walker" }).waitFor();
  await page.getByRole("link", { name: /run/ }).and(page.locator(`[href*="${data.built}"]`)).first().click();
  await page.waitForURL(`**/runs/${data.built}`);
  await page.getByRole("link", { name: /^Foraging, seed 42/ }).click();
  await page.waitForURL("**/episodes/ep_*");
  await page.getByRole("slider", { name: "Round" }).waitFor();
  // Back leads to the previous page.
  await page.goBack();
  await page.waitForURL(`**/runs/${data.built}`);
  await page.getByRole("link", { name: /^Foraging, seed 42/ }).waitFor();
});

visit("two games of one seed are compared from the list of games", async ({ page }, { data }) => {
  await open(page, "/episodes?task=Foraging");
  for (const id of [data.first, data.second]) await page.getByRole("checkbox", { name: new RegExp(id) }).check();
  await page.getByRole("main").getByRole("link", { name: /compare/i }).or(page.getByRole("main").getByRole("button", { name: /^Compare/ })).first().click();
  await page.waitForURL("**/compare?*");
  await page.getByText(/They part in round \d+/).waitFor();
  await page.getByRole("button", { name: /^Go to round/ }).click();
  const before = await page.getByRole("slider", { name: "Round" }).inputValue();
  await page.getByRole("button", { name: "Where they differ, next" }).click();
  assert.notEqual(await page.getByRole("slider", { name: "Round" }).inputValue(), before);
  await page.getByRole("button", { name: "Share and more" }).click();
  await page.getByRole("button", { name: /Swap/ }).click();
  await page.waitForURL(new RegExp(`a=(${data.first}|${data.second})`));
});

visit("the board as a file, by task and with metrics", async ({ page }) => {
  await open(page, "/board/small");
  const [file] = await Promise.all([page.waitForEvent("download"), page.getByRole("link", { name: "CSV" }).click()]);
  assert.match(file.suggestedFilename(), /\.csv$/);
  await page.getByRole("columnheader", { name: "Foraging" }).getByRole("button").click();
  await page.waitForURL(/sort=Foraging/);
  assert.equal(await page.getByRole("columnheader", { name: "Foraging" }).getAttribute("aria-sort"), "descending");
  await page.reload();
  await page.getByRole("columnheader", { name: "Foraging" }).waitFor();
  assert.equal(await page.getByRole("columnheader", { name: "Foraging" }).getAttribute("aria-sort"), "descending");
});

visit("the published file of a competition is checked in the browser", async ({ page }, { data }) => {
  await open(page, `/competitions/${data.closed}#verify`);
  await page.getByRole("button", { name: /Verify|Check/ }).first().click();
  await page.getByText(/commitment/i).first().waitFor();
  await page.getByText(/swarmbench verify --competition/).first().waitFor();
});

/** Presses Tab until something has the focus. @param {import("playwright-core").Page} page @param {RegExp} name @param {number} most */
async function tabTo(page, name, most = 60) {
  for (let pressed = 0; pressed < most; pressed++) {
    await page.keyboard.press("Tab");
    const focused = await page.evaluate(() => {
      const element = document.activeElement;
      return `${element?.getAttribute("aria-label") ?? ""} ${element?.textContent ?? ""}`.trim();
    });
    if (name.test(focused)) return;
  }
  throw new Error(`Tab does not reach ${name}`);
}

visit("with the keyboard alone to a game and through it", async ({ page }, { data }) => {
  await open(page, "/");
  await tabTo(page, /^Skip to the content$/, 1);
  await tabTo(page, /^Games$/);
  await page.keyboard.press("Enter");
  await page.waitForURL("**/episodes");
  await heading(page).filter({ hasText: "Games" }).waitFor();
  assert.equal(await page.evaluate(() => document.activeElement?.id), "main", "a new page has the focus");
  const link = new RegExp(data.talk);
  for (let tries = 0; ; tries++) {
    await page.keyboard.press("Tab");
    const href = await page.evaluate(() => document.activeElement?.getAttribute("href") ?? "");
    if (link.test(href)) break;
    assert.ok(tries < 120, "Tab reaches the game");
  }
  await page.keyboard.press("Enter");
  await page.waitForURL(`**/episodes/${data.talk}*`);
  await page.getByRole("slider", { name: "Round" }).waitFor();
  await page.keyboard.press("Home");
  await page.keyboard.press("ArrowRight");
  await page.waitForURL(/r=1\b/);
  await tabTo(page, /^Agent 3/);
  await page.keyboard.press("Enter");
  await page.waitForURL(/a=3\b/);
  await tabTo(page, /^Prompt$/);
  await page.keyboard.press("Enter");
  await page.getByRole("region", { name: "Agent 3" }).getByText(/ACTION/).first().waitFor();
});

visit("a page that was updated says so", async ({ page, watch }) => {
  watch.expect(/404|MIME|ERR_/);
  await open(page, "/");
  await page.route("**/assets/**/pages/runs.js", (route) => route.fulfill({ status: 404, body: "" }));
  await page.getByRole("navigation", { name: "Pages" }).getByRole("link", { name: "Runs" }).click();
  await page.getByRole("button", { name: "Load again" }).waitFor();
});
