// Debian's Chromium, and visitors who use it.
import { accessSync, constants } from "node:fs";
import process from "node:process";
import { chromium } from "playwright-core";
import { Watch } from "./watch.mjs";

export const CHROMIUM = process.env.CHROMIUM ?? "/usr/bin/chromium";

export const WIDE = { width: 1280, height: 800 };
export const NARROW = { width: 380, height: 800 };

const PATIENCE_MS = 15_000;

export async function launch() {
  try {
    accessSync(CHROMIUM, constants.X_OK);
  } catch {
    throw new Error(`no ${CHROMIUM}: install Chromium (Debian: apt-get install chromium), or set CHROMIUM to its path`);
  }
  // The sandbox of Chromium does not work for root.
  const args = process.getuid?.() === 0 ? ["--no-sandbox"] : [];
  return chromium.launch({ executablePath: CHROMIUM, args });
}

/**
 * A visitor of a server's pages. `done` fails if a page had a fault.
 * @param {import("playwright-core").Browser} browser
 * @param {{url: string}} program
 * @param {import("playwright-core").BrowserContextOptions & {key?: string}} [options]
 */
export async function visitor(browser, program, { key, ...options } = {}) {
  const context = await browser.newContext({
    baseURL: program.url,
    viewport: WIDE,
    colorScheme: "light",
    reducedMotion: "reduce",
    locale: "en-GB",
    timezoneId: "UTC",
    ...options,
  });
  context.setDefaultTimeout(PATIENCE_MS);
  const watch = await Watch.over(context, program.url);
  const page = await context.newPage();
  if (key) await watch.without(() => enterKey(page, key));
  const done = async () => {
    await watch.leavings(context);
    await context.close();
    watch.check();
  };
  return { page, context, watch, done };
}

/** Enters a key as people do. @param {import("playwright-core").Page} page @param {string} key */
export async function enterKey(page, key) {
  await page.goto("/");
  await page.getByRole("banner").getByRole("button", { name: "Key" }).click();
  await page.getByRole("banner").getByRole("button", { name: /^Enter (a|another) key$/ }).click();
  const dialog = page.getByRole("dialog");
  await dialog.getByLabel("Key").fill(key);
  await dialog.getByRole("button", { name: "Use this key" }).click();
  await page.getByRole("button", { name: "Key: entered" }).waitFor();
}

/** Opens an address and waits until its page has loaded what it shows. @param {import("playwright-core").Page} page @param {string} address */
export async function open(page, address) {
  const response = await page.goto(address);
  await settled(page);
  return response;
}

/** Waits until a page shows something and loads nothing more. @param {import("playwright-core").Page} page */
export async function settled(page) {
  await page.getByRole("main").waitFor();
  await page.getByRole("heading", { level: 1 }).first().waitFor();
  await page.getByText("Loading …").first().waitFor({ state: "hidden" });
}
