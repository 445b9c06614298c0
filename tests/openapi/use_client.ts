// Plays a game with the types that openapi-typescript makes, and reads one answer of every kind of body. Compiled and run by
// .ci/openapi: SWARMBENCH_URL=http://127.0.0.1:8080 node use_client.js
import createClient from "openapi-fetch";
import type { components, paths } from "./swarmbench.js";

const baseUrl = process.env.SWARMBENCH_URL!;
const anyone = createClient<paths>({ baseUrl });

function check(what: string, holds: boolean): void {
  if (!holds) throw new Error(what);
}

const settings = { task: "Synchronization", num_agents: 1, max_round: 5, seed: 27, model: "generated" } as const;
const { data: created } = await anyone.POST("/api/v1/episodes", { body: settings });
if (!created) throw new Error("nothing was created");
const path = { id: created.id };
const seat = createClient<paths>({ baseUrl, headers: { Authorization: `Bearer ${created.seats[0].token}` } });

async function look(): Promise<components["schemas"]["Observation"]> {
  const { data, error } = await seat.GET("/obs");
  if (!data) throw new Error(error.detail);
  return data;
}

let seen = await look();
while (seen.status === "running") {
  await seat.POST("/act", { body: { round: seen.round, action: "SWITCH" } });
  seen = await look();
}
check("the score", seen.score === 5);

const { error } = await seat.POST("/act", { body: { round: 4, action: "UP" } });
check("the refusal", error?.code === "already_acted");
// @ts-expect-error A round is a number.
const { error: wrong } = await seat.POST("/act", { body: { round: "4", action: "SWITCH" } });
check("the malformed body", wrong?.code === "invalid" || wrong?.code === "malformed");

const file = { params: { path: { file: "acts.parquet" } }, parseAs: "arrayBuffer" } as const;
const { data: table } = await anyone.GET("/api/v1/exports/{file}", file);
check("Parquet", new TextDecoder().decode(table?.slice(0, 4)) === "PAR1");
const { data: journal } = await anyone.GET("/api/v1/episodes/{id}/journal", { params: { path }, parseAs: "text" });
check("JSON Lines", journal?.split("\n").length === 8);
const csv = { params: { query: { format: "csv" } }, parseAs: "text" } as const;
const { data: board } = await anyone.GET("/api/v1/leaderboard", csv);
check("CSV", board?.startsWith("suite,") === true);
console.log("a game, refusals, Parquet, JSON Lines and CSV");
