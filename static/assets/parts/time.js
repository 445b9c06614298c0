// Times: local, with UTC beside it, and clocks that run.
import { html, useEvery, useState } from "../ui.js";
import { duration } from "./duration.js";

const LOCAL = new Intl.DateTimeFormat(undefined, { dateStyle: "medium", timeStyle: "short" });

/** @param {string} value */
const utc = (value) => `${new Date(value).toISOString().slice(0, 16).replace("T", " ")} UTC`;

/** A moment in local time; UTC on request, or always. @param {{value?: string | null, both?: boolean}} props */
export function Time({ value, both }) {
  if (!value) return html`<span class="muted">–</span>`;
  return html`<time datetime=${value} title=${utc(value)}>${LOCAL.format(new Date(value))}${both && ` (${utc(value)})`}</time>`;
}

/** The time until a moment, or since; of a moment that can only be ahead, “now” once it is there. @param {{value: string, isAhead?: boolean}} props */
export function Countdown({ value, isAhead }) {
  const [now, setNow] = useState(Date.now());
  useEvery(1000, () => setNow(Date.now()));
  const left = new Date(value).getTime() - now;
  // A second is nothing: “0 s ago” would be odd.
  if (Math.abs(left) < 1000) return html`<span class="number">now</span>`;
  return html`<span class="number">${left >= 0 ? `in ${duration(left)}` : isAhead ? "now" : `${duration(-left)} ago`}</span>`;
}
