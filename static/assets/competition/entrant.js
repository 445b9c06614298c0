// An entrant by itself: entering a competition, accepting its terms, and changing, withdrawing or erasing an entrant with its key.
import { html } from "../ui.js";
import { Problem, key, remember, request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { Form } from "../parts/form.js";
import { DECLARED_FIELDS, SAMPLING_FIELDS } from "../parts/inputs.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { Team } from "../parts/team.js";
import { visible } from "../parts/text.js";
import { Prose } from "./about.js";

/** @typedef {import("../parts/form.js").Field} Field */

/** The contact of an entrant. @param {string} [initial] @returns {Field} */
const contactField = (initial) => ({ name: "contact", label: "Contact", max: 200, placeholder: "an address of mail, for instance", help: "How organizers reach you. Only they see it, and your team.", initial });

/** @param {any} competition @param {boolean} hasKey @returns {(Field | import("../parts/form.js").Group | false)[]} */
const entryFields = ({ entry, categories, terms }, hasKey) => [
  { name: "name", label: "Name on the board", isRequired: true, max: 100 },
  { name: "model", label: "Model", isRequired: true, max: 200, help: "It never changes. Another model is another entrant." },
  categories.length > 0 && {
    ...{ name: "category", label: "Category", kind: "choice", isRequired: true, help: "Later only an organizer moves it to another one." },
    options: [["", "choose one"], ...categories.map((name) => /** @type {[string, string]} */ ([name, visible(name)]))],
  },
  contactField(),
  entry === "codes" && { name: "code", label: "Invitation code", kind: "secret", isRequired: true, help: "From the organizer. It is valid for one entrant." },
  hasKey && { name: "own_key", label: "Make a new key for this entrant", kind: "check", help: "Otherwise it is entered with the key of this tab." },
  { legend: "More about the player", isFolded: true, fields: [...SAMPLING_FIELDS, ...DECLARED_FIELDS] },
  // A tick is for one version: another version must be read first.
  terms && {
    ...{ name: "accepts_terms", key: `terms ${terms.version}`, label: `I accept the terms, version ${terms.version}`, kind: "check" },
    ...{ isRequired: true, help: "They are above this form." },
  },
];

/** The form that enters a competition. @param {{competition: any, entered: (made: any) => void, reload: () => void}} props reload: of the competition */
export function Entry({ competition, entered, reload }) {
  const hasKey = Boolean(key());
  const { terms } = competition;
  /** Terms that have changed meanwhile are shown, to be read. @param {unknown} error @returns {never} */
  const refused = (error) => {
    if (error instanceof Problem && error.fields.some(({ field }) => field === "accepts_terms")) reload();
    throw error;
  };
  const send = async (/** @type {any} */ { own_key, accepts_terms, ...declared }) => {
    const body = { ...declared, ...(accepts_terms && { accepts_terms: terms.version }) };
    const token = own_key ? null : key();
    entered(await request(route`/api/v1/competitions/${competition.id}/entrants`, { method: "POST", body, token }).catch(refused));
  };
  return html`
    <p class="muted">
      Everybody can read the name, the model and what else you declare, but not the contact. With its key an entrant can
      change its name and its contact, withdraw, and erase itself.
    </p>
    <details class="small"><summary>What is erased, and what stays</summary><${ErasingText} /></details>
    ${terms && html`<p><strong>Terms, version ${terms.version}</strong></p><${Prose} text=${terms.text} label="The terms to accept" />`}
    <${Form} key=${String(hasKey)} fields=${entryFields(competition, hasKey).filter(Boolean)} label="Enter the competition" send=${send} />`;
}

/** The warning before an entrant is erased. */
const ErasingText = () => html`
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

/** @typedef {{competition: any, one: any, changed: () => void, erased: (name: string) => void}} Props one: an entrant of the key of this tab */

/** @param {any} competition @param {any} one */
const pathOf = (competition, one) => route`/api/v1/competitions/${competition.id}/entrants/${one.id}`;

/** @param {any} competition */
const isOver = (competition) => Boolean(competition.revealed_at || competition.cancelled_at);

/** The version of the terms that an entrant has accepted, and a button that accepts a newer one. @param {Omit<Props, "erased">} props */
export function Accepted({ competition, one, changed }) {
  const { version, text } = competition.terms;
  if (one.terms === version) return html`<p class="muted">You accepted version ${version} of the terms, the newest.</p>`;
  const accept = () => request(pathOf(competition, one), { method: "PATCH", body: { accepts_terms: version } });
  return html`<div class="inset">
    <p><strong>The terms have changed.</strong> ${one.terms ? `You accepted version ${one.terms}` : "You accepted none"}; the newest is version ${version}.</p>
    ${!isOver(competition) &&
    one.status !== "disqualified" &&
    // Each version has its own dialog: nobody accepts a text that changed while it was read.
    html`<p><${ActButton} key=${version} label=${`Accept version ${version}`} of=${`of the terms for ${visible(one.name)}`} isDangerous=${false}
      title=${`Accept version ${version} of the terms?`} done=${changed} act=${accept}>
      <${Prose} text=${text} label=${`Version ${version} of the terms`} />
    <//></p>`}
  </div>`;
}

/** Changes that an entrant makes to itself. @param {Props} props */
export function OwnEntrant({ competition, one, changed, erased }) {
  const path = pathOf(competition, one);
  const isActive = one.status === "active" && !isOver(competition);
  if (one.erased) return null;
  const withdraw = (/** @type {string} */ reason) => request(path, { method: "PATCH", body: { status: "withdrawn", ...(reason && { reason }) } });
  const erase = async () => {
    await request(path, { method: "DELETE" });
    erased(one.name);
    await forgetRefusedKey(competition.id);
    changed();
  };
  return html`<details>
    <summary>Change or leave: name, contact, team</summary>
    ${one.status !== "disqualified" && html`<${Declared} competition=${competition} one=${one} changed=${changed} />`}
    <${Team} path=${path} mayAdd=${isActive} />
    <p class="buttons">
      ${isActive &&
      html`<${ActButton} label="Withdraw" of=${visible(one.name)} reason="optional" done=${changed} act=${withdraw}
        text="It starts no more attempts, and stays on the board without a rank. Only an organizer can take it back." />`}
      <${ActButton} label="Erase" of=${visible(one.name)} dismiss="Keep it" act=${erase}><${ErasingText} /><//>
    </p>
  </details>`;
}

/** The entrant's name and contact. @param {Omit<Props, "erased">} props */
function Declared({ competition, one, changed }) {
  const path = pathOf(competition, one);
  const { value, problem, reload } = useLoaded((signal) => request(path, { signal }), [path]);
  const change = async (/** @type {{name?: string, contact?: string}} */ body, /** @type {string} */ note) => {
    const { name } = await request(path, { method: "PATCH", body });
    changed();
    return { note, values: { ...body, name } };
  };
  const rename = (/** @type {{name: string}} */ body) => change(body, "The name was changed.");
  const reach = ({ contact = "" }) => change({ contact }, contact ? "The contact was changed." : "The contact was removed.");
  const name = { name: "name", label: "Name on the board", isRequired: true, max: 100, initial: one.name };
  return html`
    ${!isOver(competition) && html`<${Form} fields=${[name]} label="Change the name" send=${rename} />`}
    ${problem && !value && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    ${value && html`<${Form} fields=${[contactField(value.contact)]} label="Change the contact" send=${reach} />`}`;
}

/** A key that was made for the entrant is good for nothing any more; others stay. @param {string} competition */
async function forgetRefusedKey(competition) {
  const problem = key() && (await request(route`/api/v1/competitions/${competition}/attempts?limit=1`).then(() => null, (problem) => problem));
  if (problem?.status === 401) remember("key", null);
}
