// The page of a competition for each of its readers: what they can do comes first, own places are shown, long names stay readable.
import assert from "node:assert/strict";
import { NARROW, open, visitor } from "./support/browser.mjs";
import { competition, play } from "./support/games.mjs";
import { suite } from "./support/suite.mjs";

/** The time that the revealed competition is open. */
const SHORT_MS = 4000;

const ENTRANTS = 200;

/** How many entrants have played an attempt. */
const PLAYED = 4;

const LONG = "Wolkenkuckucksheim".repeat(5);

const TINY = { tasks: ["Pursuit"], seeds: 2, settings: { num_agents: 2, max_round: 1 } };

/** @param {import("./support/program.mjs").Program} program */
async function crowded(program) {
  const { id } = await competition(program, { name: "Spring cup", attempts: 2, suite: TINY });
  const keys = [];
  for (let n = 0; n < ENTRANTS; n++) {
    const name = n === 0 ? LONG : `team ${n}`;
    const { key } = await program.post(`/api/v1/competitions/${id}/entrants`, { name, model: n === 0 ? "M".repeat(120) : "m" }, { token: "" });
    keys.push(key);
    if (n >= PLAYED) continue;
    const { swarm_token: token } = await program.post(`/api/v1/competitions/${id}/attempts`, {}, { token: key });
    await play(program, token, () => ({ action: "STAY" }));
  }
  const { secret: judge } = await program.post("/api/v1/keys", { name: "jury", role: "judge" });
  return { id, keys, judge };
}

/** @param {import("./support/program.mjs").Program} program */
async function revealed(program) {
  const closes_at = new Date(Date.now() + SHORT_MS).toISOString();
  const { id } = await competition(program, { name: "Winter cup", suite: TINY, closes_at, clocks: { round_deadline_s: 1 } });
  while ((await program.get(`/api/v1/competitions/${id}`)).phase !== "closed") await new Promise((resolve) => setTimeout(resolve, 200));
  return id;
}

const { site, visit } = suite({ keys: true }, async (program) => {
  const closed = await revealed(program);
  return { ...(await crowded(program)), closed };
});

/** Headings of the page from top to bottom. @param {import("playwright-core").Page} page */
const headings = (page) => page.getByRole("main").getByRole("heading", { level: 2 }).allInnerTexts();

/** Rows of a table without its head. @param {import("playwright-core").Page} page @param {string} name */
const rows = (page, name) => page.getByRole("region", { name, exact: true }).locator("tbody tr");

visit(
  "a visitor can enter at the top, reads the rules next, and finds 25 of 200 entrants",
  async ({ page }, { data }) => {
    await open(page, `/competitions/${data.id}`);
    assert.equal(await page.locator(".late").count(), 0, "nothing says that the page does not start");
    assert.deepEqual((await headings(page)).slice(0, 3), ["Take part", "How it is played", "Standings"]);
    const box = await page.locator("summary", { hasText: /^Enter$/ }).boundingBox();
    assert.ok(box && box.y + box.height < NARROW.height, "without scrolling");
    assert.equal(await page.getByLabel("Name on the board").isVisible(), false);
    await page.locator("summary", { hasText: /^Enter$/ }).press("Enter");
    await page.getByLabel("Name on the board").waitFor();
    for (const table of ["Table of standings", "Table of entrants"]) {
      assert.equal(await rows(page, table).count(), 25, table);
    }
    await page.getByRole("region", { name: "Entrants" }).getByRole("button", { name: "More" }).click();
    await page.waitForFunction(() => document.querySelectorAll('[aria-label="Table of entrants"] tbody tr').length === 50);
    assert.equal(await page.getByText("organizer's key").count(), 0);
  },
  { viewport: NARROW },
);

visit("names are no narrower than words, and the rest of a long one is a press away", async ({ page }, { data }) => {
  for (const width of [380, 800, 860, 1440]) {
    await page.setViewportSize({ width, height: 900 });
    await open(page, `/competitions/${data.id}`);
    for (const table of ["Table of standings", "Table of entrants"]) {
      const cells = await rows(page, table).locator("th").evaluateAll((cells) => cells.map((cell) => ({ wide: cell.clientWidth, high: cell.clientHeight })));
      assert.ok(cells.every(({ wide }) => wide >= 120), `${width} px: ${table}: ${Math.min(...cells.map(({ wide }) => wide))} px wide`);
      assert.ok(cells.every(({ high }) => high <= 240), `${width} px: ${table}: ${Math.max(...cells.map(({ high }) => high))} px high`);
    }
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `${width} px: the page scrolls to the side`);
  }
  const long = rows(page, "Table of standings").locator("summary", { hasText: "Wolken" });
  assert.equal(await long.getAttribute("title"), LONG);
  await long.press("Enter");
  await rows(page, "Table of standings").getByText(LONG, { exact: true }).waitFor();
});

