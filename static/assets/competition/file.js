// Checks the file of a competition in the browser: everything except the rounds, which are not replayed.
import { TASKS } from "../parts/tasks.js";
import { Chain, Mismatch, bytesOf, check, hex, linesOf, parsed, sha256 } from "./chain.js";

/**
 * @typedef {{commitment: string, head: string, lines: number, games: number, entrants: number, rows: any[]}} Findings head: the hash after
 *   the last record; rows: the board of the file
 */

/**
 * Reads a file to its end. Throws a Mismatch if something in it is wrong.
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

/** Format 3 has seeds of each task; 2 added actions, spare attempts, parts and rules for equal totals to 1. */
const FORMATS = [1, 2, 3];

/** The fields that only files from a later format on have, and that format. @type {Record<string, Record<string, number>>} */
const LATER = {
  definition: { spares: 2, attempts_per_day: 2, public_seeds: 2, tie_breaks: 2, terms: 2, own_games: 2, categories: 2, seeds_by_task: 3 },
  entrant: { category: 2, terms: 2 },
  attempt: { replays: 2 },
};

/** Actions after the opening that a file of format 3 has: all others decide nothing. */
const AFTER_END = ["attempt.void", "episode.void", "entrant.change", "entrants.exclude"];

const STATUSES = ["running", "finished", "aborted", "abandoned", "closed"];

/** @typedef {{run: string, attempt: number, run_status: string, startedAt: string, endedAt: string, total: number | null}} Played it was not voided and is over */

class File {
  /** @param {AsyncGenerator<Uint8Array<ArrayBuffer>>} lines @param {{bytes: number, lines: number, games: number}} progress */
  constructor(lines, progress) {
    this.lines = lines;
    this.progress = progress;
    this.chain = new Chain();
    this.runs = new Set();
    /** The played attempts by entrant. @type {Map<string, Played[]>} */
    this.played = new Map();
    /** Attempts of each entrant, by the number of the one in whose place they count. @type {Map<string, {counted: Set<number>, voided: number[], spares: Set<number>}>} */
    this.attempts = new Map();
    /** Runs that organizers voided, with the reasons. @type {Set<string>} */
    this.voids = new Set();
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
    check(competition.revealed_at !== undefined, "the competition does not say when it was opened");
    const plans = await plansOf(competition);
    checkFormat("definition", definition, format);
    const entrants = new Map();
    let record = await this.record();
    for (; record.kind === "action"; record = await this.record()) this.action(record, competition);
    for (; record.kind === "entrant"; record = await this.record()) {
      checkFormat("entrant", record, format);
      check(!entrants.has(record.id), "an entrant is there twice");
      check(!/\p{Cc}/u.test(record.name), "the name of an entrant has control characters");
      entrants.set(record.id, record);
      this.played.set(record.id, []);
      this.attempts.set(record.id, { counted: new Set(), voided: [], spares: new Set() });
    }
    for (; record.kind === "attempt"; record = await this.record()) {
      check(entrants.has(record.entrant), "an attempt has no entrant");
      const own = plans[record.attempt - 1];
      check(own !== undefined && !this.runs.has(record.run), "an attempt has no place");
      this.runs.add(record.run);
      this.place(record, competition);
      const { run, attempt, status, created_at, ended_at } = record;
      const total = await this.attempt(record, definition, own);
      if (status === "running" || record.voided !== undefined) continue;
      this.played.get(record.entrant)?.push({ run, attempt, run_status: status, startedAt: moment(created_at), endedAt: moment(ended_at), total });
    }
    check(record.kind === "board", "a record is out of place");
    const { rows } = record;
    this.checkBoard(rows, entrants, definition);
    const end = await this.record();
    check(end.kind === "end" && end.episodes === this.progress.games, "it does not have as many games as it says");
    check(Boolean((await this.lines.next()).done), "there is something after the end");
    const { lines, games } = this.progress;
    return { commitment: competition.commitment, head: hex(this.chain.head), lines, games, entrants: entrants.size, rows };
  }

