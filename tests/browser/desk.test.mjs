// Competitions from their creation to the check of their results, and the rest of the desk, without a command line.
import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { NARROW, open, visitor } from "./support/browser.mjs";
import { competition, play } from "./support/games.mjs";
import { suite } from "./support/suite.mjs";

const AS = { asOrganizer: true };

const SMALL = { tasks: ["Pursuit", "Foraging"], seeds: 1, settings: { num_agents: 4, max_round: 5 } };

/** The time that the revealed competition is open: its games are played by then. */
const SHORT_MS = 5000;

/** A competition that is over. @param {import("./support/program.mjs").Program} program */
async function revealed(program) {
  const now = Date.now();
  const made = await program.post("/api/v1/competitions", {
    name: "Winter cup",
    opens_at: new Date(now - 1000).toISOString(),
    closes_at: new Date(now + SHORT_MS).toISOString(),
    // A file of the second format, with all that makes its board.
    ...{ spares: 1, tie_breaks: ["invalid", "timeouts", "attempts", "earliest"] },
    suite: { ...SMALL, seeds: 2, public_seeds: 1 },
    clocks: { round_deadline_s: 1 },
  });
  const base = `/api/v1/competitions/${made.id}`;
  await program.call("PATCH", base, { body: { description: "Another text." } });
  const entrant = await program.post(`${base}/entrants`, { name: "grey", model: "m" }, { token: "" });
  const attempt = await program.post(`${base}/attempts`, {}, { token: entrant.key });
  await play(program, attempt.swarm_token, () => ({ action: "STAY" }));
  // Equal totals: the second entrant is behind, and its first attempt is played again on other seeds.
  const second = await program.post(`${base}/entrants`, { name: "beige", model: "m" }, { token: "" });
  const voided = await program.post(`${base}/attempts`, {}, { token: second.key });
  await program.post(`${base}/attempts/${voided.run}/void`, { reason: "the disk was full" });
  const again = await program.post(`${base}/attempts`, {}, { token: second.key });
  await play(program, again.swarm_token, () => ({ action: "STAY" }));
  while ((await program.get(base)).phase !== "closed") await new Promise((resolve) => setTimeout(resolve, 200));
  return made.id;
}

const { site, visit } = suite({ keys: true }, async (program) => ({ closed: await revealed(program) }));

/** A time as an input takes it; visitors are in UTC. @param {number} ms from now */
const localTime = (ms) => new Date(Date.now() + ms).toISOString().slice(0, 16);

/** Confirms the dialog that is open. @param {import("playwright-core").Page} page @param {string} label @param {string} [reason] */
async function confirm(page, label, reason) {
  const dialog = page.getByRole("dialog");
  if (reason) await dialog.getByLabel("Reason").fill(reason);
  await dialog.getByRole("button", { name: label, exact: true }).click();
  await dialog.waitFor({ state: "hidden" });
}

/** Chooses an act of the menu of a row. @param {import("playwright-core").Page | import("playwright-core").Locator} page @param {string} row @param {string} label */
async function choose(page, row, label) {
  const menu = page.getByRole("button", { name: `Actions for ${row}`, exact: true });
  await menu.click();
  await menu.locator("xpath=following-sibling::*[1]").getByRole("button", { name: label, exact: true }).click();
}