/** @param {(page: import("playwright-core").Page) => Promise<void>} look @param {string} key @param {string} address */
async function as(look, key, address) {
  const one = await visitor(site.browser, site.program, { key });
  await open(one.page, address);
  await look(one.page);
  await one.done();
}

visit("an entrant sees its place, what is left, and its own row wherever it stands", async (_, { data }) => {
  await as(
    async (page) => {
      assert.deepEqual((await headings(page)).slice(0, 3), ["Your entrant", "How it is played", "Standings"]);
      const part = page.getByRole("region", { name: "Your entrant" });
      await part.getByText(new RegExp(`^team 1\\s*Rank 1 of ${PLAYED}, total \\S+, tied\\.$`)).waitFor();
      await part.getByText("1 of 2 attempts left.").waitFor();
      await part.getByRole("button", { name: "Start the next attempt" }).waitFor();
      await rows(page, "Table of standings").filter({ hasText: "yours" }).getByText("team 1", { exact: true }).waitFor();
      assert.equal(await rows(page, "Table of standings").count(), 25);
    },
    data.keys[1],
    `/competitions/${data.id}`,
  );
  await as(
    async (page) => {
      await page.getByText("No rank: none of your attempts is on the board.").waitFor();
      await page.getByText("2 of 2 attempts left.").waitFor();
      const own = rows(page, "Table of standings").filter({ hasText: "yours" });
      await own.getByText("team 180", { exact: true }).waitFor();
      assert.equal(await rows(page, "Table of standings").count(), 26, "below the first 25");
      assert.match(String(await own.getAttribute("class")), /apart/);
    },
    data.keys[180],
    `/competitions/${data.id}`,
  );
});

visit("a judge reads what a judge can do, and is offered nothing else", async (_, { data }) => {
  await as(
    async (page) => {
      await page.getByText("This is a judge's key").waitFor();
      assert.equal((await headings(page))[0], "Your key");
      for (const label of ["Enter", "Start the next attempt", "Practise"]) assert.equal(await page.getByText(label, { exact: true }).count(), 0, label);
      await page.getByRole("link", { name: "Look at all attempts" }).click();
      await page.getByText("A judge's key: jury.").waitFor();
      const desk = page.getByRole("main");
      await rows(page, "Table of attempts").first().waitFor();
      for (const label of ["Announce something", "Cancel the competition", "Contacts as CSV", "Keys", "Start"]) assert.equal(await desk.getByText(label, { exact: true }).count(), 0, label);
      assert.equal(await desk.getByRole("checkbox").count(), 0);
      await page.getByRole("button", { name: "Actions for attempt 1 of team 1", exact: true }).click();
      const shown = page.locator(".menu:popover-open");
      assert.deepEqual(await shown.locator("button, a").allInnerTexts(), ["Its scores", "Its games"]);
    },
    data.judge,
    `/competitions/${data.id}`,
  );
});

