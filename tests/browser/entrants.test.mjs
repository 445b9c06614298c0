// Requirements of a competition for its entrants, and changes by them and organizers: terms, categories, contacts, teams, ranks.
import assert from "node:assert/strict";
import { NARROW, enterKey, open, visitor } from "./support/browser.mjs";
import { competition, play } from "./support/games.mjs";
import { suite } from "./support/suite.mjs";

/** The time that the revealed competition is open: its games are played by then. */
const SHORT_MS = 5000;

/**
 * A competition that is over. All entrants play the same and have equal totals, but some of red's answers are invalid.
 * @param {import("./support/program.mjs").Program} program
 */
async function revealed(program) {
  const made = await competition(program, {
    name: "Winter cup",
    closes_at: new Date(Date.now() + SHORT_MS).toISOString(),
    suite: { tasks: ["Pursuit", "Foraging"], seeds: 3, public_seeds: 1, settings: { num_agents: 4, max_round: 3 } },
    clocks: { round_deadline_s: 1 },
    categories: ["models", "people"],
    tie_breaks: ["invalid"],
  });
  const base = `/api/v1/competitions/${made.id}`;
  for (const [name, category] of [["red", "people"], ["blue", "models"]]) {
    const { key } = await program.post(`${base}/entrants`, { name, model: "m", category }, { token: "" });
    const attempt = await program.post(`${base}/attempts`, {}, { token: key });
    await play(program, attempt.swarm_token, () => ({ response: name === "red" ? "I do not know." : "ACTION: STAY" }));
  }
  while ((await program.get(base)).phase !== "closed") await new Promise((resolve) => setTimeout(resolve, 200));
  return made.id;
}

const { site, visit } = suite({ keys: true }, async (program) => ({ closed: await revealed(program) }));

/** @typedef {import("playwright-core").Page} Page */

/** A time as an input takes it; visitors are in UTC. @param {number} ms from now */
const localTime = (ms) => new Date(Date.now() + ms).toISOString().slice(0, 16);

/** Confirms the dialog that is open. @param {Page} page @param {string} label */
async function confirm(page, label) {
  const dialog = page.getByRole("dialog");
  await dialog.getByRole("button", { name: label, exact: true }).click();
  await dialog.waitFor({ state: "hidden" });
}

/** A fact of a competition, by its name. @param {Page} page @param {string} name */
const fact = (page, name) => page.locator(`dt:text-is("${name}") + dd`);

/** Creates a competition at the desk; returns its id. @param {Page} page */
async function create(page) {
  await open(page, "/desk?view=create");
  await page.getByLabel("Name (required)").fill("Spring cup");
  await page.getByLabel("Terms that entrants accept").fill("One entrant for each team.\n<b>Logs</b> are published.");
  await page.getByLabel("Opens (required)").fill(localTime(-60_000));
  await page.getByLabel("Categories, one a line").fill("models\npeople\n");
  const order = page.getByRole("group", { name: "What decides between equal totals" });
  for (const [place, rule] of ["timeouts", "invalid", "earliest"].entries()) {
    await order.getByRole("combobox").nth(place).selectOption(rule);
  }
  // A cleared tie break moves the following ones up.
  await order.getByRole("combobox").first().selectOption("");
  await page.getByLabel("Sealed seeds of each attempt").fill("5");
  await page.getByLabel("Seeds that make the board before the end").fill("2");
  await page.getByLabel("Clock of a round").fill("60");
  await page.getByRole("button", { name: "Create the competition" }).click();
  await page.getByRole("heading", { name: "Spring cup" }).waitFor();
  return String(new URL(page.url()).searchParams.get("id"));
}

/**
 * Reads a competition's page and enters, while the terms change. Returns the key.
 * @param {Page} page
 * @param {string} id
 * @param {() => Promise<unknown>} changeTerms
 */
