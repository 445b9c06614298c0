// Takes a picture of every page, wide and narrow, light and dark, of a server with the same games each time.
//   npm run screenshots -- [FOLDER]            all pages into out/screenshots, or FOLDER
//   npm run screenshots -- --docs              the pictures of the documents, into docs/pages
//   npm run screenshots -- --hostile [FOLDER]  all pages with hostile texts
import { mkdir } from "node:fs/promises";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { NARROW, WIDE, launch, open, visitor } from "./support/browser.mjs";
import { HOSTILE } from "./support/hostile.mjs";
import { Program } from "./support/program.mjs";
import { PLACES, PLAIN, full, unfold } from "./support/site.mjs";

const HERE = path.dirname(fileURLToPath(import.meta.url));
const SIZES = { wide: WIDE, narrow: NARROW };
const SCHEMES = /** @type {const} */ (["light", "dark"]);

/** Pictures of the documents: page, size and scheme. */
const SHOWN = new Set([
  ...["front", "boards", "board", "costs", "player", "runs", "run", "team", "games", "game", "imports", "import", "compare"].map((name) => `${name}-wide-light`),
  ...["play", "seat", "competitions", "competition", "revealed", "desk"].map((name) => `${name}-wide-light`),
  ...["game-wide-dark", "game-narrow-light", "board-narrow-dark"],
]);

/** The maximum time in which a page draws after its text. */
const QUIET_MS = 2_000;

const given = process.argv.slice(2);
const forDocs = given.includes("--docs");
const folder = forDocs ? path.join(HERE, "../../docs/pages") : (given.find((one) => !one.startsWith("--")) ?? path.join(HERE, "out/screenshots"));
await mkdir(folder, { recursive: true });

const program = await Program.start({ keys: true });
const browser = await launch();
try {
  const data = await full(program, given.includes("--hostile") ? HOSTILE : PLAIN);
  for (const place of PLACES) await pictures(place, data);
} finally {
  await browser.close();
  await program.stop();
}

/** @param {typeof PLACES[number]} place @param {Awaited<ReturnType<typeof full>>} data */
async function pictures({ name, address, needsKey, unfolds }, data) {
  const { page, context } = await visitor(browser, program, { key: needsKey ? program.organizer : undefined });
  await open(page, address(data));
  await unfold(page, unfolds);
  if (name === "seat") await page.getByRole("button", { name: /^Take/ }).first().click({ timeout: QUIET_MS }).catch(() => {});
  await page.waitForLoadState("networkidle", { timeout: QUIET_MS }).catch(() => {});
  await page.getByText("Working out what could still be scored").waitFor({ state: "hidden" });
  for (const [size, viewport] of Object.entries(SIZES)) {
    for (const colorScheme of SCHEMES) {
      const picture = `${name}-${size}-${colorScheme}`;
      if (forDocs && !SHOWN.has(picture)) continue;
      await page.setViewportSize(viewport);
      await page.emulateMedia({ colorScheme });
      await page.screenshot({ path: path.join(folder, `${picture}.png`), fullPage: !forDocs });
    }
  }
  await context.close();
}
