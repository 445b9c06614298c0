// The seats of a game before one is held, and the two ways to get one.
import { html, submits, useRef } from "../ui.js";
import { visit } from "../app.js";
import { onceKey, remember, request, route, tokenOf } from "../api.js";
import { Loaded, useLoaded, useTask } from "../parts/load.js";
import { HUMAN, NameField, Refused, playerName } from "./player.js";
import { ProblemNote } from "../parts/problem.js";
import { SeatTable } from "../parts/seats.js";
import { Text } from "../parts/text.js";

const AGAIN_MS = 3000;

/** @param {{id: string, onToken: (token: string) => void}} props */
export function TakeSeat({ id, onToken }) {
  const read = async (/** @type {AbortSignal} */ signal) => {
    const game = route`/api/v1/episodes/${id}`;
    const [summary, claims] = await Promise.all([game, `${game}/claims`].map((path) => request(path, { token: tokenOf(id), signal })));
    return { summary, claims };
  };
  const loaded = useLoaded(read, [id], AGAIN_MS);
  return html`<h1>${loaded.value ? `${loaded.value.summary.task}: take a seat` : "Play"}</h1>
    <${Loaded} of=${loaded}>${({ summary, claims }) => html`
      <${What} summary=${summary} open=${claims.open} id=${id} />
      ${claims.open > 0 && html`<${Claim} id=${id} claims=${claims} onToken=${onToken} onRefused=${loaded.reload} />`}`}<//>
    <${EnterCode} id=${id} onToken=${onToken} />`;
}

/** @param {{summary: any, open: number, id: string}} props */
function What({ summary, open, id }) {
  const { config } = summary;
  const clock = config.round_deadline_s ? `${config.round_deadline_s} s a round` : "no clock";
  const game = html`<a href=${route`/episodes/${id}`}>the game</a>`;
  return html`<p>
      ${config.num_agents} agents on ${config.width} × ${config.height} cells, ${config.max_round} rounds, ${clock}. Created by
      ${" "}<${Text} value=${summary.model} />.
    </p>
    ${open === 0 &&
    html`<p>
      ${["waiting", "running"].includes(summary.status)
        ? html`Every seat has a holder: you can only watch ${game}, or <a href="/play">play another one</a>.`
        : html`This game is over. Look at ${game}, or <a href="/play">play another one</a>.`}
    </p>`}`;
}

/** @param {{id: string, claims: any, onToken: (token: string) => void, onRefused: () => void}} props */
function Claim({ id, claims, onToken, onRefused }) {
  const { problem, isBusy, run } = useTask();
  const once = useRef(onceKey());
  const claim = (/** @type {string} */ agent = "") => run(async () => {
    try {
      onToken(await claimSeat(id, agent, once.current));
    } catch (error) {
      once.current = onceKey();
      onRefused();
      throw error;
    }
  });
  return html`<form onSubmit=${submits(() => claim())}>
      <${NameField} />
      <p><button type="submit" class="primary" aria-disabled=${isBusy}>Take ${claims.open === 1 ? "the open seat" : "any open seat"}</button></p>
    </form>
    ${problem && html`<${Refused} problem=${problem} what="The seat" />`}
    <details>
      <summary>${claims.open} of ${claims.seats.length} seats ${claims.open === 1 ? "is" : "are"} open: choose one</summary>
      <${SeatTable} seats=${claims.seats} onTake=${claim} />
    </details>`;
}

/** Takes a seat for a person, and returns its token. @param {string} id @param {string} agent any where it is empty @param {string} idempotencyKey */
export async function claimSeat(id, agent, idempotencyKey) {
  const body = { model: playerName(), agent_meta: HUMAN, ...(agent ? { agent } : {}) };
  const { seats: [seat] } = await request(route`/api/v1/episodes/${id}/claims`, { method: "POST", body, idempotencyKey });
  remember(`token:${id}`, seat.token);
  return seat.token;
}

/**
 * A seat that another person claimed for this visitor.
 * @param {{id?: string, onToken?: (token: string) => void}} props id: the game that is shown, if there is one
 */
export function EnterCode({ id, onToken }) {
  const input = useRef(/** @type {HTMLInputElement | null} */ (null));
  const { problem, run } = useTask();
  const enter = async () => {
    const token = input.current?.value.trim();
    if (!token) return;
    const found = (await episodeOf(token)) ?? id;
    if (onToken && (found === id || id?.startsWith("run_"))) return onToken(token);
    if (!found) throw new Error("No seat of this code has to act now. Open the page of its game, and enter it there.");
    remember(`token:${found}`, token);
    visit(route`/play/${found}`);
  };
  return html`<form onSubmit=${submits(() => run(enter))} class="code">
    <h2>You were given a code?</h2>
    <label class="field">Code of a seat (<code>seat_…</code> or <code>swarm_…</code>)
      <input ref=${input} type="password" autocomplete="off" spellcheck="false" />
    </label>
    <p class="muted small">It stays in this tab, and is forgotten when the tab is closed.</p>
    <p><button type="submit">Play with this code</button></p>
    ${problem && html`<${ProblemNote} problem=${problem} what="The code" />`}
  </form>`;
}

/** The game of a token, if it says one; a token that the server does not accept is a problem. @param {string} token */
async function episodeOf(token) {
  if (token.startsWith("seat_")) return (await request("/obs", { token })).episode;
  const { observations } = await request("/swarm/obs?limit=1", { token });
  return observations[0]?.episode;
}
