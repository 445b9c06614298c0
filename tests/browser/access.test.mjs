// Every page for everybody: axe-core finds nothing, in both colour schemes, wide and narrow, and a narrow page is never
// scrolled sideways.
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { NARROW, WIDE, open } from "./support/browser.mjs";
import { spoken } from "./support/games.mjs";
import { PLACES, expectedAt, full, unfold } from "./support/site.mjs";
import { suite } from "./support/suite.mjs";

const AXE = await readFile(new URL("../node_modules/axe-core/axe.min.js", import.meta.url), "utf8");

/** The tolerance of a page's width, for rounding. */
const SLACK_PX = 1;

const { visit } = suite({ keys: true }, async (program) => ({
  ...(await full(program)),
  lossy: (await spoken(program, { task: "Synchronization", seed: 27, num_agents: 4, max_round: 16 })).id,
}));

/** @param {import("playwright-core").Page} page */
async function violations(page) {
  const found = await page.evaluate(async () => {
    // @ts-expect-error axe is added below
    const { violations } = await globalThis.axe.run(document, { resultTypes: ["violations"] });
    return violations.map(({ id, help, nodes }) => `${id}: ${help}\n    ${nodes.map(({ html }) => html).join("\n    ")}`);
  });
  return found.join("\n");
}

/** The elements that make a page wider than the window. @param {import("playwright-core").Page} page @param {number} slack */
const tooWide = (page, slack) =>
  page.evaluate((slack) => {
    const { scrollWidth, clientWidth } = document.documentElement;
    if (scrollWidth <= clientWidth + slack) return "";
    const wide = [...document.body.querySelectorAll("*")].filter((one) => one.getBoundingClientRect().right > clientWidth + slack);
    const names = wide.map((one) => `${one.tagName} ${one.className} ${one.textContent?.slice(0, 40)}`);
    return `${scrollWidth} px of ${clientWidth}: ${names.slice(0, 5).join(" | ")}`;
  }, slack);

/** @param {import("playwright-core").Page} page @param {string} name */
async function everybodyReads(page, name) {
  await page.evaluate(AXE);
  for (const [size, viewport] of Object.entries({ WIDE, NARROW })) {
    await page.setViewportSize(viewport);
    for (const colorScheme of /** @type {const} */ (["light", "dark"])) {
      await page.emulateMedia({ colorScheme });
      assert.equal(await violations(page), "", `${name}, ${size}, ${colorScheme}`);
    }
  }
  assert.equal(await tooWide(page, SLACK_PX), "", name);
}

visit(
  "what decisions lost, and how the reference would play on: everybody can read it",
  async ({ page }, { data }) => {
    await open(page, `/episodes/${data.lossy}#r=3`);
    await page.getByText("What decisions lost").click();
    await page.locator(".losses").getByRole("listitem").first().waitFor();
    await page.getByRole("button", { name: "Play on from here as the reference would" }).click();
    await page.getByText("The outlines are its next").waitFor();
    await everybodyReads(page, "losses");
  },
  { bypassCSP: true },
);

for (const { name, address, needsKey, unfolds } of PLACES) {
  visit(
    `${name}: everybody can read it`,
    async ({ page, watch }, { data }) => {
      watch.expect(...expectedAt(name));
      await open(page, address(data));
      await unfold(page, unfolds);
      await everybodyReads(page, name);
    },
    // axe-core measures with styles of its own, which the policy of the pages refuses.
    { asOrganizer: needsKey, bypassCSP: true },
  );
}