/** Creates a competition at the desk; returns its id and a code. @param {import("playwright-core").Page} page */
async function create(page) {
  await open(page, "/desk?view=create");
  await page.getByLabel("Name (required)").fill("Spring cup");
  await page.getByLabel("Opens (required)").fill(localTime(-60_000));
  await page.getByLabel("Closes (required)").fill(localTime(-3_600_000));
  await page.getByLabel("Clock of a round").fill("60");
  await page.getByLabel("Entry").selectOption("codes");
  await page.getByLabel("Spare attempts").fill("1");
  await page.getByLabel("Attempts that an entrant may start on one day").fill("1");
  await page.getByRole("button", { name: "Create the competition" }).click();
  await page.getByText("must be after “Opens”").first().waitFor();
  const focused = await page.evaluate(() => /** @type {HTMLInputElement} */ (document.activeElement).labels?.[0]?.textContent);
  assert.match(String(focused), /^Closes/, "the field that is wrong has the focus");
  await page.getByLabel("Closes (required)").fill(localTime(3_600_000));
  await page.getByRole("button", { name: "Create the competition" }).click();
  await page.getByLabel("Receivers, one a line").fill("team blue\nteam red");
  await page.getByRole("button", { name: "Make codes" }).click();
  const codes = await page.getByRole("region", { name: "New codes" }).innerText();
  return { id: String(new URL(page.url()).searchParams.get("id")), code: String(/invite_\w+/.exec(codes)) };
}

/** Enters a competition and starts an attempt, on a telephone. @param {import("playwright-core").Page} page @param {string} id @param {string} code */
async function enter(page, id, code) {
  await open(page, `/competitions/${id}`);
  await page.locator("summary", { hasText: /^Enter$/ }).click();
  await page.getByLabel("Name on the board").fill("blue");
  await page.getByLabel("Model (required)").fill("model-b");
  await page.getByLabel("Invitation code").fill(code);
  await page.getByRole("button", { name: "Enter the competition" }).click();
  await page.getByRole("button", { name: "Use it in this tab" }).click();
  await page.getByRole("button", { name: "Start the next attempt" }).click();
  await confirm(page, "Start the next attempt");
  const shown = await page.getByRole("group", { name: "The token of this attempt" }).innerText();
  await page.getByRole("row", { name: /^1 running/ }).waitFor();
  return String(/swarm_\w+/.exec(shown));
}

visit(
  "a competition is created, entered and managed without a command line",
  async ({ page, watch }) => {
    watch.expect(/422/);
    const { id, code } = await create(page);
    const made = await site.program.get(`/api/v1/competitions/${id}`);
    assert.deepEqual([made.spares, made.attempts_per_day], [1, 1]);
    const entrant = await visitor(site.browser, site.program, { viewport: NARROW });
    const token = await enter(entrant.page, id, code);
    assert.equal((await site.program.get("/swarm/obs", { token })).finished, false);
    await entrant.done();

    await open(page, `/desk?view=competition&id=${id}`);
    await page.getByRole("button", { name: "Actions for blue" }).press("Enter");
    await page.getByRole("button", { name: "Disqualify", exact: true }).press("Enter");
    await page.getByRole("dialog").getByLabel("Reason").waitFor();
    await page.keyboard.type("two <b>entrants</b> of one team");
    await page.keyboard.press("Enter");
    await page.getByText("two <b>entrants</b> of one team").first().waitFor();
    const focused = await page.evaluate(() => document.activeElement?.getAttribute("aria-label"));
    assert.equal(focused, "Actions for blue", "the keyboard stays near what has changed");
    await choose(page, "blue", "Readmit");
    await confirm(page, "Readmit");
    await choose(page, "attempt 1 of blue", "Void");
    await confirm(page, "Void", "the disk was full");
    await page.getByText("the disk was full").first().waitFor();

    await open(page, "/desk?view=audit");
    for (const action of ["Voided an attempt", "Changed an entrant", "Created it"]) {
      await page.getByRole("rowheader", { name: action }).first().waitFor();
    }
  },
  AS,
);

/** A competition with an entrant that has an attempt, and two entrants without. @param {import("./support/program.mjs").Program} program */
async function manyEntrants(program) {
  const { id } = await competition(program, { name: "Summer cup", entry: "codes", attempts: 2, spares: 1 });
  const base = `/api/v1/competitions/${id}`;
  const { items } = await program.post(`${base}/codes`, { labels: ["blue", "bot 1", "bot 2", "late"] });
  const keys = [];
  for (const [place, name] of ["blue", "bot-1", "bot-2"].entries()) {
    const { key } = await program.post(`${base}/entrants`, { name, model: "m", code: items[place].code }, { token: "" });
    keys.push(key);
  }
  await program.post(`${base}/attempts`, {}, { token: keys[0] });
  return { id, base, blue: keys[0] };
}

