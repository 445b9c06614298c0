// Text from strangers: names, messages, prompts, answers. It is never markup, and every character is visible.
import { html } from "../ui.js";

const HIDDEN = /[\p{Cc}\p{Cf}\p{Zl}\p{Zp}\p{Co}\p{Cs}]/gu;

/** The number of characters shown at first; more on request. */
const SHOWN_CHARS = 20_000;

/**
 * A text whose control characters, and those that change its direction or cannot be seen, are shown as symbols. The joiners
 * of emoji stay.
 * @param {unknown} value
 * @param {boolean} [keepLines]
 */
export function visible(value, keepLines = false) {
  return String(value ?? "").replace(HIDDEN, (c, index, whole) => {
    if (keepLines && (c === "\n" || c === "\t")) return c;
    const code = c.codePointAt(0) ?? 0;
    if (code === 0x200d && joins(whole, index)) return c;
    if (code < 0x20) return String.fromCodePoint(0x2400 + code);
    return `⟨${code.toString(16).toUpperCase().padStart(4, "0")}⟩`;
  });
}

/** @param {string} text @param {number} index */
const joins = (text, index) =>
  /\p{Extended_Pictographic}[\u{fe0f}\p{Emoji_Modifier}]*$/u.test(text.slice(Math.max(0, index - 6), index)) &&
  /^\p{Extended_Pictographic}/u.test(text.slice(index + 1, index + 3));

/** A short text in a line. @param {{value: unknown, title?: string}} props */
export const Text = ({ value, title }) => html`<bdi class="foreign" title=${title}>${visible(value)}</bdi>`;

/** The name of a prompt, which breaks between its parts. @param {{value: unknown}} props */
export const PromptName = ({ value }) => html`<bdi class="foreign">${visible(value).split(/(?<=[+:,])/).map((part) => html`${part}<wbr />`)}</bdi>`;

/** The number of characters of a name in a table; the rest of a longer one is a press away. */
const NAME_CHARS = 48;

/** A name in a table. @param {{value: unknown}} props */
export function Name({ value }) {
  const text = visible(value);
  const first = [...text].slice(0, NAME_CHARS).join("");
  if (first === text) return html`<${Text} value=${value} />`;
  return html`<details class="name"><summary title=${text}><bdi class="foreign">${first}…</bdi></summary><bdi class="foreign">${text}</bdi></details>`;
}

/** A text with its line breaks. @param {{value: unknown}} props */
export const Lines = ({ value }) => html`<div class="foreign lines">${visible(value, true)}</div>`;

/** A long text with its line breaks, which scrolls. @param {{value: unknown, label: string}} props */
export function LongText({ value, label }) {
  const text = String(value ?? "");
  const shown = text.length > SHOWN_CHARS ? `${text.slice(0, SHOWN_CHARS)} …` : text;
  return html`<pre class="foreign long" tabindex="0" role="region" aria-label=${label}>${visible(shown, true)}</pre>
    ${text.length > SHOWN_CHARS && html`<p class="muted">${text.length - SHOWN_CHARS} more characters are in the journal.</p>`}`;
}
