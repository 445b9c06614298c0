// Games may be shown on pages of others, and nothing else may.
import assert from "node:assert/strict";
import { createServer } from "node:http";
import { after, before } from "node:test";
import { open } from "./support/browser.mjs";
import { hosted } from "./support/games.mjs";
import { suite } from "./support/suite.mjs";

const { visit } = suite({ keys: true }, async (program) => ({
  game: await hosted(program, { task: "Pursuit", seed: 27, max_round: 10 }),
}));

/** A site of others: its page has a frame with the address in the query. */
const other = createServer((request, response) => {
  const { searchParams } = new URL(request.url ?? "/", "http://127.0.0.1");
  response.setHeader("Content-Type", "text/html");
  response.end(`<!DOCTYPE html><link rel="icon" href="data:,"><iframe src="${searchParams.get("frame")}" width="800" height="600">`);
});
let around = "";
before(async () => {
  await new Promise((resolve) => void other.listen(0, "127.0.0.1", () => resolve(undefined)));
  const address = other.address();
  around = `http://localhost:${typeof address === "object" && address?.port}`;
});
after(() => void other.close());

visit("a game is shown in a frame of another site", async ({ page, watch }, { program, data }) => {
  watch.allow(around);
  const game = `${program.url}/embed/episodes/${data.game}`;
  await page.goto(`${around}/?frame=${encodeURIComponent(game)}`);
  const frame = page.frameLocator("iframe");
  await frame.getByText("Pursuit").first().waitFor();
  assert.equal(await frame.getByRole("navigation", { name: "Pages" }).count(), 0);
  // Links out of the frame do not load in it.
  for (const link of await frame.getByRole("link").all()) {
    assert.equal(await link.getAttribute("target"), "_blank", await link.innerText());
  }
});

visit("no other page is shown in a frame", async ({ page, watch }, { program, data }) => {
  watch.allow(around);
  watch.expect(/frame-ancestors|ERR_BLOCKED_BY_RESPONSE|chrome-error|404/);
  for (const address of ["/", "/desk", "/play", `/episodes/${data.game}`, "/docs", "/nowhere"]) {
    await page.goto(`${around}/?frame=${encodeURIComponent(program.url + address)}`);
    const [, frame] = page.frames();
    await frame.waitForLoadState();
    assert.match(frame.url(), /^chrome-error:/, address);
  }
});

visit(
  "a game in a frame is asked for without the key of the tab",
  async ({ page }, { data }) => {
    const sent = /** @type {(string | undefined)[]} */ ([]);
    page.on("request", (request) => {
      if (request.url().includes("/api/")) sent.push(request.headers().authorization);
    });
    await open(page, `/episodes/${data.game}`);
    assert.ok(sent.some((header) => header?.startsWith("Bearer secret_")));
    // The page before sends nothing any more.
    await page.goto("about:blank");
    sent.length = 0;
    await open(page, `/embed/episodes/${data.game}`);
    assert.ok(sent.length > 0);
    assert.ok(sent.every((header) => header === undefined));
  },
  { asOrganizer: true },
);
