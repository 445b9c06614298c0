// Lines of a file, and the chain of their hashes.
import { Problem } from "../api.js";

/** The maximum bytes of a line; a longer one ends the check. */
const LINE_BYTES_MAX = 128 * 1024 * 1024;

const HASH_BYTES = 32;
const BEFORE_HASH = '{"hash":"';
const AFTER_HASH = '","record":';
const RECORD_START = BEFORE_HASH.length + 2 * HASH_BYTES + AFTER_HASH.length;

/** The reason why a file fails. */
export class Mismatch extends Error {}

/** @param {boolean} holds @param {string} problem */
export function check(holds, problem) {
  if (!holds) throw new Mismatch(problem);
}

/** @param {Uint8Array} bytes */
export const hex = (bytes) => Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");

/** @param {string} text */
export const bytesOf = (text) => Uint8Array.from(text.match(/../g) ?? [], (digits) => Number.parseInt(digits, 16));

/** @param {Uint8Array<ArrayBuffer>[]} parts */
export async function sha256(...parts) {
  return new Uint8Array(await crypto.subtle.digest("SHA-256", joined(parts)));
}

/** @param {Uint8Array<ArrayBuffer>[]} parts @returns {Uint8Array<ArrayBuffer>} */
function joined(parts) {
  if (parts.length === 1) return parts[0];
  const all = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    all.set(part, at);
    at += part.length;
  }
  return all;
}

/**
 * The lines of a stream, without line feeds. One line is in memory.
 * @param {ReadableStream<Uint8Array<ArrayBuffer>>} stream
 * @param {(bytes: number) => void} onBytes
 * @returns {AsyncGenerator<Uint8Array<ArrayBuffer>>}
 */
export async function* linesOf(stream, onBytes) {
  const reader = stream.getReader();
  /** @type {Uint8Array<ArrayBuffer>[]} */
  let open = [];
  let openBytes = 0;
  try {
    for (;;) {
      const { value, done } = await reader.read().catch(brokenOff);
      if (done) break;
      onBytes(value.length);
      let start = 0;
      for (let end = value.indexOf(10); end >= 0; end = value.indexOf(10, start)) {
        yield joined([...open, value.subarray(start, end)]);
        [open, openBytes, start] = [[], 0, end + 1];
      }
      if (start < value.length) open.push(value.subarray(start));
      openBytes += value.length - start;
      check(openBytes <= LINE_BYTES_MAX, "a line is longer than this page reads");
    }
    check(openBytes === 0, "the file breaks off in the middle of a line");
  } finally {
    await reader.cancel().catch(() => undefined);
  }
}

/** @returns {never} */
function brokenOff() {
  throw new Problem(0, { detail: "The download broke off." });
}

/** A chain: every hash covers the one before it. */
export class Chain {
  head = new Uint8Array(HASH_BYTES);

  /** Checks the hash of a line. Returns its record as text. @param {Uint8Array<ArrayBuffer>} line */
  async next(line) {
    const text = (/** @type {number} */ from, /** @type {number} */ to) => decoder.decode(line.subarray(from, to));
    const hashEnd = BEFORE_HASH.length + 2 * HASH_BYTES;
    const isLine = text(0, BEFORE_HASH.length) === BEFORE_HASH && text(hashEnd, RECORD_START) === AFTER_HASH && line.at(-1) === 0x7d;
    check(isLine, "a line does not have the form of this file");
    const record = line.subarray(RECORD_START, -1);
    this.head = await sha256(this.head, record);
    check(text(BEFORE_HASH.length, hashEnd) === hex(this.head), "a line was changed: its hash is another");
    return record;
  }
}

const decoder = new TextDecoder("utf-8", { fatal: true });

/** @param {Uint8Array<ArrayBuffer>} record @returns {any} */
export function parsed(record) {
  try {
    return JSON.parse(decoder.decode(record));
  } catch {
    throw new Mismatch("a record cannot be read");
  }
}
