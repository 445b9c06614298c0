// A game is watched, scrubbed, linked to and checked.
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { open } from "./support/browser.mjs";
import { hosted, play, spoken, talkative } from "./support/games.mjs";
import { suite } from "./support/suite.mjs";

const ROUNDS = 40;

const { visit } = suite({}, async (program) => ({
  game: (await spoken(program, { task: "Synchronization", seed: 27, num_agents: 4, max_round: ROUNDS, model: "gpt-x" })).id,
  other: (await spoken(program, { task: "Synchronization", seed: 27, num_agents: 4, max_round: 20, model: "gpt-y" }, { decide: talkative(3) })).id,
  built: await hosted(program, { task: "Foraging", seed: 27, max_round: 60 }),
}));

/** @param {import("playwright-core").Page} page */
const slider = (page) => page.getByRole("slider", { name: "Round" });

/** @param {import("playwright-core").Page} page @param {number} round */
const roundIs = (page, round) => page.getByRole("img", { name: new RegExp(`^Map\\. Round ${round}\\.`) }).waitFor();

/** @param {import("playwright-core").Page} page @param {string} name */
const button = (page, name) => page.getByRole("main").getByRole("button", { name, exact: true });

/** An entry of the menu of what one can do with a moment. @param {import("playwright-core").Page} page @param {string} name */
async function chosen(page, name) {
  await button(page, "Share and more").click();
  return button(page, name);
}

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

visit("a page that started does not say that it does not", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.game}`);
  assert.equal(await page.locator(".late").count(), 0);
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
  const isOff = (/** @type {string} */ name) => button(page, name).getAttribute("aria-disabled");
  assert.deepEqual([await isOff("Mark before"), await isOff("Next mark")], ["false", "false"]);
  await page.keyboard.press("End");
  await roundIs(page, ROUNDS);
  assert.deepEqual([await isOff("Mark before"), await isOff("Next mark")], ["false", "true"], "no mark comes after the end");
});

visit("buttons and the mouse do the same", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.game}#r=5`);
  await roundIs(page, 5);
  await button(page, "Next").click();
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

visit("a link to this moment is copied, and markup for other pages", async ({ page, context }, { data, program }) => {
  await context.grantPermissions(["clipboard-read", "clipboard-write"]);
  await open(page, `/episodes/${data.game}#r=7&a=1`);
  await roundIs(page, 7);
  const copied = () => page.evaluate(() => navigator.clipboard.readText());
  await (await chosen(page, "Copy a link to this moment")).click();
  await page.getByText("Copied: the link to round 7.").waitFor();
  assert.match(await copied(), new RegExp(`^${program.url}/episodes/${data.game}#.*r=7`));
  await (await chosen(page, "Copy markup that shows the game in another page")).click();
  await page.getByText("Copied: the markup for another page.").waitFor();
  assert.match(await copied(), new RegExp(`^<iframe src="${program.url}/embed/episodes/${data.game}"`));
  await page.keyboard.press("ArrowRight");
  await roundIs(page, 8);
  await page.keyboard.press("l");
  await page.getByText("Copied: the link to round 8.").waitFor();
  assert.match(await copied(), /r=8/);
});

visit("a browser that does not copy shows the link", async ({ page }, { data, program }) => {
  await page.addInitScript(() => Object.defineProperty(navigator, "clipboard", { value: undefined }));
  await open(page, `/episodes/${data.game}#r=7`);
  await roundIs(page, 7);
  await page.keyboard.press("l");
  assert.equal(await page.getByRole("textbox", { name: "the link to round 7" }).inputValue(), `${program.url}/episodes/${data.game}#r=7&a=0`);
});

