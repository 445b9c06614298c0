// The player: a person's name on boards, and the data about them in a game.
import { html, useState } from "../ui.js";
import { Problem, key, remember, remembered } from "../api.js";
import { openKeyDialog } from "../parts/header.js";
import { ProblemNote } from "../parts/problem.js";
import { visible } from "../parts/text.js";

const NAME_CHARS_MAX = 200;

/** The name that was typed in this tab. */
export const playerName = () => remembered("player") ?? "human";

/** The `agent_meta` of people's seats. */
export const HUMAN = { kind: "human" };

/** The creation of a game or a run of which a person plays all seats. */
export const allSeats = () => ({ model: playerName(), agent_meta: { ...HUMAN, seats: "all" } });

/** Keeps the token of a game or a run whose creator plays all seats. Returns its id. @param {{id: string, swarm_token: string}} made */
export function holdAll({ id, swarm_token: token }) {
  for (const name of ["creator", "token"]) remember(`${name}:${id}`, token);
  return id;
}

/** The settings of a game as a query of the page `/play`, to play the like again. @param {any} config */
export const againQuery = (config) => ({
  task: config.task,
  num_agents: config.num_agents,
  side: config.width,
  max_round: config.max_round,
  clock: config.round_deadline_s,
  control: config.control,
});

/** The reason why a game or a seat was refused; most often a key is missing. @param {{problem: Error, what: string}} props */
export function Refused({ problem, what }) {
  if (!(problem instanceof Problem) || problem.status !== 401 || key()) return html`<${ProblemNote} problem=${problem} what=${what} />`;
  return html`<div class="problem" role="alert">
    <h2>This server needs a key for that</h2>
    <p>Its organizers give keys to people who start games and take seats. With a code of a seat you need none.</p>
    <p><button type="button" onClick=${openKeyDialog}>Enter a key</button></p>
  </div>`;
}

export function NameField() {
  const [name, setName] = useState(playerName());
  const change = (event) => {
    setName(event.target.value);
    const isSeen = visible(event.target.value) === event.target.value;
    event.target.setCustomValidity(isSeen ? "" : "Every character of the name has to be visible.");
    remember("player", event.target.value.trim() || null);
  };
  return html`<label class="field">Your name on boards
    <input value=${name} maxlength=${NAME_CHARS_MAX} autocomplete="nickname" onInput=${change} />
  </label>`;
}
