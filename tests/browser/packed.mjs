// Plays the game that comes with the pages, for the front page of a server without games, and writes static/assets/front/game.json:
// `npm run packed`, after a change of the rules, of replays, or of the player.
import { writeFile } from "node:fs/promises";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { hosted } from "./support/games.mjs";
import { Program } from "./support/program.mjs";

const TARGET = path.join(path.dirname(fileURLToPath(import.meta.url)), "../../static/assets/front/game.json");

/** What the front page draws of a state. */
const DRAWN = ["round", "score", "at", "gone", "loaded", "actions", "blocked"];

const program = await Program.start();
try {
  const id = await hosted(program, { task: "Foraging", seed: 27, max_round: 60 });
  const { states, metrics: _, episode: __, ...head } = await program.get(`/api/v1/episodes/${id}/replay`);
  const { model } = await program.get(`/api/v1/episodes/${id}`);
  const lines = states.map((state) => JSON.stringify(Object.fromEntries(DRAWN.filter((name) => name in state).map((name) => [name, state[name]]))));
  const text = `{"head":${JSON.stringify(head)},\n"summary":${JSON.stringify({ model })},\n"states":[\n${lines.join(",\n")}\n]}\n`;
  await writeFile(TARGET, text);
} finally {
  await program.stop();
}
