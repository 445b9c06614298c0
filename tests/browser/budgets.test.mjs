// The cost of pages: bytes of the first load, bytes of a game, time of a frame. Measurements are printed. Times are processor
// times, so that a busy machine fails no test.
import assert from "node:assert/strict";
import { gzipSync } from "node:zlib";
import { open } from "./support/browser.mjs";
import { hosted, spoken, talkative } from "./support/games.mjs";
import { dice } from "./support/dice.mjs";
import { PLACES, full } from "./support/site.mjs";
import { suite } from "./support/suite.mjs";

const FIRST_LOAD_BYTES = 60_000;
const GAME_BYTES = 100_000;
const REPLAY_BYTES = 60_000;

/** Milliseconds for 60 frames a second with 12 agents, and for 20 with 1,024; slow processors may take three times as long. */
const FRAME_MS = { small: (1000 / 60) * 3, large: (1000 / 20) * 3 };

/** Whether files come from the program, without comments. Files of a folder come as they are. */
const AS_SENT = !process.env.SWARMBENCH_PAGES;

const QUIET_MS = 4_000;

const SCRUB_MS = 3_000;

const { visit } = suite({ keys: true }, async (program) => {
  const draw = dice(1);
  const anything = ({ actions }) => ({ action: actions[draw(actions.length)] });
  const large = { task: "Synchronization", seed: 1, num_agents: 1_024, width: 256, height: 256, max_round: 12 };
  return {
    ...(await full(program)),
    small: await hosted(program, { task: "Foraging", seed: 27 }),
    talking: (await spoken(program, { task: "Pursuit", seed: 27 }, { decide: talkative(1) })).id,
    large: (await spoken(program, large, { decide: anything })).id,
  };
});

/** Waits until a page loads nothing more; a page that follows a game always loads. @param {import("playwright-core").Page} page */
const quiet = (page) => page.waitForLoadState("networkidle", { timeout: QUIET_MS }).catch(() => {});

/**
 * Bytes that a page loads, compressed as the server sends them: documents and files, and data.
 * @param {import("playwright-core").Page} page
 * @param {string} address
 */
async function loaded(page, address) {
  const bodies = /** @type {Promise<{isData: boolean, bytes: number}>[]} */ ([]);
  page.on("response", (response) => {
    const { pathname } = new URL(response.url());
    // A stream has no end while its game runs.
    if (pathname.endsWith("/events")) return;
    const isData = pathname.startsWith("/api/");
    const size = response.body().then((body) => ({ isData, bytes: gzipSync(body, { level: 9 }).length }));
    bodies.push(size.catch(() => ({ isData, bytes: 0 })));
  });
  await open(page, address);
  await quiet(page);
  const bytes = { files: 0, data: 0 };
  for (const body of await Promise.all(bodies)) bytes[body.isData ? "data" : "files"] += body.bytes;
  return bytes;
}

for (const { name, address, needsKey } of PLACES.filter(({ name }) => name !== "missing")) {
  visit(
    `${name}: the first load is small`,
    async ({ page }, { data }) => {
      const { files } = await loaded(page, address(data));
      console.log(`${name}: ${(files / 1000).toFixed(1)} kB`);
      assert.ok(files <= FIRST_LOAD_BYTES || !AS_SENT, `${files} bytes`);
    },
    { asOrganizer: needsKey },
  );
}

visit("a game of 100 rounds is small", async ({ page }, { data, program }) => {
  for (const id of [data.small, data.talking]) {
    const { files, data: bytes } = await loaded(page, `/episodes/${id}`);
    console.log(`a game: ${((files + bytes) / 1000).toFixed(1)} kB, of them ${(bytes / 1000).toFixed(1)} kB data`);
    assert.ok(files + bytes <= GAME_BYTES, `${files + bytes} bytes`);
    const replay = await program.get(`/api/v1/episodes/${id}/replay`);
    for (const state of replay.states) {
      delete state.said;
      delete state.heard;
    }
    const silent = JSON.stringify(replay).length;
    console.log(`a page of its replay without messages: ${(silent / 1000).toFixed(1)} kB`);
    assert.ok(silent <= REPLAY_BYTES, `${silent} bytes`);
  }
});

/**
 * Milliseconds of the page's thread for a frame, while every frame shows another round.
 * @param {import("playwright-core").Page} page
 * @param {string} address
 */
async function frame(page, address) {
  await open(page, address);
  const slider = page.getByRole("slider", { name: "Round" });
  await slider.waitFor();
  await quiet(page);
  const session = await page.context().newCDPSession(page);
  await session.send("Performance.enable", { timeDomain: "threadTicks" });
  const taken = async () => {
    const { metrics } = await session.send("Performance.getMetrics");
    return (metrics.find(({ name }) => name === "TaskDuration")?.value ?? NaN) * 1000;
  };
  const before = await taken();
  const { frames, perSecond } = await slider.evaluate(scrub, SCRUB_MS);
  const ms = ((await taken()) - before) / frames;
  console.log(`scrubbing: ${ms.toFixed(1)} ms a frame; now ${perSecond.toFixed(1)} frames a second`);
  return ms;
}

/** Runs in the page. @param {any} slider @param {number} ms */
async function scrub(slider, ms) {
  // The setter of the element itself is used: with preact's setter the event would be no change.
  const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value")?.set;
  const rounds = Number(slider.max);
  const begin = performance.now();
  let frames = 0;
  while (performance.now() - begin < ms) {
    await new Promise(requestAnimationFrame);
    set?.call(slider, String(frames % (rounds + 1)));
    slider.dispatchEvent(new Event("input", { bubbles: true }));
    frames += 1;
  }
  return { frames, perSecond: frames / ((performance.now() - begin) / 1000) };
}

visit("12 agents are scrubbed smoothly", async ({ page }, { data }) => {
  assert.ok((await frame(page, `/episodes/${data.small}`)) <= FRAME_MS.small);
});

visit("1,024 agents on 256 × 256 cells are scrubbed", async ({ page }, { data }) => {
  assert.ok((await frame(page, `/episodes/${data.large}`)) <= FRAME_MS.large);
});
