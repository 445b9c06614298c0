// A person at a seat: the page, its requests to the server, and failures.
import assert from "node:assert/strict";
import { open } from "./support/browser.mjs";
import { suite } from "./support/suite.mjs";

const { visit } = suite({ keys: true }, async (program) => program);

const AS = { asOrganizer: true };

/** Routes whose answers have more than an agent may know. */
const BEYOND = /\/(state|events|replay|journal|metrics|scores|rounds|worth|line)\b/;

/** @param {import("playwright-core").Page} page */
async function begin(page) {
  await page.goto("/play");
  await page.getByRole("radio", { name: /^Foraging/ }).check();
  await page.getByRole("button", { name: "small" }).click();
  await page.getByRole("button", { name: "Play", exact: true }).click();
  await page.waitForURL(/\/play\/ep_/);
  await roundIs(page, 0);
}

/** @param {import("playwright-core").Page} page @param {number} round */
const roundIs = (page, round) =>
  page
    .getByRole("definition")
    .filter({ hasText: new RegExp(`^${round} of \\d+$`) })
    .waitFor();

/** A game with one open seat. @param {import("./support/program.mjs").Program} program @param {object} [settings] */
const mixed = (program, settings = {}) =>
  program.post("/api/v1/episodes", {
    ...{ task: "Foraging", seed: 27, num_agents: 3, max_round: 2, player: "default", open_seats: 1, visibility: "public" },
    ...settings,
  });

visit(
  "a game is started with a click and played with keys",
  async ({ page }) => {
    const asked = /** @type {string[]} */ ([]);
    page.on("request", (request) => asked.push(new URL(request.url()).pathname));
    await begin(page);
    await page.keyboard.press("ArrowUp");
    await page.keyboard.press("Enter");
    await roundIs(page, 1);
    await page.keyboard.press("s");
    await page.keyboard.press("m");
    await page.keyboard.type("food here? s");
    await page.getByText("12 of 120").waitFor();
    await page.keyboard.press("Enter");
    await roundIs(page, 2);
    await page.getByText(/STAY.*food here\? s|food here\? s/).first().waitFor();
    assert.deepEqual(
      asked.filter((path) => path.startsWith("/api/v1/episodes/") && BEYOND.test(path)),
      [],
    );
  },
  AS,
);

visit(
  "a seat is kept over a reload, and over a restart of the server",
  async ({ page, watch }, { program }) => {
    await begin(page);
    await page.keyboard.press("s");
    await page.keyboard.press("Enter");
    await roundIs(page, 1);
    await page.reload();
    await roundIs(page, 1);
    watch.expect(/ERR_|fetch|503/);
    await program.restart();
    await page.keyboard.press("s");
    await page.keyboard.press("Enter");
    await roundIs(page, 2);
  },
  AS,
);

visit(
  "after the end a person sees what it could not see",
  async ({ page }, { program }) => {
    const { id } = await mixed(program);
    await open(page, `/play/${id}`);
    await page.getByRole("button", { name: /^Take/ }).first().click();
    for (const round of [0, 1]) {
      await roundIs(page, round);
      await page.keyboard.press("s");
      await page.keyboard.press("Enter");
    }
    const link = page.getByRole("link", { name: /could not see|whole game/i }).first();
    await link.waitFor();
    assert.ok((await link.getAttribute("href"))?.startsWith(`/episodes/${id}`));
    const { items } = await program.get(`/api/v1/episodes?limit=1`);
    assert.equal(items[0].status, "finished");
  },
  AS,
);

visit(
  "a person is marked as one",
  async ({ page }, { program }) => {
    const { id } = await mixed(program);
    await open(page, `/play/${id}`);
    await page.getByRole("button", { name: /^Take/ }).first().click();
    await roundIs(page, 0);
    const lines = await program.get(`/api/v1/episodes/${id}/journal`, { text: true });
    assert.match(lines, /"kind":"human"/);
  },
  AS,
);

visit(
  "a game without open seats says so",
  async ({ page, watch }, { program }) => {
    watch.expect(/409/);
    const { id } = await mixed(program);
    await program.post(`/api/v1/episodes/${id}/claims`, { seats: 1, model: "somebody else" });
    await open(page, `/play/${id}`);
    assert.equal(await page.getByRole("button", { name: /^Take/ }).count(), 0);
    await page.getByText("Every seat has a holder").waitFor();
    await page.getByRole("link", { name: "the game" }).waitFor();
  },
  AS,
);

visit("a code of a seat is enough, and a page says when it is replaced", async ({ page, watch }, { program }) => {
  const body = { task: "Foraging", seed: 27, num_agents: 1, visibility: "public" };
  const create = async () => {
    const answer = await fetch(`${program.url}/api/v1/episodes`, {
      method: "POST",
      headers: { "Content-Type": "application/json", "Idempotency-Key": "seat", Authorization: `Bearer ${program.organizer}` },
      body: JSON.stringify(body),
    });
    return answer.json();
  };
  const { seats } = await create();
  await open(page, "/play");
  await page.getByLabel(/Code of a seat/).fill(seats[0].token);
  await page.getByRole("button", { name: "Play with this code" }).click();
  await roundIs(page, 0);
  // A repeated creation replaces all tokens.
  await create();
  watch.expect(/401/);
  await page.keyboard.press("s");
  await page.keyboard.press("Enter");
  await page.getByRole("button", { name: "Take a seat again" }).waitFor();
});
