// Competitions from their creation to the check of their results, and the rest of the desk, without a command line.
import assert from "node:assert/strict";
import { NARROW, open, visitor } from "./support/browser.mjs";
import { play } from "./support/games.mjs";
import { suite } from "./support/suite.mjs";

const AS = { asOrganizer: true };

const SMALL = { tasks: ["Pursuit", "Foraging"], seeds: 1, settings: { num_agents: 4, max_round: 5 } };

/** How long the revealed competition is open: its games are played by then. */
const SHORT_MS = 5000;

/** A competition that is over. @param {import("./support/program.mjs").Program} program */
async function revealed(program) {
  const now = Date.now();
  const made = await program.post("/api/v1/competitions", {
    name: "Winter cup",
    opens_at: new Date(now - 1000).toISOString(),
    closes_at: new Date(now + SHORT_MS).toISOString(),
    suite: SMALL,
    clocks: { round_deadline_s: 1 },
  });
  const base = `/api/v1/competitions/${made.id}`;
  const entrant = await program.post(`${base}/entrants`, { name: "grey", model: "m" }, { token: "" });
  const attempt = await program.post(`${base}/attempts`, {}, { token: entrant.key });
  await play(program, attempt.swarm_token, () => ({ action: "STAY" }));
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

/** Creates a competition at the desk; returns its id and a code. @param {import("playwright-core").Page} page */
async function create(page) {
  await open(page, "/desk?view=create");
  await page.getByLabel("Name (required)").fill("Spring cup");
  await page.getByLabel("Opens (required)").fill(localTime(-60_000));
  await page.getByLabel("Closes (required)").fill(localTime(-3_600_000));
  await page.getByLabel("Clock of a round").fill("60");
  await page.getByLabel("Entry").selectOption("codes");
  await page.getByRole("button", { name: "Create the competition" }).click();
  await page.getByText("must be after opens_at").first().waitFor();
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
  await page.getByLabel("Name on the board").fill("blue");
  await page.getByLabel("Model (required)").fill("model-b");
  await page.getByLabel("Invitation code").fill(code);
  await page.getByRole("button", { name: "Enter the competition" }).click();
  await page.getByRole("button", { name: "Use it in this tab" }).click();
  await page.getByRole("button", { name: "Start the next attempt" }).click();
  await confirm(page, "Start the next attempt");
  const shown = await page.getByRole("group", { name: "The token of this attempt" }).innerText();
  await page.getByRole("row", { name: /^1 blue running/ }).waitFor();
  return String(/swarm_\w+/.exec(shown));
}

visit(
  "a competition is created, entered and managed without a command line",
  async ({ page, watch }) => {
    watch.expect(/422/);
    const { id, code } = await create(page);
    const entrant = await visitor(site.browser, site.program, { viewport: NARROW });
    const token = await enter(entrant.page, id, code);
    assert.equal((await site.program.get("/swarm/obs", { token })).finished, false);
    await entrant.done();

    await open(page, `/desk?view=competition&id=${id}`);
    await page.getByRole("button", { name: "Disqualify blue" }).press("Enter");
    await page.getByRole("dialog").getByLabel("Reason").waitFor();
    await page.keyboard.type("two <b>entrants</b> of one team");
    await page.keyboard.press("Enter");
    await page.getByText("two <b>entrants</b> of one team").waitFor();
    const region = await page.evaluate(() => document.activeElement?.getAttribute("aria-label"));
    assert.equal(region, "Table of entrants", "the keyboard stays near what has changed");
    await page.getByRole("button", { name: "Readmit blue" }).click();
    await confirm(page, "Readmit");
    await page.getByRole("button", { name: "Void attempt 1" }).click();
    await confirm(page, "Void", "the disk was full");
    await page.getByText("the disk was full").waitFor();

    await open(page, "/desk?view=audit");
    for (const action of ["attempt.void", "entrant.change", "competition.create"]) {
      await page.getByRole("rowheader", { name: action }).first().waitFor();
    }
  },
  AS,
);

visit("the file of a competition is checked in the browser", async ({ page }, { data }) => {
  await open(page, `/competitions/${data.closed}`);
  await page.getByRole("button", { name: "Verify" }).click();
  await page.getByRole("heading", { name: "The file passes" }).waitFor();
  await page.getByText("2 games were played on the sealed seeds").waitFor();
});

visit("a file that was changed does not pass", async ({ page }, { data }) => {
  await page.route("**/api/v1/exports/competitions/*", async (route) => {
    const body = (await (await route.fetch()).text()).replace('"grey"', '"gray"');
    await route.fulfill({ body });
  });
  await open(page, `/competitions/${data.closed}`);
  await page.getByRole("button", { name: "Verify" }).click();
  await page.getByRole("heading", { name: "The file does not pass" }).waitFor();
  await page.getByText("line 2: a line was changed").waitFor();
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

    await page.getByRole("button", { name: "Revoke the key of team x" }).click();
    await confirm(page, "Revoke");
    await page.getByRole("button", { name: "Revoke the key of team x" }).waitFor({ state: "hidden" });
    member.watch.expect(/401/);
    await open(member.page, "/desk");
    await member.page.getByRole("heading", { name: "The key or token is not accepted" }).waitFor();
    await member.done();
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
