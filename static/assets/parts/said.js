// Messages as the rules count and cut them (docs/rules.md, "Messages").

/** Characters (code points) after which a message is cut. */
export const MESSAGE_CHARS_MAX = 120;

/**
 * The message that is sent for a text, how many characters it has, and how many are cut off.
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
