// The holders of seats.
import { html } from "../ui.js";
import { Text } from "../parts/text.js";

/** @param {{seats: any[], onTake?: (agent: string) => void}} props */
export const SeatTable = ({ seats, onTake }) => html`<div class="scroll" tabindex="0" role="region" aria-label="Seats">
  <table>
    <thead>
      <tr><th scope="col">Agent</th><th scope="col">Player</th><th scope="col">Holder</th></tr>
    </thead>
    <tbody>
      ${seats.map(
        (seat) => html`<tr key=${seat.agent}>
          <th scope="row">${seat.agent.replace("_", " ")}</th>
          ${seat.claim === null
            ? html`<td>
                  ${onTake
                    ? html`<button type="button" aria-label=${`Take the seat of ${seat.agent}`} onClick=${() => onTake(seat.agent)}>Take it</button>`
                    : html`<span class="muted">open</span>`}
                </td>
                <td></td>`
            : html`<td><${Text} value=${seat.player ? `built-in/${seat.player}` : seat.model} /></td>
                <td>${seat.holder === "server" ? "this server" : seat.holder && html`<${Text} value=${seat.holder} />`}</td>`}
        </tr>`,
      )}
    </tbody>
  </table>
</div>`;