visit("two games in step: a link follows the round, and the focus stays at both ends", async ({ page, context }, { data }) => {
  await context.grantPermissions(["clipboard-read", "clipboard-write"]);
  await open(page, `/compare?a=${data.game}&b=${data.other}#r=2`);
  const map = (/** @type {number} */ round) => page.getByRole("img", { name: `Map of game A in round ${round}` }).waitFor();
  await map(2);
  await page.keyboard.press("ArrowRight");
  await map(3);
  await page.keyboard.press("l");
  await page.getByText("Copied: the link to round 3.").waitFor();
  assert.match(await page.evaluate(() => navigator.clipboard.readText()), /#r=3/);
  const back = button(page, "Back");
  for (const round of [2, 1, 0, 0]) {
    await back.focus();
    await page.keyboard.press("Enter");
    await map(round);
  }
  assert.ok(await back.evaluate((back) => back === document.activeElement));
  await page.keyboard.press("?");
  const help = page.getByRole("dialog");
  await help.getByText("the next difference, the one before").waitFor();
  assert.equal(await help.getByText("a large map").count(), 0, "only keys that do something");
  await help.getByRole("button", { name: "Close" }).click();
  await page.keyboard.press("ArrowRight");
  // At once: the address follows later.
  await page.keyboard.press("x");
  await page.getByRole("region", { name: "Game A" }).getByText("gpt-y").waitFor();
  await map(1);
});

/** Windows of laptops, tablets and phones, and the frame for other pages. @type {[string, number, number][]} */
const WINDOWS = [["/episodes/", 1440, 700], ["/episodes/", 1366, 640], ["/episodes/", 800, 600], ["/episodes/", 380, 740], ["/embed/episodes/", 800, 700]];

visit("map, controls and curve are in one screen of a short window, with the whole decision", async ({ page }, { data }) => {
  const bottom = (/** @type {string} */ part) => page.locator(part).first().evaluate((part) => part.getBoundingClientRect().bottom);
  for (const [path, width, height] of WINDOWS) {
    await page.setViewportSize({ width, height });
    await open(page, `${path}${data.game}#r=7`);
    await roundIs(page, 7);
    for (const part of [".map", ".transport", ".scrubber input"]) assert.ok((await bottom(part)) <= height, `${width} × ${height}: ${part}`);
    const said = (await bottom(".decision dd:nth-of-type(2)")) - (await bottom(".panel-content"));
    assert.ok(said <= 0, `${width} × ${height}: what was chosen and said ends ${said} px below its panel`);
  }
  await page.locator(".panel-content").focus();
  await page.keyboard.press("ArrowRight");
  await roundIs(page, 8);
  await page.setViewportSize({ width: 800, height: 600 });
  await open(page, `/compare?a=${data.game}&b=${data.other}#r=2`);
  await page.getByText(/^They (part|differ)/).waitFor();
  for (const part of [".sides .map", ".transport", ".scrubber input"]) assert.ok((await bottom(part)) <= 600, part);
});

visit("map, controls and curve are in one screen of a phone, with icons that have names", async ({ page }, { data }) => {
  await page.setViewportSize({ width: 380, height: 800 });
  await open(page, `/episodes/${data.game}#r=7`);
  await roundIs(page, 7);
  const box = async (/** @type {import("playwright-core").Locator} */ one) => {
    const found = await one.boundingBox();
    assert.ok(found);
    return { top: found.y, bottom: found.y + found.height };
  };
  const [map, transport, round, panel] = [
    await box(page.locator(".map")),
    await box(page.getByRole("group", { name: "Rounds" })),
    await box(slider(page)),
    await box(page.getByRole("region", { name: "Agent 0" })),
  ];
  assert.ok(map.top >= 0 && round.bottom <= 800, `${map.top} to ${round.bottom}`);
  assert.ok(map.bottom <= transport.top && transport.bottom <= round.top && round.bottom <= panel.top);
  assert.ok(transport.bottom - transport.top < 60, "one row");
  for (const control of await page.getByRole("group", { name: "Rounds" }).getByRole("button").all()) {
    const word = (await control.innerText()).trim();
    assert.ok(word.length > 0, "a word beside its icon");
    assert.ok(((await control.boundingBox())?.height ?? 0) >= 44, word);
  }
});

visit("the map shows who spoke, to whom, and who gave no answer", async ({ page }, { data, program }) => {
  const { states } = await program.get(`/api/v1/episodes/${data.game}/replay`);
  for (const { round, said = [], heard = [], invalid = [] } of states.filter(({ said, invalid }) => said?.length || invalid?.length).slice(0, 6)) {
    await open(page, `/episodes/${data.game}#r=${round - 1}`);
    await roundIs(page, round - 1);
    assert.equal(await page.locator(".map .spoke").count(), said.length, `round ${round}`);
    assert.equal(await page.locator(".map .bad-sign", { hasText: "?" }).count(), invalid.length, `round ${round}`);
    // A line from the middle of the speaker, and a head in front of each hearer: two parts of a path.
    const paths = await page.locator(".map .heard").evaluateAll((all) => all.map((one) => one.getAttribute("d") ?? "").join(""));
    assert.equal(paths.split("M").length - 1, 2 * heard.flatMap(({ by }) => by).length, `round ${round}`);
  }
});

visit("what a built-in player says is explained", async ({ page }, { program }) => {
  const id = await hosted(program, { task: "Foraging", seed: 27, max_round: 12 });
  await open(page, `/episodes/${id}#r=10`);
  await roundIs(page, 10);
  await page.getByText(/^\(food is in row \d+, column \d+, the nest in row \d+, column \d+\)$/).first().waitFor();
});

visit("a link that is followed at once keeps its round", async ({ page, context }, { data }) => {
  await context.route("**/pages/compare.js", async (route) => {
    await new Promise((resolve) => setTimeout(resolve, 600));
    await route.continue();
  });
  await open(page, `/episodes/${data.game}#r=3`);
  await roundIs(page, 3);
  await page.evaluate((address) => {
    dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" }));
    const link = Object.assign(document.createElement("a"), { href: address });
    document.querySelector("main")?.append(link);
    link.click();
  }, `/compare?a=${data.game}&b=${data.other}#r=9`);
  await page.getByRole("img", { name: "Map of game A in round 9" }).waitFor();
});

visit("somebody plays on from a round", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.game}#r=12`);
  await roundIs(page, 12);
  await (await chosen(page, "Play on from round 12")).click();
  const made = page.getByRole("region", { name: "A new game" });
  await made.getByText("begins with round 12 of this one").waitFor();
  assert.match(await made.getByRole("code").innerText(), /^swarm_/);
  await made.getByRole("link", { name: "Watch it" }).click();
  await page.getByText("plays on from round 12 of another game").waitFor();
  // Round 12 is not decided there.
  await roundIs(page, 11);
  await page.getByRole("main").getByRole("link", { name: "round 12 of another game" }).first().click();
  await page.waitForURL(new RegExp(`/episodes/${data.game}#r=12`));
  await roundIs(page, 12);
  await (await chosen(page, "Play on from round 12")).click();
  await made.getByRole("button", { name: "Play all agents here" }).click();
  await page.waitForURL(/\/play\/ep_/);
  await page.getByText(/round 12/i).first().waitFor();
});

