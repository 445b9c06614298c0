// The holders of a game's seats.
import { html } from "../ui.js";
import { request, route } from "../api.js";
import { Items } from "./listed.js";
import { Loaded, useLoaded } from "./load.js";
import { Text } from "./text.js";

/** The maximum number of seats that are listed. */
const LISTED_MAX = 1024;

/** @param {{seats: any[], onTake?: (agent: string) => void}} props */
export function SeatTable({ seats, onTake }) {
  const player = ({ agent, claim, player, model }) => {
    if (claim !== null) return html`<${Text} value=${player ? `built-in/${player}` : model} />`;
    if (!onTake) return html`<span class="muted">open</span>`;
    return html`<button type="button" aria-label=${`Take the seat of ${agent}`} onClick=${() => onTake(agent)}>Take it</button>`;
  };
  const columns = [
    ["Agent", ({ agent }) => agent.replace("_", " ")],
    ["Player", player],
    seats.some(({ holder, claim }) => holder || claim === 0) && ["Holder", ({ holder, claim }) => (holder === "server" ? "this server" : html`<${Text} value=${holder ?? (claim === 0 ? "creator" : "")} />`)],
  ];
  return html`<${Items} label="Seats" columns=${columns} items=${seats.slice(0, LISTED_MAX)} keyOf=${({ agent }) => agent} />`;
}

/** Who plays the seats of a game. @param {{game: import("../game/about.js").Shown}} props */
export function Seats({ game: { head } }) {
  const claims = useLoaded((signal) => request(route`/api/v1/episodes/${head.id}/claims`, { signal }), [head.id, head.status], head.status === "waiting" ? 5000 : undefined);
  return html`<h2>Seats</h2>
    <${Loaded} of=${claims}>
      ${({ open, seats }) => html`
        ${open > 0 && html`<p>${open} ${open === 1 ? "seat is" : "seats are"} open. <a href=${route`/play/${head.id}`}>Take a seat</a>.</p>`}
        <${SeatTable} seats=${seats} />`}
    <//>`;
}
