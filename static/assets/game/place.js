// The place in a game, kept in the address: #r=37&a=5&p=prompt.
import { useEffect, useReducer } from "../ui.js";

/** The panels of an agent. */
export const PANELS = /** @type {const} */ (["window", "inbox", "prompt", "answer", "reasoning"]);

/** The pause after a change before the address is written: browsers limit the rate. */
const WRITE_MS = 250;

/**
 * @typedef {{round: number | null, agent: number | null, panel: string}} Place a round of null is the newest one
 */

/** @param {string} hash @returns {Place} */
export function readPlace(hash) {
  const fields = new URLSearchParams(hash.replace(/^#/, ""));
  /** @param {string} name */
  const number = (name) => (/^\d{1,6}$/.test(fields.get(name) ?? "") ? Number(fields.get(name)) : null);
  const panel = fields.get("p") ?? "";
  return { round: number("r"), agent: number("a"), panel: PANELS.includes(/** @type {any} */ (panel)) ? panel : "window" };
}

/** @param {Place} place */
export function writePlace({ round, agent, panel }) {
  const fields = [];
  if (round !== null) fields.push(`r=${round}`);
  if (agent !== null) fields.push(`a=${agent}`);
  if (panel !== "window") fields.push(`p=${panel}`);
  return fields.length ? `#${fields.join("&")}` : "";
}

/**
 * The place in the address, and a function that changes parts of it.
 * @returns {[Place, (change: Partial<Place>) => void]}
 */
export function usePlace() {
  const [place, change] = useReducer((/** @type {Place} */ place, /** @type {Partial<Place>} */ change) => ({ ...place, ...change }), readPlace(location.hash));
  useEffect(() => {
    const changed = () => change(readPlace(location.hash));
    addEventListener("hashchange", changed);
    return () => removeEventListener("hashchange", changed);
  }, []);
  useEffect(() => {
    const timer = setTimeout(() => {
      const hash = writePlace(place);
      if (hash !== location.hash) history.replaceState(history.state, "", hash || location.pathname + location.search);
    }, WRITE_MS);
    return () => clearTimeout(timer);
  }, [place]);
  return [place, change];
}