async function enter(page, id, changeTerms) {
  await open(page, `/competitions/${id}`);
  const terms = page.getByRole("region", { name: "Terms, version 1" });
  assert.match(await terms.innerText(), /One entrant for each team\.\n<b>Logs<\/b> are published\./, "text only, with its lines");
  assert.match(await fact(page, "Equal totals").innerText(), /^the smaller share of invalid answers, then the attempt that counts and ended earlier\./);
  assert.equal(await fact(page, "Seeds of the board").innerText(), "Until it closes 2 of 5, then the other 3.");
  await page.locator("summary", { hasText: /^Enter$/ }).click();
  await page.getByLabel("Name on the board").fill("blue");
  await page.getByLabel("Model (required)").fill("m");
  await page.getByLabel("Contact").fill("blue@example.org");
  const tick = page.getByLabel("I accept the terms, version");
  const category = page.getByLabel("Category (required)");
  const enters = page.getByRole("button", { name: "Enter the competition" });
  const isMissing = (/** @type {import("playwright-core").Locator} */ field) => field.evaluate((one) => /** @type {HTMLInputElement} */ (one).validity.valueMissing);
  assert.deepEqual([await isMissing(tick), await isMissing(category)], [true, true]);
  await category.selectOption("people");
  await tick.press("Space");
  await changeTerms();
  await enters.press("Enter");
  await page.locator(".field", { has: tick }).getByText("must be 2").waitFor();
  await page.getByRole("region", { name: "Terms, version 2" }).getByText("One entrant for each team, at most.").waitFor();
  assert.equal(await tick.isChecked(), false, "nobody accepts what was not shown");
  assert.equal(await tick.evaluate((one) => one === document.activeElement), true, "the keyboard is at the field that is wrong");
  await tick.press("Space");
  await enters.press("Enter");
  const made = page.getByRole("group", { name: "The key of this entrant" });
  const shown = await made.innerText();
  const box = await made.boundingBox();
  assert.ok(box && box.y >= 0 && box.y + box.height <= NARROW.height, "what is shown once is in sight");
  await page.getByRole("button", { name: "Use it in this tab" }).click();
  await page.getByRole("button", { name: "This tab uses it" }).waitFor();
  return String(/secret_\w+/.exec(shown));
}

/** Adds a member; returns the key. @param {Page} page @param {string} name */
async function addMember(page, name) {
  await page.getByText(/^Team: \d+ members? beside/).click();
  await page.getByLabel("Name of the member").fill(name);
  await page.getByLabel("Name of the member").press("Enter");
  const shown = await page.getByRole("group", { name: `The key of ${name}` }).innerText();
  return String(/secret_\w+/.exec(shown));
}

