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
    await roundIs(page, 1);
    await page.keyboard.press("m");
    await page.keyboard.type("food here? s");
    await page.getByText("12 of 120, sent with the action").waitFor();
    await roundIs(page, 1);
    await page.keyboard.press("Enter");
    await page.keyboard.press("s");
    await roundIs(page, 2);
    assert.equal(await page.getByLabel("Message").inputValue(), "", "what was sent is gone");
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
    await roundIs(page, 1);
    await page.reload();
    await roundIs(page, 1);
    watch.expect(/ERR_|fetch|503/);
    await program.restart();
    await page.keyboard.press("s");
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
    }
    const link = page.getByRole("link", { name: /could not see|whole game/i }).first();
    await link.waitFor();
    assert.ok((await link.getAttribute("href"))?.startsWith(`/episodes/${id}`));
    // The viewer of games shows it here, with the own agent.
    await page.getByRole("heading", { name: "What you could not see" }).waitFor();
    await page.keyboard.press("ArrowRight");
    await page.getByRole("img", { name: /^Map\. Round 1\./ }).waitFor();
    assert.match((await link.getAttribute("href")) ?? "", new RegExp(`a=${await page.locator(".chooser [aria-pressed=true]").innerText()}$`));
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
  await page.getByRole("button", { name: "Take a seat again" }).waitFor();
});

/** Widths of a phone and of a desk. */
const WIDTHS = [380, 1280];

visit(
  "the pad stays where it is, and one press of it is an act",
  async ({ page }, { program }) => {
    const { id } = await mixed(program, { num_agents: 12, max_round: 12 });
    await open(page, `/play/${id}`);
    await page.getByRole("button", { name: /^Take/ }).first().click();
    for (const width of WIDTHS) {
      await page.setViewportSize({ width, height: 800 });
      const pad = page.getByRole("group", { name: "Action" });
      const places = /** @type {number[]} */ ([]);
      for (const action of ["Up", "Right", "Stay", "Left", "Down"]) {
        const box = await pad.boundingBox();
        assert.ok(box && box.y + box.height <= 800, "seen without scrolling");
        places.push(box.y);
        const before = await page.getByRole("definition").first().innerText();
        await pad.getByRole("button", { name: action }).click();
        await page.waitForFunction((before) => document.querySelector("dd")?.textContent !== before, before);
      }
      assert.deepEqual(places, Array(places.length).fill(places[0]), `${width} px`);
    }
  },
  AS,
);

visit(
  "the second press of a double click is no act of the next round",
  async ({ page }, { program }) => {
    const { id } = await mixed(program, { max_round: 12 });
    await open(page, `/play/${id}`);
    await page.getByRole("button", { name: /^Take/ }).first().click();
    await roundIs(page, 0);
    const stay = page.getByRole("group", { name: "Action" }).getByRole("button", { name: "Stay" });
    // The second press comes as soon as the next round is shown.
    await stay.evaluate((stay) => {
      const round = /** @type {Element} */ (document.querySelector("dd"));
      const press = () => round.textContent?.startsWith("1 of") && stay.dispatchEvent(new MouseEvent("click", { detail: 2, bubbles: true }));
      new MutationObserver(press).observe(round, { characterData: true, childList: true, subtree: true });
    });
    await stay.click();
    await roundIs(page, 1);
    await page.waitForTimeout(1_000);
    await roundIs(page, 1);
    await stay.click();
    await roundIs(page, 2);
  },
  AS,
);

visit(
  "messages are folded, stay open once they are opened, and codes are explained",
  async ({ page }, { program }) => {
    const { id } = await mixed(program, { num_agents: 12, width: 8, height: 8, max_round: 30 });
    await open(page, `/play/${id}`);
    await page.getByRole("button", { name: /^Take/ }).first().click();
    const heard = page.locator("details.heard");
    for (let round = 0; (await heard.count()) === 0; round++) {
      await roundIs(page, round);
      await page.keyboard.press("s");
      await roundIs(page, round + 1);
    }
    assert.equal(await heard.getByRole("listitem").count(), 0, "folded");
    await heard.locator("summary").click();
    await heard.getByText("Built-in players say codes").waitFor();
    await heard.getByText(/\(food is in row \d+, column \d+/).first().waitFor();
    await page.reload();
    await heard.getByRole("listitem").first().waitFor();
  },
  AS,
);

/** Messages of built-in players and what they mean; a text of a person means nothing more. */
const CODES = [
  ["Prey at 3 4 in round 17", "the prey was in row 3, column 4 in round 17"],
  ["Nest at 1 2", "the nest is in row 1, column 2"],
  ["Beat of 0 1", "agent 0 sets the beat: lights go on in the round in which it was said"],
  ["Square around 4 5", "the square is formed around row 4, column 5"],
  ["Swarm 11 4 5 18 116", "in round 11: 1 possible gap, 5 pushes of the block, places of 2 agents"],
  ["STOPHERE", ""],
  ["Prey at my side", ""],
];

visit("codes of built-in players", async ({ page }, { program }) => {
  const id = (await program.post("/api/v1/episodes", { task: "Pursuit", seed: 27, max_round: 12, player: "default", visibility: "public" })).id;
  await program.get(`/api/v1/episodes/${id}/events`, { text: true });
  const { states } = await program.get(`/api/v1/episodes/${id}/replay`);
  const news = states.flatMap(({ said = [] }) => said.map(({ text }) => text)).filter((text) => text.startsWith("S"));
  assert.ok(news.length > 10);
  await open(page, "/");
  const words = await page.evaluate(async (texts) => {
    const script = /** @type {HTMLScriptElement} */ (document.querySelector("script[src$='/app.js']"));
    const { meaning } = await import(script.src.replace("app.js", "parts/codes.js"));
    return texts.map((text) => meaning(text));
  }, [...CODES.map(([text]) => text), ...news]);
  assert.deepEqual(words.slice(0, CODES.length), CODES.map(([, meaning]) => meaning));
  for (const meant of words.slice(CODES.length)) assert.match(meant, /^the prey (is not found|was in row \d+, column \d+ \d+ rounds? before); places of \d+ agents?$/);
});
