// Strangers' texts are shown as they are: no part of them runs, loads, or turns the text around it.
import assert from "node:assert/strict";
import { test } from "node:test";
import { open } from "./support/browser.mjs";
import { HOSTILE, MARK } from "./support/hostile.mjs";
import { PLACES, expectedAt, full, unfold } from "./support/site.mjs";
import { suite } from "./support/suite.mjs";

/** Pages without texts of strangers. */
const WITHOUT = new Set(["desk", "desk-create", "missing"]);

/** The one address elsewhere to which pages link themselves: the paper. */
const PAPER = "https://arxiv.org/abs/2505.04364";

/** Characters that turn text around; pages show symbols in their place. */
const TURNING = /[\u202a-\u202e\u2066-\u2069]/;

const { site, visit } = suite({ keys: true }, (program) => full(program, HOSTILE));

/** @param {import("playwright-core").Page} page */
async function onlyText(page) {
  const found = await page.evaluate(() => {
    const outside = "script:not([src]), iframe, object, embed, base, [onerror], [onload], [onfocus], [style*='import']";
    const links = [...document.querySelectorAll("a[href], form[action], [src]")].map((one) =>
      String(one.getAttribute("href") ?? one.getAttribute("src") ?? one.getAttribute("action")),
    );
    return {
      elements: [...document.querySelectorAll(outside)].map((one) => one.outerHTML.slice(0, 200)),
      links: links.filter((link) => !/^(\/|#|\.|blob:|data:image\/|http:\/\/127\.0\.0\.1)/.test(link)),
      title: document.title,
      text: document.body.innerText,
      hints: [...document.querySelectorAll("[title], [aria-label], [placeholder], option")].map(
        (one) => `${one.getAttribute("title")} ${one.getAttribute("aria-label")} ${one.getAttribute("placeholder")} ${one.textContent}`,
      ),
    };
  });
  assert.deepEqual(found.elements, []);
  assert.deepEqual(found.links.filter((link) => link !== PAPER), []);
  for (const text of [found.title, found.text, ...found.hints]) assert.doesNotMatch(text, TURNING);
  return found.text;
}

for (const { name, address, needsKey, unfolds } of PLACES) {
  visit(
    `${name}: hostile text is text`,
    async ({ page, watch }, { data }) => {
      watch.expect(...expectedAt(name));
      await open(page, address(data));
      await unfold(page, unfolds);
      if (!WITHOUT.has(name)) await page.getByText(MARK).first().waitFor();
      const text = await onlyText(page);
      if (!WITHOUT.has(name)) assert.match(text, /<script>|<img src=x/, "shown as it was written");
    },
    { asOrganizer: needsKey },
  );
}

visit("the board of a suite with a hostile name", async ({ page }, { data, program }) => {
  const { suite: played } = await program.get(`/api/v1/runs/${data.named}`);
  await open(page, `/board/${encodeURIComponent(played.name)}`);
  await page.getByText(MARK).first().waitFor();
  await onlyText(page);
});

test("documents are text before any script runs", async () => {
  const { program, data, browser } = site;
  const context = await browser.newContext({ javaScriptEnabled: false, baseURL: program.url });
  const page = await context.newPage();
  const { suite: played } = await program.get(`/api/v1/runs/${data.named}`);
  for (const address of [`/episodes/${data.talk}`, `/board/${encodeURIComponent(played.name)}`, `/runs/${encodeURIComponent("<img>'\"")}`]) {
    await page.goto(address);
    const { title, elements } = await page.evaluate(() => ({
      title: document.title,
      elements: document.querySelectorAll("script:not([src]), iframe, img, svg, style").length,
    }));
    assert.equal(elements, 0, address);
    assert.doesNotMatch(title, TURNING);
  }
  await page.goto(`/episodes/${data.talk}`);
  const shown = await page.evaluate(() => ({
    title: document.title,
    preview: document.querySelector("meta[property='og:title']")?.getAttribute("content"),
  }));
  assert.ok(shown.title.includes(HOSTILE.name("gpt-x", 60)), shown.title);
  assert.equal(shown.preview, shown.title);
  await context.close();
});
