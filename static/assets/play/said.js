// Messages as the rules count and cut them (docs/rules.md, "Messages").

/** The maximum length of a message, in code points. */
export const MESSAGE_CHARS_MAX = 120;

/**
 * The message that is sent for a text, its length, and the number of characters cut off.
 * @param {string} text
 */
export function readMessage(text) {
  const line = text
    .toWellFormed()
    .replace(/\r\n|[\p{Cc}\u2028\u2029]/gu, " ")
    .replace(/^\p{White_Space}+|\p{White_Space}+$/gu, "");
  const count = [...line].length;
  return { line, count, cut: Math.max(0, count - MESSAGE_CHARS_MAX) };
}
