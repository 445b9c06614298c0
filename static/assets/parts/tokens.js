// What the creator of a run, or an organizer, can do to it: give its players new tokens, and end it.
import { html } from "../ui.js";
import { request, route, withQuery } from "../api.js";
import { Text, visible } from "./text.js";

/** @import { Act } from "./act.js" */

/**
 * New tokens of a run: one for each holder of a team, and none for players of the server.
 * @param {{id: string, model?: string, player?: string | null, holders?: any[]}} run
 * @param {(made: {swarm_token: string, holder?: string}) => void} made gets the token, which is shown once
 * @returns {Act[]}
 */
export function renewals({ id, model, player, holders = [] }, made) {
  const renewal = (/** @type {string | undefined} */ holder) => ({
    label: holder === undefined ? "New token" : `New token of ${visible(holder)}`,
    title: html`Replace the token of ${holder === undefined ? "the run of " : ""}<${Text} value=${holder ?? model} />?`,
    isDangerous: false,
    act: async () => made(await request(withQuery(route`/api/v1/runs/${id}/token`, { holder }), { method: "POST" })),
    text: "The earlier token is revoked at once: a player that uses it stops until it has the new one.",
  });
  if (holders.length > 0) return holders.filter((holder) => !holder.player).map(({ name }) => renewal(name));
  return player ? [] : [renewal(undefined)];
}

/** The end of a run before all its games are played. @param {{id: string}} run @returns {Act} */
export const ending = ({ id }) => ({
  label: "Abort",
  title: "Abort this run?",
  act: () => request(route`/api/v1/runs/${id}`, { method: "DELETE" }),
  text: "This ends it and its open games now. What was played stays, and counts; games that were never played count as 0. This cannot be taken back.",
});