visit(
  "a competition is extended, and its codes, keys and entrants are mended",
  async ({ page, watch }, { program }) => {
    watch.expect(/422|409/);
    const { id, base, blue } = await manyEntrants(program);
    const before = await program.get(base);
    await open(page, `/desk?view=competition&id=${id}`);

    await page.getByText("later ends, other texts").click();
    const closes = page.getByLabel("Closes (required)");
    const known = await closes.inputValue();
    await closes.fill(localTime(3_600_000));
    await page.getByRole("button", { name: "Change the competition" }).click();
    await page.locator(".field", { has: closes }).getByText("never shortened").waitFor();
    assert.equal(await closes.getAttribute("aria-invalid"), "true");
    await closes.fill(known);
    await page.getByRole("button", { name: "Change the competition" }).click();
    await page.getByText("Nothing differs from how it is.").waitFor();
    await closes.fill(localTime(48 * 3_600_000));
    await page.getByLabel("Name (required)").fill("Summer cup, extended");
    await page.getByLabel("Reason", { exact: true }).fill("a power cut");
    await page.getByRole("button", { name: "Change the competition" }).click();
    await page.getByText("It was changed, and everybody sees what.").waitFor();
    const changed = await program.get(base);
    assert.deepEqual([changed.name, changed.description], ["Summer cup, extended", before.description]);
    assert.ok(changed.closes_at > before.closes_at);

    // Another organizer writes another description while this one types a name.
    await program.call("PATCH", base, { body: { description: "The hall is on the left." } });
    await page.getByLabel("Name (required)").fill("Summer cup, once more");
    await page.getByRole("button", { name: "Change the competition" }).click();
    await page.getByText("another organizer has changed it meanwhile (What entrants should know)").waitFor();
    assert.equal((await program.get(base)).name, "Summer cup, extended");
    await page.getByRole("button", { name: "Change the competition" }).click();
    await page.getByText("It was changed, and everybody sees what.").waitFor();
    const both = await program.get(base);
    assert.deepEqual([both.name, both.description], ["Summer cup, once more", "The hall is on the left."]);

    await page.getByText("Announce something").click();
    await page.getByLabel("Announcement (required)").fill("The hall opens an hour later.");
    await page.getByRole("button", { name: "Announce", exact: true }).click();
    await page.getByText("It was announced.").waitFor();

    await page.getByRole("row", { name: /^bot 1 used bot-1/ }).waitFor();
    await choose(page, "codes of late", "Revoke");
    await confirm(page, "Revoke");
    await page.getByRole("row", { name: /^late revoked/ }).waitFor();

    await choose(page, "blue", "Replace the key");
    await confirm(page, "Replace the key");
    const shown = await page.getByRole("group", { name: "The new key of blue" }).innerText();
    const key = String(/secret_\w+/.exec(shown));
    await assert.rejects(program.get(`${base}/attempts`, { token: blue }), /401/);
    assert.equal((await program.get(`${base}/attempts`, { token: key })).items.length, 1);

    await page.getByText("Disqualify by name, address or time of entry").click();
    await page.getByLabel("Name", { exact: true }).fill("BOT-*");
    await page.getByRole("button", { name: "Show who they are" }).click();
    const fit = page.getByRole("region", { name: "Table of entrants that fit" });
    await fit.getByRole("rowheader", { name: "bot-2" }).waitFor();
    assert.equal(await fit.getByRole("rowheader").count(), 2);
    await page.getByRole("button", { name: "Exclude 2 entrants" }).click();
    await confirm(page, "Exclude 2 entrants", "one team");
    await page.getByText("2 entrants excluded").waitFor();
    await choose(page, "bot-2", "Readmit");
    await confirm(page, "Readmit");
    await page.getByRole("row", { name: /bot-2/ }).getByRole("cell", { name: "active", exact: true }).waitFor();
    const { items } = await program.get(`${base}/entrants`);
    assert.deepEqual(items.map((one) => one.status), ["active", "disqualified", "active"]);

    // The first void leads to spare seeds. Then none are left, and the page says which seeds the entrant has seen.
    await choose(page, "attempt 1 of blue", "Void");
    await confirm(page, "Void", "the disk was full");
    await page.getByText("the disk was full").first().waitFor();
    assert.equal(await page.getByText("has seen seeds").count(), 0);
    await program.post(`${base}/attempts`, { attempt: 1 }, { token: key });
    await page.getByText("on spare seeds").first().waitFor();
    await choose(page.getByRole("row", { name: /on spare seeds/ }), "attempt 1 of blue", "Void");
    await confirm(page, "Void", "again");
    await page.getByText("Warning: blue has seen seeds of attempt 1.").waitFor();

    const done = page.getByRole("region", { name: "Table of what organizers did" });
    for (const action of ["Voided an attempt", "Excluded entrants", "Replaced the key of an entrant", "Revoked invitation codes", "Changed it"]) {
      await done.getByRole("rowheader", { name: action }).first().waitFor();
    }

    await page.getByRole("button", { name: "Cancel the competition" }).press("Enter");
    await page.getByRole("dialog").getByText("This cannot be undone").waitFor();
    await confirm(page, "Cancel the competition", "the hall is closed");
    await page.getByText("The reason: the hall is closed").waitFor();
    await page.getByRole("button", { name: "Hide from lists" }).click();
    await confirm(page, "Hide from lists");
    await page.getByRole("button", { name: "Show in lists" }).click();
    await confirm(page, "Show in lists");
    await page.getByRole("button", { name: "Hide from lists" }).waitFor();

    const reader = await visitor(site.browser, site.program, { viewport: NARROW });
    await open(reader.page, `/competitions/${id}`);
    await reader.page.getByText("The reason: the hall is closed").waitFor();
    await reader.page.getByRole("listitem").filter({ hasText: "Would have closed" }).getByText("extended").waitFor();
    const rows = reader.page.getByRole("region", { name: "Table of what organizers did" }).getByRole("rowheader");
    assert.deepEqual((await rows.allInnerTexts()).slice(0, 3), ["Changed it", "Changed it", "Cancelled it"]);
    await reader.page.getByRole("region", { name: "Announcements" }).getByText("The hall opens an hour later.").waitFor();
    await reader.page.getByText("again on other sealed seeds, 1 of them at most").waitFor();
    await open(reader.page, "/competitions");
    await reader.page.getByRole("heading", { name: "Cancelled" }).waitFor();
    await reader.done();
  },
  AS,
);