visit(
  "terms, categories, contacts and teams, at the desk and on a telephone",
  async ({ page, watch }, { program }) => {
    watch.expect(/409/);
    const id = await create(page);
    const base = `/api/v1/competitions/${id}`;
    const made = await program.get(base);
    assert.deepEqual([made.terms.version, made.categories, made.tie_breaks, made.suite.public_seeds], [1, ["models", "people"], ["invalid", "earliest"], 2]);

    const telephone = await visitor(site.browser, program, { viewport: NARROW });
    telephone.watch.expect(/422/);
    const own = telephone.page;
    const key = await enter(own, id, () => program.call("PATCH", base, { body: { terms: "One entrant for each team, at most." } }));
    const [{ id: entrant, category, terms }] = (await program.get(`${base}/entrants`)).items;
    assert.deepEqual([category, terms], ["people", 2]);
    // This entrant has a key of its own, which no team shares.
    await program.post(`${base}/entrants`, { name: "olga", model: "m", category: "models", accepts_terms: 2 });

    await open(page, `/desk?view=competition&id=${id}`);
    await page.getByText("later ends, other texts").click();
    await page.getByLabel("Terms that entrants accept").fill("Two entrants\nfor each team.");
    await page.getByRole("button", { name: "Change the competition" }).click();
    await page.getByText("It was changed, and everybody sees what.").waitFor();
    const row = page.getByRole("region", { name: "Table of entrants", exact: true }).getByRole("row", { name: /blue/ });
    await row.getByText("version 2 of 3").waitFor();
    await page.getByRole("button", { name: "Actions for blue" }).press("Enter");
    await page.getByRole("button", { name: "Details", exact: true }).press("Enter");
    const details = page.getByRole("region", { name: "Details of blue" });
    await details.getByText("blue@example.org").waitFor();
    assert.equal(await details.evaluate((one) => one === document.activeElement), true, "the keyboard is where the details are");
    await details.getByLabel("Category").selectOption("models");
    await details.getByRole("button", { name: "Move it" }).click();
    await row.getByRole("cell", { name: "models", exact: true }).waitFor();
    const bea = await addMember(page, "Bea");
    assert.equal((await program.get(`${base}/entrants/${entrant}`, { token: bea })).contact, "blue@example.org");
    await details.getByRole("button", { name: "Close the details" }).press("Enter");
    assert.equal(await page.evaluate(() => document.activeElement?.getAttribute("aria-label")), "Actions for blue");
    await page.getByRole("button", { name: "Actions for olga" }).click();
    await page.getByRole("button", { name: "Details", exact: true }).click();
    await page.getByText(/^Team: 0 members/).click();
    await page.getByLabel("Name of the member").fill("Carl");
    await page.getByRole("button", { name: "Add a member" }).click();
    await page.getByRole("alert").getByText("entered with a key of its own").waitFor();

    // The entrant itself.
    await open(own, `/competitions/${id}`);
    await own.getByText("You accepted version 2; the newest is version 3.").waitFor();
    await own.getByRole("button", { name: "Accept version 3" }).press("Enter");
    await own.getByRole("dialog").getByText("Two entrants\nfor each team.").waitFor();
    await confirm(own, "Accept version 3");
    await own.getByText("You accepted version 3 of the terms, the newest.").waitFor();
    await own.getByText("Change or leave").click();
    const mine = own.locator("details", { has: own.getByText("Change or leave: name, contact, team", { exact: true }) });
    const contact = mine.getByLabel("Contact");
    assert.equal(await contact.inputValue(), "blue@example.org");
    const contactNow = async () => (await program.get(`${base}/entrants/${entrant}`, { token: key })).contact;
    for (const [value, said] of [["+49 30 1", "The contact was changed."], ["", "The contact was removed."]]) {
      await contact.fill(value);
      await contact.press("Enter");
      await mine.getByText(said).waitFor();
      assert.equal(await contactNow(), value || null);
    }
    const ada = await addMember(own, "Ada");
    await own.getByRole("button", { name: "Remove Ada" }).click();
    await confirm(own, "Remove");
    await own.getByRole("button", { name: "Remove Ada" }).waitFor({ state: "hidden" });
    await assert.rejects(program.get(`${base}/attempts`, { token: ada }), /401/);
    await own.getByRole("button", { name: "Remove Bea" }).waitFor();
    // Another member of the team sees the same, even before the first attempt.
    await enterKey(own, bea);
    await open(own, `/competitions/${id}`);
    await own.getByText("Change or leave").click();
    await own.getByText(/^Team: 1 member beside/).waitFor();
    await own.getByRole("region", { name: "Table of what organizers did" }).getByText("version 3 of the terms").waitFor();
    await telephone.done();

    await program.call("DELETE", `${base}/entrants/${entrant}`, { token: key });
    await page.reload();
    const erased = page.getByRole("row", { name: /erased ent_/ });
    await erased.getByText("erased", { exact: true }).waitFor();
    await erased.getByRole("button", { name: /^Actions for/ }).click();
    for (const label of ["Readmit", "Replace the key"]) assert.equal(await erased.getByRole("button", { name: label, exact: true }).count(), 0);
    await erased.getByRole("button", { name: "Details", exact: true }).click();
    await page.getByText(/^Team: 0 members/).click();
    assert.equal(await page.getByRole("button", { name: "Add a member" }).count(), 0);
    assert.equal(await page.getByRole("button", { name: "Move it" }).count(), 0);
  },
  { asOrganizer: true },
);

