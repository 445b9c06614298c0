// Unknown addresses and forbidden reads: each has a page that says what happened and what to do.
import assert from "node:assert/strict";
import { open } from "./support/browser.mjs";
import { hosted } from "./support/games.mjs";
import { suite } from "./support/suite.mjs";

const { visit } = suite({ keys: true, args: ["--private"] }, async (program) => ({
  game: await hosted(program, { task: "Pursuit", seed: 27, num_agents: 4, max_round: 5, model: "a secret model" }),
  member: await program.post("/api/v1/keys", { name: "member" }),
}));

/** @param {import("playwright-core").Page} page */
async function says(page, /** @type {RegExp} */ words) {
  const main = page.getByRole("main");
  await main.getByText(words).first().waitFor().catch((error) => {
    throw new Error(`${page.url()} does not say ${words}`, { cause: error });
  });
  const choices = (await main.getByRole("link").count()) + (await main.getByRole("button").count());
  assert.ok(choices > 0, "something can be done");
}

const NOWHERE = ["/nowhere", "/board", "/episodes/a/b/c", "/embed/episodes", "/%3Cb%3E"];

visit("addresses that lead nowhere", async ({ page, watch }) => {
  watch.expect(/404/);
  for (const address of NOWHERE) {
    const answer = await open(page, address);
    assert.equal(answer?.status(), 404, address);
    await says(page, /leads? nowhere|nothing at/i);
  }
});

const UNKNOWN = [
  "/episodes/ep_00000000000000000000000000000000",
  "/embed/episodes/ep_00000000000000000000000000000000",
  "/episodes/%3Cscript%3E",
  "/runs/run_00000000000000000000000000000000",
  "/imports/imp_00000000000000000000000000000000",
  "/competitions/cmp_00000000000000000000000000000000",
  "/play/ep_00000000000000000000000000000000",
  "/board/nothing",
  "/board/standard/nothing",
  "/compare?a=ep_0&b=ep_1",
];

for (const address of UNKNOWN) {
  visit(
    `what does not exist: ${address}`,
    async ({ page, watch }) => {
      watch.expect(/404/, /400/);
      await open(page, address);
      await says(page, /not found|no such|nothing|no row|no games|unknown|empty/i);
    },
    { asOrganizer: true },
  );
}

visit("a private server shows nothing without a key", async ({ page, watch }, { data }) => {
  watch.expect(/40[134]/);
  const addresses = ["/", "/boards", "/board/standard", "/runs", "/episodes", "/imports", "/competitions", "/desk"];
  for (const address of [...addresses, `/episodes/${data.game}`, `/embed/episodes/${data.game}`]) {
    await open(page, address);
    assert.doesNotMatch(await page.content(), /a secret model/, address);
    await says(page, /key/i);
  }
});

visit("without a key no game is started", async ({ page, watch }) => {
  watch.expect(/401/);
  await open(page, "/play");
  await page.getByRole("button", { name: "Play", exact: true }).click();
  await says(page, /key/i);
});

visit("a key shows it", async ({ page, watch }, { data }) => {
  watch.expect(/40[14]/);
  await open(page, `/episodes/${data.game}`);
  await page.getByRole("main").getByRole("button", { name: "Enter a key" }).click();
  await page.getByRole("dialog").getByLabel("Key").fill(data.member.secret);
  await page.keyboard.press("Enter");
  await page.getByText("a secret model").first().waitFor();
});

visit("a revoked key says so, and can be forgotten", async ({ page, watch }, { program, data }) => {
  watch.expect(/40[14]/);
  const made = await program.post("/api/v1/keys", { name: "for a moment" });
  await open(page, `/episodes/${data.game}`);
  await page.getByRole("main").getByRole("button", { name: "Enter a key" }).click();
  await page.getByRole("dialog").getByLabel("Key").fill(made.secret);
  await page.keyboard.press("Enter");
  await page.getByText("a secret model").first().waitFor();
  await program.call("DELETE", `/api/v1/keys/${made.id}`);
  await page.reload();
  await says(page, /revoked/i);
  await page.getByRole("button", { name: "Forget the key" }).first().click();
  await page.getByRole("banner").getByRole("button", { name: "Key", exact: true }).waitFor();
});