  /** @param {any} record @param {any} competition */
  action({ at, action, subject, detail }, { format, revealed_at }) {
    check(format > 1, "the first format has no actions");
    check(typeof detail === "object" && detail !== null && !Array.isArray(detail), "the detail of an action is no object");
    const isLate = format > 2 && revealed_at !== null && moment(at) >= moment(revealed_at);
    check(!isLate || AFTER_END.includes(action), "an action after the end is no part of a file");
    if (action === "attempt.void") this.voids.add(JSON.stringify([subject, detail.reason]));
  }

  /** Checks that an attempt may be where it is. @param {any} record @param {any} competition */
  place(record, { definition, format, revealed_at }) {
    checkFormat("attempt", record, format);
    const { attempt, replays, run, status, voided, games } = record;
    check(STATUSES.includes(status) && record.ended_at !== undefined, "an attempt has no status, or no end");
    check(revealed_at === null || status !== "running", "an attempt is running after the end");
    check(voided === undefined || games.length === 0, "an attempt was voided, and has games");
    check(voided === undefined || format === 1 || this.voids.has(JSON.stringify([run, voided])), "an attempt was voided, but no action says so");
    const own = /** @type {NonNullable<ReturnType<typeof this.attempts.get>>} */ (this.attempts.get(record.entrant));
    check((replays !== undefined) === attempt > definition.attempts.length, "a spare attempt plays another one again");
    if (replays !== undefined) {
      check(own.voided.includes(replays) && !own.spares.has(attempt), "a spare attempt has no voided one, or its seeds were used before");
      own.spares.add(attempt);
    }
    const number = replays ?? attempt;
    check(voided !== undefined || !own.counted.has(number), "an attempt was played twice");
    if (voided === undefined) own.counted.add(number);
    else own.voided.push(number);
  }

  /** Checks the games of an attempt; returns its total. @param {any} attempt @param {any} definition @param {{task: string, seed: number}[]} plan */
  async attempt(attempt, definition, plan) {
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
    const isWhole = plan.every((_, slot) => scores.has(slot) || voided.has(slot));
    check(attempt.status !== "finished" || attempt.voided !== undefined || isWhole, "a finished attempt has too few games");
    // The first seeds made the public board; the others make the board of the file.
    const isShown = (/** @type {number} */ slot) => slot % definition.seeds >= (definition.public_seeds ?? 0);
    return totalOf(definition.tasks, plan, scores, voided, isShown);
  }

  /** Checks the journal of a game; returns its score. @param {any} game @param {{task: string, seed: number}} place @param {string} run */
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

  /** @param {any[]} rows @param {Map<string, any>} entrants @param {any} definition */
  checkBoard(rows, entrants, { counts, tie_breaks: rules = [] }) {
    check(rows.length === entrants.size && new Set(rows.map((row) => row.entrant)).size === rows.length, "the board does not have a row for each entrant");
    for (const row of rows) {
      const attempts = this.attempts.get(row.entrant);
      if (!attempts) throw new Mismatch("the board has a row without an entrant");
      const own = this.played.get(row.entrant) ?? [];
      const counting = countingOf(own, counts);
      check(row.run === (counting?.run ?? null), "a row counts another attempt than it should");
      check(row.attempt === (counting?.attempt ?? null) && row.run_status === (counting?.run_status ?? null), "a row says something else of its attempt");
      check(row.total === (counting?.total ?? null), "a total does not follow from the scores");
      check(row.attempts === own.length && row.voided_attempts === attempts.voided.length, "a row has another number of attempts");
    }
    const isActive = (/** @type {any} */ row) => entrants.get(row.entrant).status === "active";
    const first = rows.filter((row) => isActive(row) && row.run !== null);
    const places = [...entrants.keys()];
    const rest = rows.filter((row) => !first.includes(row)).map((row) => ({ row, place: (isActive(row) ? 0 : places.length) + places.indexOf(row.entrant) }));
    check(first.every((row, index) => row === rows[index]), "entrants without a rank come last");
    check(rest.every(({ row, place }, index) => row.rank === null && (index === 0 || place > rest[index - 1].place)), "entrants without a rank are in another order");
    first.forEach((row, index) => {
      const above = first[index - 1];
      const order = above ? this.compare(above, row, rules) : -1;
      check(order <= 0, "the ranks are not in the order of the totals");
      const rank = order === 0 ? above.rank : index + 1;
      check(row.rank === (row.total === null ? null : rank), "a rank is another one than its place");
    });
  }