visit("after the last round of a game nothing can be played", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.game}#r=${ROUNDS}`);
  await roundIs(page, ROUNDS);
  assert.equal(await (await chosen(page, `Play on from round ${ROUNDS}`)).count(), 0);
  await page.keyboard.press("Escape");
  await open(page, `/episodes/${data.game}#r=${ROUNDS - 1}`);
  await (await chosen(page, `Play on from round ${ROUNDS - 1}`)).waitFor();
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
  // By keys alone: facts are read when they are near.
  const commands = page.getByRole("main").locator("summary", { hasText: "Commands" });
  await commands.focus();
  await button(page, "Verify this game").waitFor();
  await page.keyboard.press("Tab");
  assert.ok(await button(page, "Verify this game").evaluate((verify) => verify === document.activeElement));
  await page.keyboard.press("Enter");
  const { result } = await program.get(`/api/v1/episodes/${data.game}`);
  await page.getByText(result.journal_head).waitFor();
});

visit("a game and its picture are taken along", async ({ page }, { data }) => {
  await open(page, `/episodes/${data.built}#r=9`);
  await roundIs(page, 9);
  const journalEntry = await chosen(page, "Download the journal");
  const [journal] = await Promise.all([page.waitForEvent("download"), journalEntry.click()]);
  assert.match(await readFile(await journal.path(), "utf8"), /"kind"/);
  const pictureEntry = await chosen(page, "Download a picture of the map");
  const [picture] = await Promise.all([page.waitForEvent("download"), pictureEntry.click()]);
  const svg = await readFile(await picture.path(), "utf8");
  assert.match(svg, /^(<\?xml[^>]*>\s*)?<svg /);
  assert.doesNotMatch(svg, /<script|onload|var\(--/);
});

visit("a live game is followed over a restart of the server, to its end", async ({ page, watch }, { program }) => {
  const settings = { task: "Synchronization", seed: 3, num_agents: 3, max_round: 30, model: "live" };
  const { id, token } = await spoken(program, settings, { rounds: 3 });
  await open(page, `/episodes/${id}`);
  await roundIs(page, 2);
  const decide = talkative(3);
  await play(program, token, decide, 6);
  await roundIs(page, 5);
  await page.keyboard.press("Home");
  await roundIs(page, 0);
  await play(program, token, decide, 8);
  await slider(page).and(page.locator("[max='7'], [aria-valuemax='7']")).waitFor();
  await roundIs(page, 0);
  await button(page, "Follow").click();
  await roundIs(page, 7);
  watch.expect(/ERR_|503/);
  await program.restart();
  await play(program, token, decide, 12);
  await roundIs(page, 11);
  await play(program, token, decide);
  await roundIs(page, 30);
  await page.getByText("finished").first().waitFor();
});
