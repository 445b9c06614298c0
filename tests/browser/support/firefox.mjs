// Debian's Firefox, over WebDriver BiDi, and visitors who use it.
import { accessSync, constants } from "node:fs";
import process from "node:process";
import { test } from "node:test";
import puppeteer from "puppeteer-core";
import { TEST_MS, siteOf } from "./suite.mjs";

const FIREFOX = process.env.FIREFOX ?? "/usr/bin/firefox-esr";

const PATIENCE_MS = 15_000;

/** Tabs in the background draw no frames, by which puppeteer waits unless told. */
const WAIT = { polling: 200 };

/** @typedef {import("puppeteer-core").Page} Page */
/** @typedef {import("./program.mjs").Program} Program */

function launch() {
  try {
    accessSync(FIREFOX, constants.X_OK);
  } catch {
    throw new Error(`no ${FIREFOX}: install Firefox (Debian: apt-get install firefox-esr), or set FIREFOX to its path`);
  }
  return puppeteer.launch({ browser: "firefox", executablePath: FIREFOX, headless: true });
}

/**
 * The shared part of one file's tests: a server with games, and Firefox.
 * @template D
 * @param {{keys?: boolean, args?: string[]}} options
 * @param {(program: Program) => Promise<D>} fill makes the games, before the first test
 */
export function suite(options, fill) {
  const site = siteOf(options, fill, launch);

  /**
   * A test with a visitor of its own, whose pages must have no fault.
   * @param {string} name
   * @param {(visitor: Visitor, site: {program: Program, data: D}) => Promise<void>} run
   */
  const visit = (name, run) =>
    test(name, { timeout: TEST_MS }, async () => {
      const visitor = new Visitor(await site.browser.createBrowserContext(), site.program);
      try {
        await run(visitor, site);
      } catch (error) {
        throw Object.assign(error, { message: `${error.message}\n${visitor.faults.slice(0, 5).join("\n")}` });
      }
      await visitor.context.close();
      if (visitor.faults.length > 0) throw new Error(`faults of the page:\n${visitor.faults.slice(0, 20).join("\n")}`);
    });
  return { visit };
}

class Visitor {
  /** @type {string[]} */
  faults = [];
  /** @type {RegExp[]} */
  expected = [];

  /** @param {import("puppeteer-core").BrowserContext} context @param {Program} program */
  constructor(context, program) {
    this.context = context;
    this.url = program.url;
  }

  /** A tab that shows an address, with all that its page loads. @param {string} address @param {{width: number, height: number}} [viewport] */
  async tab(address, viewport = { width: 1280, height: 800 }) {
    const page = await this.context.newPage();
    page.setDefaultTimeout(PATIENCE_MS);
    await page.setViewport(viewport);
    page.on("console", (message) => message.type() === "error" && this.note(`console: ${message.text()}`));
    page.on("pageerror", (error) => this.note(`error: ${error}`));
    page.on("response", (response) => response.status() >= 400 && this.note(`answer: ${response.status()} ${response.url()}`));
    page.on("request", (request) => {
      if (!request.url().startsWith(this.url) && /^https?:/.test(request.url())) this.note(`request to elsewhere: ${request.url()}`);
    });
    await page.evaluateOnNewDocument(() => {
      addEventListener("securitypolicyviolation", (event) => console.error(`policy: ${event.violatedDirective} refused ${event.blockedURI}`));
    });
    await this.open(page, address);
    return page;
  }

  /** @param {Page} page @param {string} address */
  async open(page, address) {
    await page.goto(this.url + address);
    await page.waitForSelector("main h1");
    await page.waitForFunction(() => !document.body.innerText.includes("Loading …"), WAIT);
  }

  /** @param {string} fault */
  note(fault) {
    if (!this.expected.some((pattern) => pattern.test(fault))) this.faults.push(fault);
  }
}

/** Waits for a text on a page. @param {Page} page @param {string} text */
export const said = (page, text) => page.waitForFunction((text) => document.body.innerText.includes(text), WAIT, text);

/** Presses a button by its name. @param {Page} page @param {string} name */
export async function press(page, name) {
  const found = await page.waitForFunction(
    (name) =>
      [...document.querySelectorAll("main button, dialog button, header button")].find(
        (button) => (button.getAttribute("aria-label") ?? button.textContent?.trim()) === name && button.checkVisibility(),
      ),
    WAIT,
    name,
  );
  await /** @type {any} */ (found).click();
}

/** Waits until a map shows a round. @param {Page} page @param {number} round */
export const roundIs = (page, round) => page.waitForSelector(`[role="img"][aria-label^="Map. Round ${round}."]`);
