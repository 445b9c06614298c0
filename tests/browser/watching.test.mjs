// A game is watched, scrubbed, linked to and checked.
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { open } from "./support/browser.mjs";
import { hosted, play, spoken, talkative } from "./support/games.mjs";
import { suite } from "./support/suite.mjs";

const ROUNDS = 40;

const { visit } = suite({}, async (program) => ({
  game: (await spoken(program, { task: "Synchronization", seed: 27, num_agents: 4, max_round: ROUNDS, model: "gpt-x" })).id,
  built: await hosted(program, { task: "Foraging", seed: 27, max_round: 60 }),
}));

/** @param {import("playwright-core").Page} page */
const slider = (page) => page.getByRole("slider", { name: "Round" });

/** @param {import("playwright-core").Page} page @param {number} round */
const roundIs = (page, round) => page.getByRole("img", { name: new RegExp(`^Map\\. Round ${round}\\.`) }).waitFor();

/** @param {import("playwright-core").Page} page @param {string} name */
const button = (page, name) => page.getByRole("main").getByRole("button", { name, exact: true });

/** @param {import("playwright-core").Page} page @param {number} index */
const agent = (page, index) => page.getByRole("group", { name: "Agent", exact: true }).getByRole("button", { name: `Agent ${index}` });

visit("keys move through a game", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.game}`);
  await slider(page).waitFor();
  await page.keyboard.press("Home");
  await roundIs(page, 0);
  await page.keyboard.press("ArrowRight");
  await roundIs(page, 1);
  await page.keyboard.press("Shift+ArrowRight");
  await roundIs(page, 11);
  await page.keyboard.press("ArrowLeft");
  await roundIs(page, 10);
  await page.keyboard.press("End");
  await roundIs(page, ROUNDS);
  assert.equal(await slider(page).inputValue(), String(ROUNDS));
  await page.keyboard.press("3");
  assert.equal(await agent(page, 3).getAttribute("aria-pressed"), "true");
});

visit("marks are visited one after the other", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.game}#r=0`);
  await roundIs(page, 0);
  const seen = /** @type {number[]} */ ([]);
  for (let marks = 0; marks < 3; marks++) {
    await page.keyboard.press("n");
    seen.push(Number(await slider(page).inputValue()));
  }
  assert.ok(seen[0] > 0 && seen[1] > seen[0] && seen[2] > seen[1], String(seen));
  await page.keyboard.press("p");
  assert.equal(Number(await slider(page).inputValue()), seen[1]);
});

visit("buttons and the mouse do the same", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.game}#r=5`);
  await roundIs(page, 5);
  await button(page, "Next →").click();
  await roundIs(page, 6);
  const box = await slider(page).boundingBox();
  assert.ok(box);
  await page.mouse.click(box.x + box.width - 2, box.y + box.height / 2);
  await roundIs(page, ROUNDS);
  await agent(page, 2).click();
  await page.getByRole("region", { name: "Agent 2" }).waitFor();
});

visit("no key acts in an input, and ? says what keys do", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.game}#r=5`);
  await roundIs(page, 5);
  await page.keyboard.press("?");
  const help = page.getByRole("dialog");
  await help.getByText(/round/i).first().waitFor();
  await page.keyboard.press("Escape");
  await help.waitFor({ state: "hidden" });
  await page.getByRole("combobox", { name: "Speed" }).focus();
  await page.keyboard.press("n");
  await page.keyboard.press("Control+ArrowRight");
  assert.equal(await slider(page).inputValue(), "5");
});

visit("a link to a moment shows the same after a reload", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.game}#r=37&a=3&p=reasoning`);
  for (const _ of ["at first", "loaded again"]) {
    await roundIs(page, 37);
    assert.equal(await agent(page, 3).getAttribute("aria-pressed"), "true");
    await page.getByText("Round 37: Agent_3 compares").waitFor();
    await page.reload();
  }
  await button(page, "Prompt").click();
  await page.waitForURL(/p=prompt/);
  await page.getByText(/ACTION: /).first().waitFor();
  await button(page, "Answer").click();
  await page.getByText("I look around.").or(page.getByText("I cannot decide.")).first().waitFor();
});

