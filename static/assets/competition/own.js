// What an entrant changes about itself, with its key.
import { html, useState } from "../ui.js";
import { Problem, key, remember, remembered, request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { Form } from "../parts/form.js";
import { Text, visible } from "../parts/text.js";

/** What stays when an entrant is erased, and that there is no way back. */
export const ErasingText = () => html`
  <p>
    Erased are the name, the address from which it entered, and the key that was made for it, which is not accepted any more. Before
    the end the entrant is also withdrawn: it has no rank.
  </p>
  <p>
    What stays: the journals of its games, with the model and all answers; the heads of their chains; and files that were published
    already, or are published once a competition is over, with the name that they have then.
  </p>
  <p>It cannot return to this competition, and nobody can undo this.</p>
`;

/** The entrant that entered in this tab. @param {string} competition */
const nameOfPlace = (competition) => `entrant:${competition}`;

/** @param {string} competition @param {string} entrant */
export const rememberEntrant = (competition, entrant) => remember(nameOfPlace(competition), entrant);

/**
 * The entrants of the key of this tab: those with attempts, and who entered in this tab. Others are found by their name.
 * @param {{competition: any, started: string[], entrants: any[], changed: () => void, erased: (name: string) => void}} props
 *   started: ids of entrants with attempts; entrants: those that are loaded
 */
export function OwnEntrant({ competition, started, entrants, changed, erased }) {
  const found = remembered(nameOfPlace(competition.id));
  const [chosen, setChosen] = useState("");
  const ids = [...new Set([...(found ? [found] : []), ...started])];
  const known = ids.map((id) => entrants.find((one) => one.id === id)).filter(Boolean);
  const one = known.find(({ id }) => id === chosen) ?? known[0];
  /** @param {{entrant: string}} body */
  const find = async ({ entrant }) => {
    const id = entrants.find((one) => one.name === entrant)?.id ?? entrant;
    await request(route`/api/v1/competitions/${competition.id}/entrants/${id}`);
    rememberEntrant(competition.id, id);
    setChosen(id);
  };
  return html`<details open=${known.length > 0}>
    <summary>Change my entrant</summary>
    ${known.length > 1 &&
    html`<p><label>Entrant <select value=${one.id} onChange=${(/** @type {any} */ event) => setChosen(event.target.value)}>
      ${known.map(({ id, name }) => html`<option value=${id}>${visible(name)}</option>`)}
    </select></label></p>`}
    ${one
      ? html`<${Changes} key=${one.id} competition=${competition} one=${one} changed=${changed} erased=${erased} />`
      : html`<p class="muted">An entrant with attempts is found by the key. Before its first attempt, say which one it is.</p>
          <${Form} fields=${FIND_FIELDS} label="Find my entrant" send=${find} />`}
  </details>`;
}

/** @type {import("../parts/form.js").Field[]} */
const FIND_FIELDS = [{ name: "entrant", label: "Its name on the board, or its id", isRequired: true }];

/** @param {string} name @returns {import("../parts/form.js").Field[]} */
const nameFields = (name) => [{ name: "name", label: "Name on the board", isRequired: true, max: 100, initial: name }];

/** @param {{competition: any, one: any, changed: () => void, erased: (name: string) => void}} props */
function Changes({ competition, one, changed, erased }) {
  const [note, setNote] = useState("");
  const path = route`/api/v1/competitions/${competition.id}/entrants/${one.id}`;
  const isOver = Boolean(competition.revealed_at || competition.cancelled_at);
  const isActive = one.status === "active";
  const name = html`<${Text} value=${one.name} />`;
  /** @param {{name: string}} body */
  const rename = async (body) => {
    setNote("");
    const now = await request(path, { method: "PATCH", body });
    setNote("The name was changed.");
    changed();
    return nameFields(now.name);
  };
  const withdraw = (/** @type {string} */ reason) => request(path, { method: "PATCH", body: { status: "withdrawn", ...(reason && { reason }) } });
  const erase = async () => {
    await request(path, { method: "DELETE" });
    remember(nameOfPlace(competition.id), null);
    erased(one.name);
    await forgetRefusedKey(competition.id);
    changed();
  };
  return html`
    <p><strong>${name}</strong> ${!isActive && html`<span class="badge">${one.status}</span>`}</p>
    ${!isOver && one.status !== "disqualified" && html`<${Form} fields=${nameFields(one.name)} label="Change the name" send=${rename} />`}
    <p class="good" role="status">${note}</p>
    <p class="buttons">
      ${isActive &&
      !isOver &&
      html`<${ActButton} label="Withdraw" of=${visible(one.name)} title=${html`Withdraw ${name}?`} reason="optional" done=${changed} act=${withdraw}>
        <p>It starts no more attempts, and stays on the board without a rank. Only an organizer can take it back.</p>
      <//>`}
      <${ActButton} label="Erase" of=${visible(one.name)} title=${html`Erase ${name}?`} dismiss="Keep it" act=${erase}><${ErasingText} /><//>
    </p>`;
}

/** A key that was made for the entrant is good for nothing any more; others stay. @param {string} competition */
async function forgetRefusedKey(competition) {
  if (!key()) return;
  try {
    await request(route`/api/v1/competitions/${competition}/attempts?limit=1`);
  } catch (error) {
    if (error instanceof Problem && error.status === 401) remember("key", null);
  }
}
