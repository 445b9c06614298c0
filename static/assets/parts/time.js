// Times: local, with UTC beside it, and clocks that run.
import { html, useEvery, useState } from "../ui.js";

const LOCAL = new Intl.DateTimeFormat(undefined, { dateStyle: "medium", timeStyle: "short" });

/** @param {string} value */
const utc = (value) => `${new Date(value).toISOString().slice(0, 16).replace("T", " ")} UTC`;

/** A moment in local time; UTC on request, or always. @param {{value?: string | null, both?: boolean}} props */
export function Time({ value, both }) {
  if (!value) return html`<span class="muted">–</span>`;
  return html`<time datetime=${value} title=${utc(value)}>${LOCAL.format(new Date(value))}${both && ` (${utc(value)})`}</time>`;
}

/** @param {number} ms */
export function duration(ms) {
  const seconds = Math.max(0, Math.round(ms / 1000));
  const parts = [
    [Math.floor(seconds / 86_400), "d"],
    [Math.floor(seconds / 3600) % 24, "h"],
    [Math.floor(seconds / 60) % 60, "min"],
    [seconds % 60, "s"],
  ];
  const first = parts.findIndex(([count]) => Number(count) > 0);
  if (first < 0) return "0 s";
  const shown = parts.slice(first, first + 2).filter(([count], index) => index === 0 || Number(count) > 0);
  return shown.map(([count, unit]) => `${count} ${unit}`).join(" ");
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