visit("a link to this moment is copied", async ({ page, context }, { data, program }) => {
  await context.grantPermissions(["clipboard-read", "clipboard-write"]);
  await open(page, `/episodes/${data.game}#r=7&a=1`);
  await roundIs(page, 7);
  await button(page, "Copy a link to this moment").click();
  const copied = () => page.evaluate(() => navigator.clipboard.readText());
  assert.match(await copied(), new RegExp(`^${program.url}/episodes/${data.game}#.*r=7`));
});

visit("somebody plays on from a round", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.game}#r=12`);
  await roundIs(page, 12);
  await button(page, "Play on from round 12").click();
  const made = page.getByRole("region", { name: "A new game" });
  await made.getByText("begins with round 12 of this one").waitFor();
  assert.match(await made.getByRole("code").innerText(), /^swarm_/);
  await made.getByRole("link", { name: "Watch it" }).click();
  await page.getByText("plays on from round 12 of another game").waitFor();
  await roundIs(page, 12);
  await page.getByRole("main").getByRole("link", { name: "round 12 of another game" }).first().click();
  await page.waitForURL(new RegExp(`/episodes/${data.game}#r=12`));
  await roundIs(page, 12);
  await button(page, "Play on from round 12").click();
  await made.getByRole("button", { name: "Play all agents here" }).click();
  await page.waitForURL(/\/play\/ep_/);
  await page.getByText(/round 12/i).first().waitFor();
});

visit("after the last round of a game nothing can be played", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.game}#r=${ROUNDS}`);
  await roundIs(page, ROUNDS);
  assert.equal(await button(page, `Play on from round ${ROUNDS}`).count(), 0);
  await open(page, `/episodes/${data.game}#r=${ROUNDS - 1}`);
  await button(page, `Play on from round ${ROUNDS - 1}`).waitFor();
});

visit("the table says what the map shows", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.game}#r=7`);
  await button(page, "Table of agents").click();
  const table = page.getByRole("table").filter({ hasText: "Agent" }).first();
  await table.waitFor();
  assert.equal(await table.getByRole("row").count(), 5);
  await button(page, "All windows").click();
  await page.getByRole("img", { name: /agent 0/i }).first().waitFor();
});

visit("the server verifies a game", async ({ page }, { data, program }) => {
  await open(page, `/episodes/${data.game}`);
  await button(page, "Verify this game").click();
  const { result } = await program.get(`/api/v1/episodes/${data.game}`);
  await page.getByText(result.journal_head).waitFor();
});

visit("a game and its picture are taken along", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.built}#r=9`);
  await roundIs(page, 9);
  const [journal] = await Promise.all([page.waitForEvent("download"), button(page, "Journal").click()]);
  assert.match(await readFile(await journal.path(), "utf8"), /"kind"/);
  const [picture] = await Promise.all([page.waitForEvent("download"), button(page, "Picture of the map").click()]);
  const svg = await readFile(await picture.path(), "utf8");
  assert.match(svg, /^(<\?xml[^>]*>\s*)?<svg /);
  assert.doesNotMatch(svg, /<script|onload|var\(--/);
});

visit("a live game is followed over a restart of the server, to its end", async ({ page, watch }, { program }) => {
  const settings = { task: "Synchronization", seed: 3, num_agents: 3, max_round: 30, model: "live" };
  const { id, token } = await spoken(program, settings, { rounds: 3 });
  await open(page, `/episodes/${id}`);
  await roundIs(page, 3);
  const decide = talkative(3);
  await play(program, token, decide, 6);
  await roundIs(page, 6);
  await page.keyboard.press("Home");
  await roundIs(page, 0);
  await play(program, token, decide, 8);
  await slider(page).and(page.locator("[max='8'], [aria-valuemax='8']")).waitFor();
  await roundIs(page, 0);
  await button(page, "Follow").click();
  await roundIs(page, 8);
  watch.expect(/ERR_|503/);
  await program.restart();
  await play(program, token, decide, 12);
  await roundIs(page, 12);
  await play(program, token, decide);
  await roundIs(page, 30);
  await page.getByText("finished").first().waitFor();
});