visit(
  "an entrant renames, withdraws and erases itself, on a telephone",
  async ({ page, watch }, { program }) => {
    watch.expect(/401/);
    const { id } = await competition(program, { name: "Autumn cup", attempts: 3, attempts_per_day: 2 });
    const base = `/api/v1/competitions/${id}`;
    await open(page, `/competitions/${id}`);
    await page.getByText("An entrant may start 2 on one day").waitFor();
    await page.locator("summary", { hasText: /^Enter$/ }).click();
    await page.getByText("What is erased, and what stays").click();
    await page.getByText("It cannot return to this competition").waitFor();
    await page.getByLabel("Name on the board").fill("Ada");
    await page.getByLabel("Model (required)").fill("m");
    await page.getByRole("button", { name: "Enter the competition" }).click();
    await page.getByRole("button", { name: "Use it in this tab" }).click();

    await page.getByText("Change or leave").click();
    const own = page.locator("details", { has: page.getByText("Change or leave: name, contact, team", { exact: true }) });
    const name = own.getByLabel("Name on the board");
    await name.fill("Ada L.");
    await name.press("Enter");
    await own.getByText("The name was changed.").waitFor();
    await page.getByRole("region", { name: "Table of entrants" }).getByRole("rowheader", { name: "Ada L." }).waitFor();
    await own.getByRole("button", { name: "Withdraw Ada L." }).click();
    await confirm(page, "Withdraw", "no time");
    await page.getByRole("region", { name: "Your entrant" }).getByText("withdrawn", { exact: true }).waitFor();
    await own.getByRole("button", { name: "Erase Ada L." }).press("Enter");
    await page.getByRole("dialog").getByText("the journals of its games").waitFor();
    await confirm(page, "Erase");
    await page.getByText("Ada L. was erased.").waitFor();
    assert.equal(await page.getByRole("group", { name: "The key of this entrant" }).count(), 0, "nobody is offered a key that is refused");
    await page.getByRole("button", { name: "Key", exact: true }).waitFor();
    await page.getByRole("region", { name: "Table of entrants" }).getByRole("rowheader", { name: /^erased ent_/ }).waitFor();
    const { items } = await program.get(`${base}/entrants`);
    assert.match(items[0].name, /^erased/);
  },
  { viewport: NARROW },
);

