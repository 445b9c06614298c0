// One palette of twelve for agents and series, which colour-blind people tell apart, too (tests/browser/palette.test.mjs). Colour is
// never the only cue: agents have numbers, series have names and dashes.

/** Custom properties of app.css, which differ between light and dark. */
const SERIES = 12;

/** The colour of an agent or a series. @param {number} index */
export const color = (index) => `var(--series-${index % SERIES})`;

/** Dashes of a line, so that lines differ without colour. @param {number} index */
export const dashes = (index) => ["", "6 3", "2 3", "8 3 2 3"][Math.floor(index) % 4];
