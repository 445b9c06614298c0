// A seat of a game, played by a person, who sees what the agent sees.
import { html, useEffect, useState } from "../ui.js";
import { Problem, remember, remembered, request, route } from "../api.js";
import { Part, useLoaded, useTask } from "../parts/load.js";
import { CODES_HELP } from "../parts/codes.js";
import { ProblemNote } from "../parts/problem.js";
import { hasManySeats, useSeat } from "../play/seat.js";
import { Clock, Turn } from "../play/turn.js";
import { spoken } from "../play/words.js";
import { EnterCode, TakeSeat } from "../play/take.js";
import { Lobby } from "../play/lobby.js";

/** @param {{id: string}} props of an episode, or of a run */
export function Page({ id }) {
  const name = `token:${id}`;
  const [token, setToken] = useState(remembered(name));
  /** @param {string | null} token */
  const change = (token) => {
    remember(name, token);
    setToken(token);
  };
  if (token) return html`<${Play} key=${token} id=${id} token=${token} leave=${() => change(null)} />`;
  return id.startsWith("run_") ? html`<h1>Play a run</h1><${EnterCode} id=${id} onToken=${change} />` : html`<${TakeSeat} id=${id} onToken=${change} />`;
}

/** @param {{id: string, token: string, leave: () => void}} props */
function Play({ id, token, leave }) {
  const seat = useSeat(token);
  const { obs, phase, problem } = seat;
  const episode = obs?.episode ?? (id.startsWith("run_") ? null : id);
  const read = async (/** @type {AbortSignal} */ signal) => (episode ? request(route`/api/v1/episodes/${episode}`, { token, signal }) : null);
  const summary = useLoaded(read, [episode, phase === "over"]).value;
  useTitle(obs, phase);

  if (phase === "failed") return html`<${Failed} problem=${problem} id=${id} leave=${leave} />`;
  if (phase === "over") return html`<${Part} read=${() => import("../play/afterwards.js")} name="Afterwards" props=${{ id, summary, obs, leave }} />`;
  if (phase === "loading" || (phase === "waiting" && summary?.status === "waiting")) {
    return html`<${Lobby} id=${id} token=${token} summary=${summary} isLost=${seat.isLost} />`;
  }
  if (!obs) return html`<h1>Play</h1><p role="status">None of your seats has to act now. This page waits for the next round.</p>`;
  return html`
    <${Top} seat=${seat} many=${hasManySeats(token)} config=${summary?.config} />
    <${Turn} seat=${seat} config=${summary?.config} onAct=${seat.act} />
    <${About} obs=${obs} control=${summary?.config.control} id=${id} leave=${leave} />
    <p class="unseen" role="status">${phase === "choose" ? spoken(obs, summary?.config) : ""}</p>
  `;
}

/** Tells in the tab's title whose turn it is. @param {any} obs @param {string} phase */
function useTitle(obs, phase) {
  useEffect(() => {
    const state = { choose: "Your turn", over: "Over", waiting: "Waiting" }[phase] ?? "Play";
    document.title = obs ? `${state} · round ${obs.round} · ${obs.task.name}` : "Play";
  }, [phase, obs?.round, obs?.episode]);
}

/** @param {{seat: any, many: boolean, config: any}} props */
function Top({ seat, many, config }) {
  const { obs, phase, seenAt } = seat;
  const of = many && config ? ` of ${config.num_agents}` : "";
  return html`<div class="top-line">
    <h1>${obs.task.name} <span class="muted">${obs.agent.replace("_", " ")}${of}</span></h1>
    <dl class="readings">
      <div><dt>Round</dt><dd class="number">${obs.round} of ${obs.max_round}</dd></div>
      <div><dt>Score of the swarm</dt><dd class="number">${obs.score.toFixed(2)}</dd></div>
      <div>
        <dt>${phase === "choose" ? "Your turn" : obs.alive ? "Sent" : "Gone"}</dt>
        <dd>${phase === "choose" && obs.remaining_ms === null ? "no clock" : html`<${Clock} obs=${obs} seenAt=${seenAt} isOpen=${phase === "choose"} />`}</dd>
      </div>
    </dl>
  </div>`;
}

/** What is drawn in the place of the marks ($) that a task's description speaks of. @type {Record<string, string>} */
const SIGNS_HELP = {
  Synchronization: "A dashed ring is a light that is on, a hollow number one that is off, whatever the mark ($) of the text above means.",
  Foraging: "A dashed ring is an agent that carries food, whatever the mark ($) of the text above means.",
};

/** @param {{obs: any, control?: string, id: string, leave: () => void}} props */
function About({ obs, control, id, leave }) {
  return html`<details open=${obs.round === 0}>
    <summary>The task, and what the signs mean</summary>
    <p>${obs.task.description}</p>
    ${control === "centralized" &&
    html`<p>
      ${obs.agent === "Agent_0"
        ? "You are the commander: you hear all agents, and your message goes to one of them or to all."
        : "Only the commander, agent 0, hears you, and you hear only the commander."}
    </p>`}
    <p>
      <b>me</b> is your agent, a number another one. Crossed lines are outside of the map, grey is wall. Rows count downwards, columns
      to the right. ${SIGNS_HELP[obs.task.name] ?? ""}
    </p>
    <p>An action is sent at once, with the message. Keys: arrows, <kbd>S</kbd> stays, <kbd>M</kbd> goes to the message, <kbd>Enter</kbd> or <kbd>Esc</kbd> leaves it. ${CODES_HELP}</p>
    <p class="buttons">
      <a href="/play">Other games</a>
      <${Abort} id=${id} />
      <button type="button" class="quiet" onClick=${leave}>Forget this seat in this tab</button>
    </p>
  </details>`;
}

/** Ends a game that was created in this tab. @param {{id: string}} props */
function Abort({ id }) {
  const { problem, isBusy, run } = useTask();
  const [asked, setAsked] = useState(false);
  const token = remembered(`creator:${id}`);
  if (!token) return null;
  const abort = () => {
    setAsked(false);
    run(() => request(id.startsWith("run_") ? route`/api/v1/runs/${id}` : route`/api/v1/episodes/${id}`, { method: "DELETE", token }));
  };
  if (problem) return html`<${ProblemNote} problem=${problem} />`;
  if (isBusy) return html`<span role="status">The game is being ended …</span>`;
  return asked
    ? html`<span>End it for everybody?</span> <button type="button" class="danger" onClick=${abort}>End the game</button>
        <button type="button" onClick=${() => setAsked(false)}>Play on</button>`
    : html`<button type="button" onClick=${() => setAsked(true)}>End the game …</button>`;
}

/** @param {{problem: Error, id: string, leave: () => void}} props */
function Failed({ problem, id, leave }) {
  if (!(problem instanceof Problem) || problem.status !== 401) return html`<h1>Play</h1><${ProblemNote} problem=${problem} />`;
  return html`<h1>This seat is no longer yours</h1>
    <p>
      The server does not accept the token of your seat any more. It was replaced or revoked, or the game was deleted. What you did
      stays in the game.
    </p>
    <p class="buttons">
      <button type="button" class="primary" onClick=${leave}>Take a seat again</button>
      <a href=${route`/episodes/${id}`}>The game</a> <a href="/play">Other games</a>
    </p>`;
}
