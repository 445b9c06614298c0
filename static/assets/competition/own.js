// Changes that an entrant makes to itself, with its key.
import { html, useState } from "../ui.js";
import { Problem, key, remember, request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { Form } from "../parts/form.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { Team } from "../parts/team.js";
import { Text, visible } from "../parts/text.js";
import { Accepted } from "./terms.js";

/** The warning before an entrant is erased. */
export const ErasingText = () => html`
  <p>
    Erased are the name, the contact, the address from which it entered, the label of its invitation code, and the keys that were made for it and its team, which are not
    accepted any more. Before the end the entrant is also withdrawn: its games end, it has no rank, and why it had left is erased, too.
  </p>
  <p>
    What stays: the journals of its games, with the model and all answers; the heads of their chains; and files that were published
    already, or are published once a competition is over, with the name that they have then.
  </p>
  <p>It cannot return to this competition, and nobody can undo this.</p>
`;

/** The contact of an entrant. @type {import("../parts/form.js").Field} */
export const CONTACT_FIELD = { name: "contact", label: "Contact", max: 200, placeholder: "an address of mail, for instance", help: "How organizers reach you. Only they see it, and your team." };

/**
 * The entrants of the key of this tab, one at a time.
 * @param {{competition: any, entrants: any[], changed: () => void, erased: (name: string) => void}} props
 */
export function OwnEntrant({ competition, entrants, changed, erased }) {
  const [chosen, setChosen] = useState("");
  const one = entrants.find(({ id }) => id === chosen) ?? entrants[0];
  if (!one) return null;
  return html`<details open>
    <summary>Change my entrant</summary>
    ${entrants.length > 1 &&
    html`<p><label>Entrant <select value=${one.id} onChange=${(/** @type {any} */ event) => setChosen(event.target.value)}>
      ${entrants.map(({ id, name }) => html`<option value=${id}>${visible(name)}</option>`)}
    </select></label></p>`}
    <${Own} key=${one.id} competition=${competition} one=${one} changed=${changed} erased=${erased} />
  </details>`;
}

/** @typedef {{competition: any, one: any, path: string, changed: () => void, erased: (name: string) => void}} Props path: of the entrant */

/** @param {Omit<Props, "path">} props */
function Own(props) {
  const { competition, one, changed } = props;
  const { terms } = competition;
  const path = route`/api/v1/competitions/${competition.id}/entrants/${one.id}`;
  const isOver = Boolean(competition.revealed_at || competition.cancelled_at);
  const badges = [one.category, one.status !== "active" && one.status, one.erased && "erased"].filter(Boolean);
  return html`
    <p><strong><${Text} value=${one.name} /></strong>${badges.map((badge) => html` <span class="badge"><${Text} value=${badge} /></span>`)}</p>
    ${!one.erased &&
    html`${terms && html`<${Accepted} terms=${terms} one=${one} path=${path} mayAccept=${!isOver && one.status !== "disqualified"} changed=${changed} />`}
      ${one.status !== "disqualified" && html`<${Declared} ...${props} path=${path} isOver=${isOver} />`}
      <${Team} path=${path} mayAdd=${!isOver && one.status === "active"} />
      <${Leave} ...${props} path=${path} isOver=${isOver} />`}
  `;
}

/** @param {string} name @returns {import("../parts/form.js").Field[]} */
const nameFields = (name) => [{ name: "name", label: "Name on the board", isRequired: true, max: 100, initial: name }];

/** @param {string} contact @returns {import("../parts/form.js").Field[]} */
const contactFields = (contact) => [{ ...CONTACT_FIELD, initial: contact }];

/** The entrant's name and contact. @param {Props & {isOver: boolean}} props */
function Declared({ one, path, isOver, changed }) {
  const { value, problem, reload } = useLoaded((signal) => request(path, { signal }), [path]);
  const [note, setNote] = useState("");
  const change = async (/** @type {Record<string, string>} */ body, /** @type {string} */ said) => {
    setNote("");
    const now = await request(path, { method: "PATCH", body });
    setNote(said);
    changed();
    return now;
  };
  /** @param {{name: string}} body */
  const rename = async (body) => nameFields((await change(body, "The name was changed.")).name);
  /** @param {{contact?: string}} body nothing where it is removed */
  const reach = async ({ contact = "" }) => {
    await change({ contact }, contact ? "The contact was changed." : "The contact was removed.");
    return contactFields(contact);
  };
  return html`
    ${!isOver && html`<${Form} fields=${nameFields(one.name)} label="Change the name" send=${rename} />`}
    ${problem && !value && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    ${value && html`<${Form} fields=${contactFields(value.contact ?? "")} label="Change the contact" send=${reach} />`}
    <p class="good" role="status">${note}</p>`;
}

/** @param {Props & {isOver: boolean}} props */
function Leave({ competition, one, path, isOver, changed, erased }) {
  const name = html`<${Text} value=${one.name} />`;
  const withdraw = (/** @type {string} */ reason) => request(path, { method: "PATCH", body: { status: "withdrawn", ...(reason && { reason }) } });
  const erase = async () => {
    await request(path, { method: "DELETE" });
    erased(one.name);
    await forgetRefusedKey(competition.id);
    changed();
  };
  return html`<p class="buttons">
    ${one.status === "active" &&
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
