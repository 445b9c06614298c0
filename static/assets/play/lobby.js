// A held seat before the game starts: the missing players, and how to invite them.
import { html, useState } from "../ui.js";
import { onceKey, remembered, request, route } from "../api.js";
import { useLoaded, useTask } from "../parts/load.js";
import { HUMAN } from "./player.js";
import { ProblemNote } from "../parts/problem.js";
import { SeatTable } from "../parts/seats.js";
import { Countdown } from "../parts/time.js";

const AGAIN_MS = 3000;

/** @param {{id: string, token: string, summary: any, isLost: boolean}} props */
export function Lobby({ id, token, summary, isLost }) {
  const waits = summary?.status === "waiting";
  const read = async (/** @type {AbortSignal} */ signal) => (waits ? request(route`/api/v1/episodes/${id}/claims`, { token, signal }) : null);
  const claims = useLoaded(read, [id, waits], waits ? AGAIN_MS : undefined).value;
  const status = isLost ? "The server does not answer. It is asked again by itself." : "Loading …";
  if (!waits || !claims) return html`<h1>Play</h1><p role="status">${status}</p>`;
  const { open, seats } = claims;
  return html`<h1>${summary.task}: waiting for players</h1>
    <p role="status">
      ${open > 0
        ? html`<b class="number">${open}</b> of ${seats.length} seats ${open === 1 ? "is" : "are"} open. The game starts when each has a holder.`
        : "Every seat has a holder. The game starts when its creator starts it."}
    </p>
    <${Filled} config=${summary.config} createdAt=${summary.created_at} open=${open} />
    ${open > 0 ? html`<${Invite} id=${id} />` : html`<${Start} id=${id} />`}
    <${SeatTable} seats=${seats} />`;
}

/** @param {{config: any, createdAt: string, open: number}} props */
function Filled({ config, createdAt, open }) {
  if (open === 0 || config.fill_after_s === null) return null;
  const moment = new Date(new Date(createdAt).getTime() + config.fill_after_s * 1000).toISOString();
  return html`<p>Built-in players take the open seats <${Countdown} value=${moment} isAhead />.</p>`;
}

/** @param {{id: string}} props */
function Start({ id }) {
  const { problem, run } = useTask();
  const token = remembered(`creator:${id}`);
  if (!token) return null;
  const start = () => run(() => request(route`/api/v1/episodes/${id}/start`, { method: "POST", token }));
  return html`<p class="buttons"><button type="button" class="primary" onClick=${start}>Start</button></p>
    ${problem && html`<${ProblemNote} problem=${problem} />`}`;
}

/** @param {{id: string}} props */
function Invite({ id }) {
  const [code, setCode] = useState("");
  const { problem, run } = useTask();
  const address = location.origin + route`/play/${id}`;
  const make = async () => {
    const body = { model: "human", agent_meta: HUMAN };
    const claim = await request(route`/api/v1/episodes/${id}/claims`, { method: "POST", body, idempotencyKey: onceKey() });
    setCode(claim.seats[0].token);
  };
  return html`<h2>Invite others</h2>
    <p>On this page they take a seat: <a href=${address}>${address}</a></p>
    <p class="buttons">
      <button type="button" onClick=${() => run(make)}>Make a code for somebody without a key</button>
      ${code && html`<code class="foreign">${code}</code> <span class="muted">It is shown only now, and is for one seat.</span>`}
    </p>
    ${problem && html`<${ProblemNote} problem=${problem} />`}`;
}