visit("the file of a competition is checked in the browser", async ({ page }, { data }) => {
  await open(page, `/competitions/${data.closed}#verify`);
  await page.getByRole("button", { name: "Verify" }).click();
  await page.getByRole("heading", { name: "The file passes" }).waitFor();
  await page.getByText("8 games were played on the sealed seeds").waitFor();
});

visit("a file that was changed does not pass", async ({ page }, { data }) => {
  await page.route("**/api/v1/exports/competitions/*", async (route) => {
    const body = (await (await route.fetch()).text()).replace('"grey"', '"gray"');
    await route.fulfill({ body });
  });
  await open(page, `/competitions/${data.closed}#verify`);
  await page.getByRole("button", { name: "Verify" }).click();
  await page.getByRole("heading", { name: "The file does not pass" }).waitFor();
  await page.getByText(/line \d+: a line was changed/).waitFor();
});

/**
 * The file with other records, and hashes that fit; journals stay as they are.
 * @param {string} file @param {(record: any) => any} change returns "none" for a record that is left out
 */
function forged(file, change) {
  let head = Buffer.alloc(32);
  let journal = 0;
  const lines = file.trimEnd().split("\n").map((line) => {
    if (journal > 0) return (journal -= 1), line;
    const { record } = JSON.parse(line);
    journal = record.lines ?? 0;
    if (change(record) === "none") return "";
    const text = JSON.stringify(record);
    head = createHash("sha256").update(head).update(text).digest();
    return `{"hash":"${head.toString("hex")}","record":${text}}`;
  });
  return lines.filter(Boolean).map((line) => `${line}\n`).join("");
}

/** Forgeries, and the page's messages about them. @type {[string, (record: any) => any][]} */
const FORGERIES = [
  ["format 1 has no spares", (record) => record.kind === "competition" && Object.assign(record, { format: 1 })],
  ["no action says so", (record) => record.action === "attempt.void" && "none"],
  ["an action after the end", (record) => record.action === "competition.change" && Object.assign(record, { at: "9000-01-01T00:00:00Z" })],
  ["is running after the end", (record) => record.kind === "attempt" && !record.voided && Object.assign(record, { status: "running" })],
  ["counts another attempt", ({ rows }) => rows && Object.assign(rows[0], { run: null, total: 1e6, rank: 1 })],
  ["a rank is another one", ({ rows }) => rows?.forEach((/** @type {any} */ row) => Object.assign(row, { rank: null }))],
  ["counts another attempt", ({ rows }) => rows && ([rows[0].run, rows[1].run] = [rows[1].run, rows[0].run])],
];

