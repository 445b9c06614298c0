// Checks the file of a competition in the browser. Everything but the rounds themselves: they are not played again.
import { TASKS } from "../parts/tasks.js";
import { Chain, Mismatch, bytesOf, check, hex, linesOf, parsed, sha256 } from "./chain.js";

/**
 * @typedef {object} Findings
 * @property {string} commitment
 * @property {string} head the hash after the last record
 * @property {number} lines
 * @property {number} games
 * @property {number} entrants
 * @property {any[]} rows the board of the file
 */

/**
 * Reads a file to its end. Throws a Mismatch where something in it does not fit.
 * @param {ReadableStream<Uint8Array<ArrayBuffer>>} stream
 * @param {(progress: {bytes: number, lines: number, games: number}) => void} onProgress
 * @returns {Promise<Findings>}
 */
export async function checkFile(stream, onProgress) {
  const progress = { bytes: 0, lines: 0, games: 0 };
  const lines = linesOf(stream, (bytes) => {
    progress.bytes += bytes;
    onProgress(progress);
  });
  try {
    return await new File(lines, progress).check();
  } catch (error) {
    // A record that lacks a field.
    const isOdd = error instanceof TypeError || error instanceof RangeError;
    if (!isOdd && !(error instanceof Mismatch)) throw error;
    throw new Mismatch(`line ${progress.lines}: ${isOdd ? "a record has other fields than it should" : error.message}`);
  } finally {
    await lines.return(undefined);
  }
}

/** 3 has seeds of each task; 2 has what organizers did, spare attempts, parts and rules for equal totals; 1 is without these. */
const FORMATS = [1, 2, 3];

class File {
  /**
   * @param {AsyncGenerator<Uint8Array<ArrayBuffer>>} lines
   * @param {{bytes: number, lines: number, games: number}} progress
   */
  constructor(lines, progress) {
    this.lines = lines;
    this.progress = progress;
    this.chain = new Chain();
    /** What was played in each run. @type {Map<string, {total: number | null, endedAt: string}>} */
    this.played = new Map();
    /** Attempts of each entrant that were not voided. @type {Map<string, number>} */
    this.attempts = new Map();
  }

  async line() {
    const { value, done } = await this.lines.next();
    check(!done, "the file ends too early");
    this.progress.lines += 1;
    return /** @type {Uint8Array<ArrayBuffer>} */ (value);
  }

  async record() {
    return parsed(await this.chain.next(await this.line()));
  }

  async check() {
    const competition = await this.record();
    const isKnown = competition.kind === "competition" && FORMATS.includes(competition.format);
    check(isKnown, "this is not the file of a competition in a format that this page knows");
    const { definition, format } = competition;
    const plans = await plansOf(competition);
    const entrants = new Set();
    let record = await this.record();
    for (; record.kind === "action"; record = await this.record()) check(format > 1, "the first format has no actions");
    for (; record.kind === "entrant"; record = await this.record()) {
      check(!entrants.has(record.id), "an entrant is there twice");
      entrants.add(record.id);
    }
    for (; record.kind === "attempt"; record = await this.record()) {
      check(entrants.has(record.entrant), "an attempt has no entrant");
      const own = plans[record.attempt - 1];
      check(own !== undefined && !this.played.has(record.run), "an attempt has no place");
      this.played.set(record.run, { total: await this.attempt(record, definition, own), endedAt: record.ended_at });
      if (record.voided === undefined) this.attempts.set(record.entrant, (this.attempts.get(record.entrant) ?? 0) + 1);
    }
    check(record.kind === "board", "a record is out of place");
    const { rows } = record;
    this.checkBoard(rows, entrants, definition.tie_breaks ?? []);
    const end = await this.record();
    check(end.kind === "end" && end.episodes === this.progress.games, "it does not have as many games as it says");
    check(Boolean((await this.lines.next()).done), "there is something after the end");
    const { lines, games } = this.progress;
    return { commitment: competition.commitment, head: hex(this.chain.head), lines, games, entrants: entrants.size, rows };
  }

  /**
   * Checks the games of an attempt; returns its total.
   * @param {any} attempt @param {any} definition @param {{task: string, seed: number}[]} plan
   */
  async attempt(attempt, definition, plan) {
    /** @type {Map<number, number>} */
    const scores = new Map();
    const voided = new Set();
    for (const game of attempt.games) {
      const place = plan[game.slot];
      check(place !== undefined, "a game has no place in the plan");
      if (game.voided !== undefined) {
        voided.add(game.slot);
        continue;
      }
      check(!scores.has(game.slot), "a game was played twice");
      scores.set(game.slot, await this.game(game, place, attempt.run));
    }
    // The first seeds made the board before the end; the others make that of the file.
    const isShown = (/** @type {number} */ slot) => slot % definition.seeds >= (definition.public_seeds ?? 0);
    return totalOf(definition.tasks, plan, scores, voided, isShown);
  }

  /**
   * Checks the journal of a game; returns its score.
   * @param {any} game @param {{task: string, seed: number}} place @param {string} run
   */
  async game(game, place, run) {
    const header = await this.record();
    const isHeader = header.kind === "episode" && header.episode === game.episode && header.slot === game.slot;
    check(isHeader && header.lines >= 2, "a journal is out of place");
    const chain = new Chain();
    const opening = parsed(await chain.next(await this.line()));
    const isOwn = opening.kind === "opening" && opening.episode === game.episode && opening.run === run;
    check(isOwn, "a journal belongs to another game");
    const { task, seed } = opening.config;
    check(task === place.task && seed === place.seed, "a game was not played on its sealed seed");
    for (let line = 2; line < header.lines; line += 1) await chain.next(await this.line());
    const end = parsed(await chain.next(await this.line()));
    check(end.kind === "end" && typeof end.score === "number", "a journal has no end");
    check(hex(chain.head) === header.head, "a journal ends with another hash than the file says");
    this.progress.games += 1;
    return end.score;
  }

