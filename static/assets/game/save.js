// Pictures and links that leave the page.
import { save } from "../parts/download.js";

/** Properties of shapes that come from style sheets, which a saved file lacks. */
const DRAWN = ["fill", "stroke", "stroke-width", "stroke-dasharray", "opacity", "font-family", "font-size", "font-weight", "text-anchor", "transform"];

/** The map as it is drawn now: an SVG, or a PNG of a large one. @param {string} name */
export async function savePicture(name) {
  const map = document.querySelector(".map");
  if (map instanceof HTMLCanvasElement) {
    const blob = await new Promise((resolve) => map.toBlob(resolve));
    if (blob) save(blob, `${name}.png`);
  } else if (map instanceof SVGSVGElement) {
    save(new Blob([standalone(map)], { type: "image/svg+xml" }), `${name}.svg`);
  }
}

/** @param {SVGSVGElement} map */
function standalone(map) {
  const copy = /** @type {SVGSVGElement} */ (map.cloneNode(true));
  const [from, to] = [map.querySelectorAll("*"), copy.querySelectorAll("*")];
  from.forEach((element, index) => {
    const style = getComputedStyle(element);
    for (const property of DRAWN) {
      const value = style.getPropertyValue(property);
      if (property === "transform" ? value !== "none" && !to[index].hasAttribute("transform") : value) to[index].setAttribute(property, value);
    }
    to[index].removeAttribute("style");
    to[index].removeAttribute("class");
  });
  const { width, height } = map.viewBox.baseVal;
  copy.setAttribute("width", String(width * 2));
  copy.setAttribute("height", String(height * 2));
  copy.removeAttribute("class");
  return new XMLSerializer().serializeToString(copy);
}

/** Copies a text; false where the browser does not allow it. @param {string} text */
export async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return false;
  }
}