visit("a file that was forged does not pass, though its hashes fit", async ({ page }, { data }) => {
  let change = (/** @type {any} */ record) => record;
  await page.route("**/api/v1/exports/competitions/*", async (route) => {
    await route.fulfill({ body: forged(await (await route.fetch()).text(), change) });
  });
  await open(page, `/competitions/${data.closed}#verify`);
  await page.getByRole("button", { name: "Verify" }).click();
  await page.getByRole("heading", { name: "The file passes" }).waitFor();
  for (const [says, forge] of FORGERIES) {
    change = forge;
    await page.getByRole("button", { name: "Verify" }).click();
    await page.getByRole("alert").getByText(says).waitFor();
  }
});

visit(
  "keys are created and revoked",
  async ({ page }) => {
    await open(page, "/desk?view=keys");
    await page.getByText("New key").click();
    await page.getByLabel("Whose it is").fill("team x");
    await page.getByRole("button", { name: "Create a key" }).click();
    const shown = await page.getByRole("group", { name: "Key of team x (member)" }).innerText();
    const token = String(/secret_\w+/.exec(shown));

    const member = await visitor(site.browser, site.program, { key: token });
    member.watch.expect(/403/);
    await open(member.page, "/desk?view=keys");
    await member.page.getByRole("heading", { name: "This view needs an organizer's key" }).waitFor();

    await choose(page, "the key of team x", "Revoke");
    await confirm(page, "Revoke");
    await page.getByRole("row", { name: /^team x/ }).waitFor({ state: "hidden" });
    member.watch.expect(/401/);
    await open(member.page, "/desk");
    await member.page.getByRole("heading", { name: "The key or token is not accepted" }).waitFor();
    await member.done();
  },
  AS,
);

visit(
  "games are exported as a file, filtered by names with spaces",
  async ({ page }) => {
    await open(page, "/desk?view=exports");
    await page.getByLabel("File").selectOption("acts.parquet");
    await page.getByLabel("Task").selectOption("Foraging");
    await page.getByLabel("Model").pressSequentially("my model ");
    assert.equal(await page.getByLabel("Model").inputValue(), "my model ");
    const link = page.getByRole("link", { name: "Download" });
    assert.equal(await link.getAttribute("href"), "/api/v1/exports/acts.parquet?task=Foraging&model=my+model");
  },
  AS,
);

visit(
  "a server alone is the only one of its database; several are named with what is wrong with them",
  async ({ page }) => {
    await open(page, "/desk?view=nodes");
    await page.getByText("This server has its database to itself.").waitFor();
    const table = page.getByRole("region", { name: "Table of servers" });
    assert.equal(await table.getByRole("rowheader").count(), 1);
    await table.getByRole("cell", { name: "ready", exact: true }).waitFor();

    const { items } = await site.program.get("/api/v1/nodes");
    const other = { ...items[0], id: 8, name: "b, process 2", is_this: false, connected: false };
    const body = { cluster: true, items: [items[0], { ...other, seen_ms_ago: 7000, clock_offset_ms: 900 }] };
    await page.route("**/api/v1/nodes", (route) => route.fulfill({ json: body }));
    await table.getByRole("cell", { name: "not connected to the database" }).waitFor();
    const faults = page.getByRole("listitem");
    await faults.filter({ hasText: "b, process 2 was not seen for 7 s" }).waitFor();
    await faults.filter({ hasText: "The clock of b, process 2 is 900 ms off" }).waitFor();
  },
  AS,
);

visit(
  "the health of the server is shown, and that it is gone",
  async ({ page, watch }) => {
    watch.expect(/ERR_CONNECTION_REFUSED/);
    await open(page, "/desk");
    await page.getByRole("status").filter({ hasText: /^Ready/ }).waitFor();
    await site.program.restart(async () => {
      await page.getByText("The server does not answer.").waitFor();
    });
    await page.getByRole("status").filter({ hasText: /^Ready/ }).waitFor();
  },
  AS,
);