  /** @param {any[]} rows @param {Set<string>} entrants @param {string[]} tieBreaks */
  checkBoard(rows, entrants, tieBreaks) {
    check(rows.length === entrants.size, "the board does not have a row for each entrant");
    for (const row of rows) {
      check(entrants.delete(row.entrant), "the board has a row without an entrant");
      if (row.run !== null) check(this.played.get(row.run)?.total === row.total, "a total does not follow from the scores");
      entrants.add(row.entrant);
    }
    const ranked = rows.filter((row) => row.rank !== null);
    ranked.forEach((row, index) => {
      const above = ranked[index - 1];
      const order = above ? this.compare(above, row, tieBreaks) : -1;
      check(order <= 0, "the ranks are not in the order of the totals");
      check(row.rank === (order === 0 ? above.rank : index + 1), "a rank is another one than its place");
    });
  }

  /** Below 0 where `a` is ahead of `b`, 0 where they share a rank. @param {any} a @param {any} b @param {string[]} tieBreaks */
  compare(a, b, tieBreaks) {
    const byTotal = comparable(b.total) - comparable(a.total);
    if (byTotal !== 0) return byTotal;
    for (const rule of tieBreaks) {
      const order = this.compareBy(rule, a, b);
      if (order !== 0) return order;
    }
    return 0;
  }

  /** @param {string} rule @param {any} a @param {any} b */
  compareBy(rule, a, b) {
    switch (rule) {
      case "invalid":
        return compareShares([a.invalid, a.answers], [b.invalid, b.answers]);
      case "timeouts":
        return compareShares([a.timeouts, a.answers + a.timeouts], [b.timeouts, b.answers + b.timeouts]);
      case "attempts":
        return (this.attempts.get(a.entrant) ?? 0) - (this.attempts.get(b.entrant) ?? 0);
      case "earliest":
        return this.endOf(a) - this.endOf(b);
      default:
        throw new Mismatch("equal totals are ordered by a rule that this page does not know");
    }
  }

  /** @param {any} row */
  endOf({ run }) {
    return Date.parse(this.played.get(run)?.endedAt ?? "");
  }
}

/** Totals that are equal for the board are equal. @param {number} total */
const comparable = (total) => Math.round(total * 1e9);

/** Shares without rounding; nothing of nothing is 0. @param {[number, number]} a @param {[number, number]} b */
function compareShares([part, whole], [otherPart, otherWhole]) {
  const times = (/** @type {number} */ left, /** @type {number} */ right) => BigInt(left) * BigInt(Math.max(right, 1));
  const difference = times(part, otherWhole) - times(otherPart, whole);
  return Number(difference > 0n) - Number(difference < 0n);
}

/**
 * The tasks and seeds of all games, attempt by attempt, spare ones last, after the commitment was checked.
 * @param {any} competition
 */
async function plansOf({ salt, seeds, commitment, definition }) {
  const sealed = seeds.map(bytesOf);
  const attempts = definition.attempts.length + (definition.spares ?? 0);
  check(seeds.length === definition.seeds * attempts, "it has another number of seeds than it says");
  check(hex(await sha256(bytesOf(salt), ...sealed)) === commitment, "salt and seeds do not fit the commitment");
  return Promise.all(Array.from({ length: attempts }, (_, index) => {
    const own = sealed.slice(index * definition.seeds, (index + 1) * definition.seeds);
    const ofTask = (/** @type {string} */ task) => own.map(async (seed) => ({ task, seed: await seedOf(seed, definition.seeds_by_task ? task : "") }));
    return Promise.all(definition.tasks.flatMap(ofTask));
  }));
}

/**
 * The first 8 bytes of the hash of a sealed seed and the name of the task, without the last 11 bits.
 * @param {Uint8Array<ArrayBuffer>} sealed @param {string} task empty where all tasks are played on the same seeds
 */
async function seedOf(sealed, task) {
  const hash = await sha256(sealed, new TextEncoder().encode(task));
  return Number(new DataView(hash.buffer).getBigUint64(0) >> 11n);
}

/**
 * The sum of the means of an attempt, in the order of tasks on boards: a game that was not played counts as 0, one that was voided alone does not count.
 * @param {string[]} tasks
 * @param {{task: string, seed: number}[]} plan
 * @param {Map<number, number>} scores by slot
 * @param {Set<number>} voided slots
 * @param {(slot: number) => boolean} isShown whether the board is made of it
 */
function totalOf(tasks, plan, scores, voided, isShown) {
  let total = 0;
  for (const task of TASKS.filter((name) => tasks.includes(name))) {
    const slots = plan.map((place, slot) => ({ ...place, slot })).filter(({ task: name, slot }) => name === task && isShown(slot));
    const counting = slots.filter(({ slot }) => scores.has(slot) || !voided.has(slot)).sort((a, b) => a.seed - b.seed);
    if (counting.length === 0) return null;
    total += counting.reduce((sum, { slot }) => sum + (scores.get(slot) ?? 0), 0) / counting.length;
  }
  return total;
}