visit(
  "an organizer finds entrants among all 200, and changes many at once",
  async ({ page }, { program, data }) => {
    await open(page, `/desk?view=competition&id=${data.id}`);
    await page.getByText("An organizer's key: olga.").waitFor();
    await rows(page, "Table of entrants").first().waitFor();
    assert.equal(await rows(page, "Table of entrants").count(), 48);
    const filters = page.getByRole("search", { name: "Filters of entrants" });
    await filters.getByLabel("Find").fill("TEAM 19");
    assert.equal(await rows(page, "Table of entrants").count(), 11, "team 19, and 190 to 199");
    await page.getByLabel("Choose all that fit").check();
    await page.getByLabel("Choose team 19", { exact: true }).uncheck();
    await page.getByText("10 chosen").waitFor();
    await page.getByRole("button", { name: "Disqualify 10 entrants" }).press("Enter");
    await page.getByRole("dialog").getByLabel("Reason").fill("bots");
    await page.keyboard.press("Enter");
    await page.getByRole("dialog").waitFor({ state: "hidden" });
    await filters.getByLabel("Find").fill("");
    await filters.getByLabel("Status").selectOption("disqualified");
    await filters.getByText(`10 of ${ENTRANTS}`).waitFor();
    await rows(page, "Table of entrants").getByText("bots").first().waitFor();
    const { items } = await program.get(`/api/v1/competitions/${data.id}/entrants?limit=1000`);
    assert.equal(items.filter((one) => one.status === "disqualified" && one.reason === "bots").length, 10);
    // What cannot be taken back stands below a line, and a menu closes at Escape.
    const menu = page.getByRole("button", { name: "Actions for team 190", exact: true });
    await menu.press("Enter");
    const shown = page.locator(".menu:popover-open");
    assert.deepEqual(await shown.locator("button, hr").evaluateAll((all) => all.map((one) => one.textContent || "–")), ["Details", "Vouch", "Readmit", "–", "Replace the key"]);
    await page.keyboard.press("Escape");
    assert.equal(await menu.evaluate((one) => one === document.activeElement), true);
    // Many names do not move what will happen out of sight.
    await filters.getByLabel("Status").selectOption("active");
    await page.getByLabel("Choose all that fit").check();
    await page.getByRole("button", { name: `Withdraw ${ENTRANTS - 10} entrants` }).click();
    await page.getByRole("dialog").getByText(/, and 180 more$/).waitFor();
    await page.keyboard.press("Escape");
    await page.setViewportSize(NARROW);
    const box = await page.getByRole("button", { name: "Actions for team 1", exact: true }).boundingBox();
    assert.ok(box && box.x + box.width <= NARROW.width, "a menu is in sight without scrolling sideways");
  },
  { asOrganizer: true },
);

visit(
  "the desk, keys and the API stand in the menu of the key, and the audit log is in words",
  async ({ page }, { program, data }) => {
    await open(page, "/");
    const banner = page.getByRole("banner");
    assert.equal(await banner.getByRole("navigation").getByText(/Desk|API|Key/).count(), 0);
    await banner.getByRole("button", { name: "Key: entered" }).click();
    await banner.getByRole("link", { name: "Desk" }).click();
    await page.getByRole("heading", { name: "Desk" }).waitFor();
    const { items } = await program.get(`/api/v1/competitions/${data.id}/entrants?limit=1`);
    await program.call("PATCH", `/api/v1/competitions/${data.id}/entrants/${items[0].id}`, { body: { vouched: true } });
    await page.getByRole("link", { name: "Audit log" }).click();
    const entry = page.getByRole("row", { name: /Changed an entrant/ }).filter({ hasText: "vouched for" });
    await entry.getByText(LONG).first().waitFor();
    await entry.getByText("in Spring cup").waitFor();
    assert.doesNotMatch(await page.getByRole("region", { name: "Table of audit entries" }).innerText(), /ent_|\{|entrant\.change/);
  },
  { asOrganizer: true },
);

visit(
  "a link to the check of the results leads to it, and so does the phase",
  async ({ page }, { data }) => {
    const isInSight = async () => {
      await page.getByRole("button", { name: "Verify" }).waitFor();
      await page.waitForFunction(() => {
        const top = document.getElementById("verify")?.getBoundingClientRect().top ?? -1;
        return top >= 0 && top < innerHeight / 2;
      });
    };
    await open(page, `/competitions/${data.closed}#verify`);
    await isInSight();
    await open(page, `/competitions`);
    await open(page, `/competitions/${data.closed}`);
    await page.getByRole("link", { name: "Anybody can check them" }).press("Enter");
    await isInSight();
  },
  { viewport: NARROW },
);

visit("after the reveal nothing is to be noted, and a moment that is now is now", async ({ page }, { data }) => {
  await open(page, `/competitions/${data.closed}`);
  await page.getByText("It was published before anybody played").waitFor();
  assert.equal(await page.getByText("Note it now").count(), 0);
  assert.deepEqual((await headings(page)).slice(0, 2), ["Standings", "How it is played"]);

  const now = new Date("2026-01-01T12:00:00Z");
  await page.clock.setFixedTime(now);
  await page.route("**/api/v1/competitions", async (route) => {
    const answer = await (await route.fetch()).json();
    const [one] = answer.items;
    await route.fulfill({ json: { ...answer, items: [{ ...one, phase: "closing", closes_at: now.toISOString() }] } });
  });
  await open(page, "/competitions");
  await page.getByRole("row", { name: /^(Spring|Winter) cup now/ }).waitFor();
});
