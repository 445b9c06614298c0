// Durations in words.

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
