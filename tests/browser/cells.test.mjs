// Lights and loads are drawn alike on the map, in windows and in seats, under both rule sets.
import assert from "node:assert/strict";
import { open } from "./support/browser.mjs";
import { dice } from "./support/dice.mjs";
import { hosted, spoken } from "./support/games.mjs";
import { suite } from "./support/suite.mjs";

const RULES = /** @type {const} */ (["paper", "reference"]);
const TASKS = /** @type {const} */ (["Synchronization", "Foraging"]);
const SMALL = { seed: 27, num_agents: 9, width: 8, height: 8, max_round: 30 };

const { visit } = suite({}, async (program) => {
  const draw = dice(5);
  const decide = ({ actions }) => ({ action: actions[draw(actions.length)] });
  /** @type {Record<string, string>} */
  const games = {};
  for (const rules of RULES) {
    games[`Synchronization ${rules}`] = (await spoken(program, { task: "Synchronization", rules, ...SMALL }, { decide })).id;
    games[`Foraging ${rules}`] = await hosted(program, { task: "Foraging", rules, ...SMALL });
  }
  return games;
});

/**
 * A round in which some agents have a light or a load, and some not.
 * @param {any} replay
 * @param {"lit" | "loaded"} list
 */
const mixedRound = ({ states, num_agents: count }, list) =>
  states.find((/** @type {any} */ state) => state.round > 0 && state[list]?.length > 0 && state[list].length < count);

/** What the pictures of windows say of agents: "agent 3 (light on)". @param {import("playwright-core").Locator} windows */
async function said(windows) {
  const labels = await windows.evaluateAll((all) => all.map((one) => one.getAttribute("aria-label") ?? ""));
  return labels.flatMap((label) => [...label.matchAll(/agent (\d+)(?: \(([^)]*)\))? in row/g)].map(([, agent, sign]) => ({ agent: Number(agent), sign: sign ?? "" })));
}

for (const rules of RULES) {
  for (const task of TASKS) {
    const list = task === "Synchronization" ? "lit" : "loaded";
    const [without, withIt] = task === "Synchronization" ? ["light off", "light on"] : ["", "carries food"];

    visit(`${task}, ${rules}: map, windows and table agree`, async ({ page }, { data, program }) => {
      const id = data[`${task} ${rules}`];
      const state = mixedRound(await program.get(`/api/v1/episodes/${id}/replay`), list);
      await open(page, `/episodes/${id}#r=${state.round}`);
      await page.getByRole("img", { name: new RegExp(`^Map\\. Round ${state.round}\\.`) }).waitFor();
      await page.getByRole("main").getByRole("button", { name: "All windows" }).click();
      await page.getByRole("img", { name: /^Around agent 8/ }).waitFor();
      const map = page.locator("svg.map");
      assert.equal(await map.locator(".halo").count(), state[list].length);
      assert.equal(await map.locator(".hollow.body").count(), task === "Synchronization" ? SMALL.num_agents - state[list].length : 0);
      const around = await said(page.getByRole("img", { name: /^Around agent/ }));
      assert.ok(around.length > 0);
      for (const { agent, sign } of around) assert.equal(sign, state[list].includes(agent) ? withIt : without, `agent ${agent}`);
      // What agents were sent has marks in the place of signs.
      for (const agent of [0, 4, 8]) {
        await page.keyboard.press(String(agent));
        await page.getByText("as it was seen").waitFor();
        const window = page.getByRole("img", { name: `Window of agent ${agent}` });
        for (const { agent: other, sign } of await said(window)) assert.equal(sign, state[list].includes(other) ? withIt : without, `agent ${other} as ${agent} saw it`);
        const ring = window.locator(".halo, .hollow.body");
        const drawn = await window.locator("g:has(> .chosen)").locator(".halo").count();
        assert.equal(drawn, Number(state[list].includes(agent)), `the own light of ${agent}, of ${await ring.count()}`);
      }
    });

    visit(`${task}, ${rules}: a seat draws what its agent sees`, async ({ page }, { program }) => {
      const settings = { task, rules, ...SMALL, visibility: "public" };
      const { id, swarm_token: swarm, seats } = await program.post("/api/v1/episodes", settings);
      await page.goto("/");
      await page.evaluate(([name, value]) => sessionStorage.setItem(name, value), [`swarmbench:token:${id}`, seats[0].token]);
      await open(page, `/play/${id}`);
      const window = page.getByRole("img", { name: /^What your agent sees/ });
      await window.waitFor();
      const { states } = await program.get(`/api/v1/episodes/${id}/replay`, { token: swarm });
      const seen = await said(window);
      assert.ok(seen.length > 0);
      for (const { agent, sign } of seen) assert.equal(sign, states[0][list]?.includes(agent) ? withIt : without, `agent ${agent}`);
    });
  }
}

visit("a map with all lights off is drawn so", async ({ page }, { program }) => {
  const id = await hosted(program, { task: "Synchronization", rules: "reference", ...SMALL });
  const { states } = await program.get(`/api/v1/episodes/${id}/replay`);
  const dark = states.find((/** @type {any} */ state) => !state.lit);
  assert.ok(dark);
  await open(page, `/episodes/${id}#r=${dark.round}`);
  await page.getByRole("img", { name: new RegExp(`^Map\\. Round ${dark.round}\\.`) }).waitFor();
  assert.equal(await page.locator("svg.map .hollow.body").count(), SMALL.num_agents);
});
