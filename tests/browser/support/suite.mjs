// The shared part of one file's tests: a server with games, and a browser.
import { mkdir } from "node:fs/promises";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { after, before, test } from "node:test";
import { launch, visitor } from "./browser.mjs";
import { Program } from "./program.mjs";

const FAILURES = path.join(path.dirname(fileURLToPath(import.meta.url)), "../out/failures");

/** The timeout of a test. */
export const TEST_MS = 120_000;

/**
 * A server with games and a browser, from before the first test until after the last.
 * @template D
 * @template {{close: () => Promise<void>}} B
 * @param {{keys?: boolean, args?: string[]}} options
 * @param {(program: Program) => Promise<D>} fill makes the games
 * @param {() => Promise<B>} launch starts the browser
 */
export function siteOf(options, fill, launch) {
  /** @type {{program: Program, browser: B, data: D}} */
  const site = /** @type {any} */ ({});
  before(
    async () => {
      site.program = await Program.start(options);
      [site.browser, site.data] = await Promise.all([launch(), fill(site.program)]);
    },
    { timeout: TEST_MS },
  );
  after(async () => {
    await site.browser?.close();
    await site.program?.stop();
  });
  return site;
}

/**
 * @template D
 * @param {{keys?: boolean, args?: string[]}} options
 * @param {(program: Program) => Promise<D>} fill makes the games, before the first test
 */
export function suite(options, fill) {
  const site = siteOf(options, fill, launch);

  /**
   * A test with a visitor of its own, whose pages must have no fault.
   * @param {string} name
   * @param {(visitor: Awaited<ReturnType<typeof visitor>>, site: {program: Program, data: D}) => Promise<void>} run
   * @param {Parameters<typeof visitor>[2] & {asOrganizer?: boolean}} [who]
   */
  const visit = (name, run, { asOrganizer, ...who } = {}) =>
    test(name, { timeout: TEST_MS }, async () => {
      const key = asOrganizer ? site.program.organizer : undefined;
      const one = await visitor(site.browser, site.program, { key, ...who });
      try {
        await run(one, site);
      } catch (error) {
        await picture(one.page, name);
        throw Object.assign(error, { message: `${error.message}\n${one.watch.faults.slice(0, 5).join("\n")}` });
      }
      await one.done();
    });
  return { site, visit };
}

/** Saves the content of a page whose test failed. @param {import("playwright-core").Page} page @param {string} name */
async function picture(page, name) {
  await mkdir(FAILURES, { recursive: true });
  const file = path.join(FAILURES, `${name.replaceAll(/\W+/g, "-")}.png`);
  await page.screenshot({ path: file }).catch(() => {});
}
