// Times: local, with UTC beside it, and clocks that run.
import { html, useEffect, useState } from "../ui.js";

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
  return parts
    .slice(first, first + 2)
    .filter(([count], index) => index === 0 || Number(count) > 0)
    .map(([count, unit]) => `${count} ${unit}`)
    .join(" ");
}

/** The time until a moment, or since. @param {{value: string}} props */
export function Countdown({ value }) {
  const [now, setNow] = useState(Date.now());
  useEffect(() => {
    const timer = setInterval(() => setNow(Date.now()), 1000);
    return () => clearInterval(timer);
  }, []);
  const left = new Date(value).getTime() - now;
  return html`<span class="number">${left >= 0 ? `in ${duration(left)}` : `${duration(-left)} ago`}</span>`;
}
