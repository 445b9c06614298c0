// The acts of an agent by round, with facts that its holder could not see: its hearers and speakers.
import { html } from "../ui.js";
import { actionOf, resultOf } from "../parts/actions.js";
import { Text } from "../parts/text.js";

/** The number of listed rounds, around the chosen one. */
const LISTED = 20;

/**
 * @param {{game: import("../parts/game.js").Game, agent: number, round: number, onRound: (round: number) => void,
 *   onAgent: (agent: number) => void}} props
 */
export function OwnRounds({ game, agent, round, onRound, onAgent }) {
  const rounds = game.last;
  const count = game.head.num_agents;
  const first = Math.floor(round / LISTED) * LISTED;
  const listed = Array.from({ length: Math.max(0, Math.min(LISTED, rounds - first)) }, (_, index) => first + index);
  return html`<div>
    <p class="buttons">
      <label
        >Agent
        <select value=${agent} onChange=${(/** @type {any} */ event) => onAgent(Number(event.target.value))}>
          ${Array.from({ length: count }, (_, number) => html`<option value=${number}>${number}</option>`)}
        </select></label
      >
      <button type="button" aria-disabled=${first === 0} onClick=${() => onRound(Math.max(0, first - LISTED))}>Earlier</button>
      <button type="button" aria-disabled=${first + LISTED >= rounds} onClick=${() => onRound(Math.min(rounds, first + LISTED))}>Later</button>
    </p>
    <div class="scroll" tabindex="0" role="region" aria-label="Rounds">
      <table>
        <thead>
          <tr>
            <th scope="col">Round</th>
            <th scope="col">Action</th>
            <th scope="col">Said, and who heard it</th>
            <th scope="col">Heard, and who said it</th>
          </tr>
        </thead>
        <tbody>
          ${listed.map(
            (listedRound) => html`<${OwnRound}
              key=${listedRound}
              next=${game.peek(listedRound + 1)}
              number=${listedRound}
              agent=${agent}
              isChosen=${listedRound === round}
              onRound=${onRound}
            />`,
          )}
        </tbody>
      </table>
    </div>
  </div>`;
}

/** @param {{next: import("../parts/game.js").State | null, number: number, agent: number, isChosen: boolean, onRound: (round: number) => void}} props */
function OwnRound({ next, number, agent, isChosen, onRound }) {
  if (!next) return html`<tr><th scope="row">${number}</th><td colspan="3" class="muted">…</td></tr>`;
  const result = resultOf(next, agent);
  const said = next.said?.find(({ from }) => from === agent);
  const hearers = (next.heard ?? []).filter(({ from, sent }) => from === agent && sent === undefined).flatMap(({ by }) => by);
  const heard = (next.heard ?? []).filter(({ by }) => by.includes(agent));
  return html`<tr aria-current=${isChosen ? "true" : undefined}>
    <th scope="row"><button type="button" onClick=${() => onRound(number)}>${number}</button></th>
    <td>${actionOf(next, agent)?.name}${result && html` <span class="muted">${result}</span>`}</td>
    <td>${said && html`“<${Text} value=${said.text} />” <span class="muted">${hearers.length > 0 ? `heard by ${hearers.join(", ")}` : "nobody heard it"}</span>`}</td>
    <td>
      ${heard.map(
        (one) => html`<div>
          <span class="muted">${one.from}${one.sent !== undefined && ` in round ${one.sent}`}:</span>
          ${" "}<${Text} value=${one.text ?? next.said?.find(({ from }) => from === one.from)?.text} />
        </div>`,
      )}
    </td>
  </tr>`;
}

