// The place in a game, kept in the address: #r=37&a=5&p=prompt.
import { useEffect, useReducer, useWindowEvent } from "../ui.js";

/** The panels of an agent, with their names. @type {Record<string, string>} */
export const PANELS = { window: "Window", inbox: "Inbox", prompt: "Prompt", answer: "Answer", reasoning: "Reasoning" };

/** The pause after a change before the address is written: browsers limit the rate. */
const WRITE_MS = 250;

/** @typedef {{round: number | null, agent: number | null, panel: string}} Place a round of null is the newest one */

/** @param {string} hash @returns {Place} */
function readPlace(hash) {
  const fields = new URLSearchParams(hash.replace(/^#/, ""));
  /** @param {string} name */
  const number = (name) => (/^\d{1,6}$/.test(fields.get(name) ?? "") ? Number(fields.get(name)) : null);
  const panel = fields.get("p") ?? "";
  return { round: number("r"), agent: number("a"), panel: Object.hasOwn(PANELS, panel) ? panel : "window" };
}

/** @param {Place} place */
function writePlace({ round, agent, panel }) {
  const fields = [round !== null && `r=${round}`, agent !== null && `a=${agent}`, panel !== "window" && `p=${panel}`].filter(Boolean);
  return fields.length ? `#${fields.join("&")}` : "";
}

/** The link to a place on this page: the address bar follows later than the page. @param {Place} place */
export const linkTo = (place) => location.origin + location.pathname + location.search + writePlace(place);

/** The place in the address, and a function that changes parts of it. @returns {[Place, (change: Partial<Place>) => void]} */
export function usePlace() {
  const [place, change] = useReducer((/** @type {Place} */ place, /** @type {Partial<Place>} */ change) => ({ ...place, ...change }), readPlace(location.hash));
  useWindowEvent("hashchange", () => change(readPlace(location.hash)));
  useEffect(() => {
    const { pathname } = location;
    const timer = setTimeout(() => {
      const hash = writePlace(place);
      // A link that was followed meanwhile has a place of its own.
      if (location.pathname === pathname && hash !== location.hash) history.replaceState(history.state, "", hash || pathname + location.search);
    }, WRITE_MS);
    return () => clearTimeout(timer);
  }, [place]);
  return [place, change];
}