  /** Below 0 where `a` is ahead of `b`, 0 where they share a rank. @param {any} a @param {any} b @param {string[]} tieBreaks */
  compare(a, b, tieBreaks) {
    const byTotal = inOrder(comparable(b.total), comparable(a.total));
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
        return (this.attempts.get(a.entrant)?.counted.size ?? 0) - (this.attempts.get(b.entrant)?.counted.size ?? 0);
      case "earliest":
        return inOrder(this.endOf(a), this.endOf(b));
      default:
        throw new Mismatch("equal totals are ordered by a rule that this page does not know");
    }
  }

  /** @param {any} row */
  endOf({ entrant, run }) {
    return this.played.get(entrant)?.find((played) => played.run === run)?.endedAt ?? "";
  }
}

/** Refuses fields of later formats. @param {string} kind @param {any} record @param {number} format */
function checkFormat(kind, record, format) {
  const later = Object.entries(LATER[kind]).find(([field, first]) => field in record && format < first);
  check(!later, `format ${format} has no ${later?.[0]}`);
}

/** Times are in the order of their texts without the Z at the end, to the last digit. @param {any} text may be null */
const moment = (text) => String(text).replace(/Z$/, "");

/** Below 0 where `a` comes first. @template {string | number} T @param {T} a @param {T} b */
const inOrder = (a, b) => Number(a > b) - Number(a < b);

/** The attempt that counts. @param {Played[]} played @param {string} counts */
function countingOf(played, counts) {
  const own = played.toSorted((a, b) => inOrder(a.startedAt, b.startedAt) || inOrder(a.run, b.run));
  if (counts === "first") return own.at(0);
  if (counts === "last") return own.at(-1);
  check(counts === "best", "it does not say which attempt counts");
  return own.toSorted((a, b) => inOrder(comparable(b.total), comparable(a.total))).at(0);
}

/** Totals that are equal for the board are equal; null is lower than all others. @param {number | null} total */
const comparable = (total) => (total === null ? -Infinity : Math.sign(total) * Math.round(Math.abs(total) * 1e9));

/** Shares without rounding; nothing of nothing is 0. @param {[number, number]} a @param {[number, number]} b */
function compareShares([part, whole], [otherPart, otherWhole]) {
  const times = (/** @type {number} */ left, /** @type {number} */ right) => BigInt(left) * BigInt(Math.max(right, 1));
  const difference = times(part, otherWhole) - times(otherPart, whole);
  return Number(difference > 0n) - Number(difference < 0n);
}

/** Checks the commitment. Returns the tasks and seeds of all games by attempt, spare ones last. @param {any} competition */
async function plansOf({ salt, seeds, commitment, definition }) {
  const sealed = seeds.map(bytesOf);
  const attempts = definition.attempts.length + (definition.spares ?? 0);
  check([undefined, true, false].includes(definition.seeds_by_task), "seeds_by_task is neither true nor false");
  check(seeds.length === definition.seeds * attempts, "it has another number of seeds than it says");
  check(hex(await sha256(bytesOf(salt), ...sealed)) === commitment, "salt and seeds do not fit the commitment");
  return Promise.all(Array.from({ length: attempts }, (_, index) => {
    const own = sealed.slice(index * definition.seeds, (index + 1) * definition.seeds);
    const ofTask = (/** @type {string} */ task) => own.map(async (seed) => ({ task, seed: await seedOf(seed, definition.seeds_by_task ? task : "") }));
    return Promise.all(definition.tasks.flatMap(ofTask));
  }));
}

/**
 * The seed of a game: the first 8 bytes of the hash of sealed seed and task name, without the last 11 bits.
 * @param {Uint8Array<ArrayBuffer>} sealed @param {string} task empty where all tasks are played on the same seeds
 */
async function seedOf(sealed, task) {
  const hash = await sha256(sealed, new TextEncoder().encode(task));
  return Number(new DataView(hash.buffer).getBigUint64(0) >> 11n);
}

/**
 * The sum of the means of an attempt, in the order of tasks on boards: an unplayed game counts as 0, a voided game does not count.
 * @param {string[]} tasks @param {{task: string, seed: number}[]} plan @param {Map<number, number>} scores by slot
 * @param {Set<number>} voided slots @param {(slot: number) => boolean} isShown whether the board is made of it
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
