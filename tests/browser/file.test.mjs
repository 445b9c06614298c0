// A game as one file: it opens without a server or a network, and strangers' texts in it are never markup.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { statSync } from "node:fs";
import path from "node:path";
import { pathToFileURL } from "node:url";
import { spoken, talkative } from "./support/games.mjs";
import { HOSTILE, MARK } from "./support/hostile.mjs";
import { BINARY } from "./support/program.mjs";
import { suite } from "./support/suite.mjs";

const ROUNDS = 12;

const { visit } = suite({}, async (program) => {
  const draw = talkative(27);
  let count = 0;
  const decide = (/** @type {any} */ observation) => {
    const { response, ...rest } = draw(observation);
    const action = /ACTION: \w+/.exec(response)?.[0] ?? "ACTION: STAY";
    return { ...rest, response: `${HOSTILE.response}\n${action}\nMSG: ${HOSTILE.message((count += 1))}`, reasoning: HOSTILE.reasoning };
  };
  const settings = { task: "Foraging", seed: 27, num_agents: 4, max_round: ROUNDS, model: HOSTILE.name("gpt-x") };
  const { id } = await spoken(program, settings, { decide });
  const whole = path.join(program.folder, "game.html");
  const part = path.join(program.folder, "part.html");
  write(program, id, whole, "--prompts");
  write(program, id, part, "--rounds", "3..6");
  return { whole, part };
});

/** @param {{url: string}} program @param {string} id @param {string} file @param {...string} more */
function write(program, id, file, ...more) {
  const done = spawnSync(BINARY, ["replay", id, "--html", file, "--server", program.url, ...more]);
  assert.equal(done.status, 0, String(done.stderr));
}

visit("the file shows the game offline, and hostile text in it is text", async ({ page, context, watch }, { data }) => {
  watch.allow("null");
  await context.setOffline(true);
  await page.goto(`${pathToFileURL(data.whole)}#r=5&a=2`);
  await page.getByRole("heading", { level: 1 }).getByText(MARK).waitFor();
  await page.getByText(/Round 5/).first().waitFor();
  for (const panel of ["Inbox", "Prompt", "Answer", "Reasoning"]) {
    await page.getByRole("tab", { name: panel }).or(page.getByRole("button", { name: panel })).first().click();
    await page.getByText("Loading …").first().waitFor({ state: "hidden" });
  }
  assert.match(await page.getByRole("main").innerText(), /<script>/, "shown as it was written");
  const elements = await page.evaluate(() => document.querySelectorAll("iframe, object, embed, [onerror], [onload], a[href^='javascript']").length);
  assert.equal(elements, 0);
  await page.keyboard.press("End");
  await page.getByText(new RegExp(`Round ${ROUNDS}`)).first().waitFor();
});

visit("a part of a game is a smaller file", async ({ page, context, watch }, { data }) => {
  watch.allow("null");
  assert.ok(statSync(data.part).size < statSync(data.whole).size);
  await context.setOffline(true);
  await page.goto(String(pathToFileURL(data.part)));
  await page.getByText(/Round 3/).first().waitFor();
  await page.keyboard.press("End");
  await page.getByText(/Round 6/).first().waitFor();
});
