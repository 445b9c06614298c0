// The colours of agents and series are told apart by everybody: computed for colour vision and for its three deficiencies, in
// both modes.
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";

const COLOURS = 12;

/** The minimum difference of two colours (CIEDE2000): at 10 they differ at a glance. */
const DIFFERENCE = { normal: 18, others: 10 };

/** The minimum contrast of a shape with the grounds that it stands on (WCAG). */
const CONTRAST = 3;

/** Vision as matrices of linear light: Machado, Oliveira and Fernandes 2009, severity 1. @type {Record<string, number[]>} */
const VISION = {
  normal: [1, 0, 0, 0, 1, 0, 0, 0, 1],
  protanopia: [0.152286, 1.052583, -0.204868, 0.114503, 0.786281, 0.099216, -0.003882, -0.048116, 1.051998],
  deuteranopia: [0.367322, 0.860646, -0.227968, 0.280085, 0.672501, 0.047413, -0.01182, 0.04294, 0.968881],
  tritanopia: [1.255528, -0.076749, -0.178779, -0.078411, 0.930809, 0.147602, 0.004733, 0.691367, 0.3039],
};

/** @typedef {number[]} Colour three numbers */

/** Linear light of a colour. @param {string} hex @returns {Colour} */
const light = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255).map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));

/** @param {number[]} m @param {Colour} c @returns {Colour} */
const seen = (m, c) => [0, 3, 6].map((row) => Math.min(Math.max(m[row] * c[0] + m[row + 1] * c[1] + m[row + 2] * c[2], 0), 1));

/** @param {Colour} c */
const luminance = ([r, g, b]) => 0.2126 * r + 0.7152 * g + 0.0722 * b;

/** @param {string} one @param {string} other */
function contrast(one, other) {
  const [dark, bright] = [one, other].map((hex) => luminance(light(hex))).sort((a, b) => a - b);
  return (bright + 0.05) / (dark + 0.05);
}

/** CIELAB, for D65. @param {Colour} c @returns {Colour} */
function lab([r, g, b]) {
  const f = (/** @type {number} */ t) => (t > 0.008856 ? Math.cbrt(t) : 7.787 * t + 16 / 116);
  const x = f((0.4124564 * r + 0.3575761 * g + 0.1804375 * b) / 0.95047);
  const y = f(0.2126729 * r + 0.7151522 * g + 0.072175 * b);
  const z = f((0.0193339 * r + 0.119192 * g + 0.9503041 * b) / 1.08883);
  return [116 * y - 16, 500 * (x - y), 200 * (y - z)];
}

const DEGREES = 180 / Math.PI;

/** CIEDE2000 (Sharma, Wu and Dalal 2005). @param {Colour} one @param {Colour} other */
function difference([l1, a1, b1], [l2, a2, b2]) {
  const seventh = (/** @type {number} */ c) => Math.sqrt(c ** 7 / (c ** 7 + 25 ** 7));
  const g = 0.5 * (1 - seventh((Math.hypot(a1, b1) + Math.hypot(a2, b2)) / 2));
  const [p1, p2] = [(1 + g) * a1, (1 + g) * a2];
  const [c1, c2] = [Math.hypot(p1, b1), Math.hypot(p2, b2)];
  const hue = (/** @type {number} */ a, /** @type {number} */ b) => (Math.atan2(b, a) * DEGREES + 360) % 360;
  const [h1, h2] = [hue(p1, b1), hue(p2, b2)];
  const isGrey = c1 * c2 === 0;
  const turn = isGrey ? 0 : ((h2 - h1 + 540) % 360) - 180;
  const far = Math.abs(h1 - h2) > 180;
  const mean = isGrey ? h1 + h2 : (h1 + h2 + (far ? (h1 + h2 < 360 ? 360 : -360) : 0)) / 2;
  const [l, c] = [(l1 + l2) / 2, (c1 + c2) / 2];
  const cos = (/** @type {number} */ degrees) => Math.cos(degrees / DEGREES);
  const t = 1 - 0.17 * cos(mean - 30) + 0.24 * cos(2 * mean) + 0.32 * cos(3 * mean + 6) - 0.2 * cos(4 * mean - 63);
  const dl = (l2 - l1) / (1 + (0.015 * (l - 50) ** 2) / Math.sqrt(20 + (l - 50) ** 2));
  const dc = (c2 - c1) / (1 + 0.045 * c);
  const dh = (2 * Math.sqrt(c1 * c2) * Math.sin(turn / 2 / DEGREES)) / (1 + 0.015 * c * t);
  const rotation = -2 * seventh(c) * Math.sin((60 * Math.exp(-(((mean - 275) / 25) ** 2))) / DEGREES);
  return Math.sqrt(dl ** 2 + dc ** 2 + dh ** 2 + rotation * dc * dh);
}

const STYLE = await readFile(new URL("../../static/assets/app.css", import.meta.url), "utf8");
const [, first, second] = /:root \{([^}]*)\}[^{]*\{\s*:root \{([^}]*)\}/.exec(STYLE) ?? [];

/** @param {string} block @param {string} name */
const value = (block, name) => new RegExp(`--${name}: (#[0-9a-f]{6});`).exec(block)?.[1] ?? "";

test("the difference of colours is that of the published examples", () => {
  for (const [one, other, expected] of /** @type {[Colour, Colour, number][]} */ ([
    [[50, 2.6772, -79.7751], [50, 0, -82.7485], 2.0425],
    [[50, 2.5, 0], [73, 25, -18], 27.1492],
    [[6.7747, -0.2908, -2.4247], [5.8714, -0.0985, -2.2286], 0.6377],
  ])) assert.ok(Math.abs(difference(one, other) - expected) < 0.0001, String(expected));
});

for (const [mode, block] of Object.entries({ light: first, dark: second })) {
  const palette = Array.from({ length: COLOURS }, (_, index) => value(block, `series-${index}`));

  test(`${mode}: twelve colours that differ for every eye`, () => {
    assert.ok(palette.every(Boolean), "twelve of them");
    for (const [vision, matrix] of Object.entries(VISION)) {
      const all = palette.map((hex) => lab(seen(matrix, light(hex))));
      const pairs = all.flatMap((one, i) => all.slice(i + 1).map((other, j) => ({ pair: `${i} and ${i + 1 + j}`, far: difference(one, other) })));
      const nearest = pairs.sort((one, other) => one.far - other.far)[0];
      console.log(`${mode}, ${vision}: at least ${nearest.far.toFixed(1)}, of ${nearest.pair}`);
      assert.ok(nearest.far >= (vision === "normal" ? DIFFERENCE.normal : DIFFERENCE.others), `${vision}: ${nearest.pair}`);
    }
  });

  test(`${mode}: colours stand out from the ground`, () => {
    for (const ground of ["ground", "raised"]) {
      for (const [index, hex] of palette.entries()) {
        const found = contrast(hex, value(block, ground));
        assert.ok(found >= CONTRAST, `${index} on ${ground}: ${found.toFixed(2)}`);
      }
    }
  });
}