visit(
  "the board of a category, and of the public seeds",
  async ({ page }, { data }) => {
    await open(page, `/competitions/${data.closed}`);
    const board = page.getByRole("region", { name: "Standings" });
    const rows = () => board.getByRole("region", { name: "Table of standings" }).getByRole("row").allInnerTexts();
    const ranks = async () => (await rows()).slice(1).map((row) => row.split(/\s+/).filter((word) => word !== "m").join(" ").replace(/ (\S+)( (?:models|people)).*/, "$2"));
    await board.getByText("Final part: 2 of 3 seeds.").waitFor();
    assert.deepEqual(await ranks(), ["1 blue models", "2 red people"], "invalid answers decide between equal totals");
    await board.getByLabel("Category").selectOption("people");
    await board.getByText("Category people: ranks among its entrants.").waitFor();
    await board.getByLabel("Board").selectOption("public");
    await board.getByText("Public part: 1 of 3 seeds.").waitFor();
    assert.deepEqual(await ranks(), ["1 red people"]);
    await page.reload();
    await board.getByText("Category people: ranks among its entrants. Public part: 1 of 3 seeds.").waitFor();
    assert.deepEqual(await ranks(), ["1 red people"]);
    assert.match(String(await board.getByRole("link", { name: "This board as CSV" }).getAttribute("href")), /category=people&part=public/);
    const columns = page.getByRole("region", { name: "Table of entrants" }).getByRole("cell", { name: "people", exact: true });
    assert.equal(await columns.count(), 1);
  },
  { viewport: NARROW },
);

visit("a voided attempt is played again on spare seeds after its window, and no start is offered that is refused", async ({ page }, { program }) => {
  const closes = Date.now() + 3000;
  const made = await competition(program, {
    ...{ name: "June cup", spares: 1, attempts_per_day: 1 },
    attempts: [{ closes_at: new Date(closes).toISOString() }, {}],
  });
  const base = `/api/v1/competitions/${made.id}`;
  const { key } = await program.post(`${base}/entrants`, { name: "blue", model: "m" }, { token: "" });
  const { run } = await program.post(`${base}/attempts`, {}, { token: key });
  await enterKey(page, key);
  await open(page, `/competitions/${made.id}`);
  const part = page.getByRole("region", { name: "Your entrant" });
  await part.getByText("1 of 2 attempts left, 1 on one day (UTC). Those of today are used").waitFor();
  const start = part.getByRole("button", { name: "Start the next attempt" });
  assert.equal(await start.count(), 0);
  await new Promise((resolve) => setTimeout(resolve, Math.max(0, closes - Date.now())));
  await program.post(`${base}/attempts/${run}/void`, { reason: "the disk was full" });
  await part.getByText("2 of 2 attempts left, 1 on one day (UTC). Attempt 1 was voided: you may start it again.").waitFor();
  await start.click();
  await confirm(page, "Start the next attempt");
  await part.getByText("on spare seeds").waitFor();
  await part.getByText("Those of today are used").waitFor();
});

visit("an entrant practises on open seeds, and sees how its games go", async ({ page, watch }, { program }) => {
  const made = await competition(program, {
    name: "Autumn cup",
    suite: { tasks: ["Pursuit", "Foraging"], seeds: 1, settings: { num_agents: 2, max_round: 2 } },
    own_games: "ended",
  });
  const base = `/api/v1/competitions/${made.id}`;
  const { key } = await program.post(`${base}/entrants`, { name: "blue", model: "m" }, { token: "" });
  await open(page, `/competitions/${made.id}`);
  assert.equal(await page.getByText("Practise").count(), 0, "it takes an entrant's key");
  await enterKey(page, key);
  await open(page, `/competitions/${made.id}`);
  await page.getByText("Practise").click();
  watch.expect(/422/);
  await page.getByLabel("Seeds").fill("7 1e99");
  await page.getByRole("button", { name: "Start a practice run" }).click();
  await page.getByRole("alert").waitFor();
  await page.getByLabel("Seeds").fill("7, 8");
  await page.getByRole("button", { name: "Start a practice run" }).click();
  await page.getByText("4 games on the seeds 7, 8").waitFor();
  const shown = await page.getByRole("group", { name: "The token of this practice run" }).innerText();
  await play(program, String(/swarm_\w+/.exec(shown)), () => ({ action: "STAY" }));
  await page.getByRole("link", { name: "see how they go" }).click();
  await page.getByRole("heading", { name: "m on practice for" }).waitFor();

  // The number of ended games opens the list of an attempt's games.
  const attempt = await program.post(`${base}/attempts`, {}, { token: key });
  await play(program, attempt.swarm_token, () => ({ action: "STAY" }));
  await open(page, `/competitions/${made.id}`);
  await page.getByRole("link", { name: "2 of 2" }).click();
  await page.getByRole("heading", { name: "m on a competition" }).waitFor();
});
