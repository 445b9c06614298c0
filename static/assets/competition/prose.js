// Longer texts of organizers, with their line breaks.
import { html } from "../ui.js";
import { visible } from "../parts/text.js";

/** A longer text scrolls, so that the content below stays near. */
const SHOWN_CHARS = 800;

/** @param {{text: string, label: string}} props label: for those who hear that it scrolls */
export function Prose({ text, label }) {
  const isLong = text.length > SHOWN_CHARS;
  const scrolls = isLong ? { tabindex: 0, role: "region", "aria-label": label } : {};
  return html`<div class=${`foreign prose ${isLong ? "long" : ""}`} ...${scrolls}>${visible(text, true)}</div>`;
}
