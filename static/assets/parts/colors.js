// One palette for agents and series: Okabe and Ito's, for colour-blind people, too. Colour is never the only
// cue: agents have numbers, series have names and dashes.

/** Custom properties of app.css, which differ between light and dark. */
const SERIES = 8;

/** The colour of an agent or a series. @param {number} index */
export const color = (index) => `var(--series-${index % SERIES})`;

/** Dashes of a line, so that lines differ without colour. @param {number} index */
export const dashes = (index) => ["", "6 3", "2 3", "8 3 2 3"][Math.floor(index) % 4];

const drawn = new Map();

/** The same as a value for a canvas. @param {number} index */
export function canvasColor(index) {
  return cssValue(`--series-${index % SERIES}`);
}

/** The value of a custom property now. @param {string} name */
export function cssValue(name) {
  if (!drawn.has(name)) drawn.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return drawn.get(name);
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => drawn.clear());
