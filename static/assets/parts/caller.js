// Whose key this tab has.
import { key, request } from "../api.js";

/** @typedef {"organizer" | "judge" | "other" | "none"} Role other: of an entrant or a member */
/** @typedef {{role: Role, name?: string, expires_at?: string | null}} Holder of the key, or of none */

/** The holders of keys that were asked for: each answer is for the whole visit. @type {Map<string, Promise<Holder>>} */
const known = new Map();

/** @returns {Promise<Holder>} */
export function holder() {
  const own = key();
  if (!own) return Promise.resolve({ role: "none" });
  const asked = known.get(own) ?? request("/api/v1/keys/self").then((found) => ({ ...found, role: found.role === "organizer" || found.role === "judge" ? found.role : "other" }));
  known.set(own, asked);
  // A key that the server did not answer for is asked for again.
  asked.catch(() => known.delete(own));
  return asked;
}
