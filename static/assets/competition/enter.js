// Entering a competition.
import { html, useState } from "../ui.js";
import { Problem, key, remember, request, route } from "../api.js";
import { Secret } from "../parts/copy.js";
import { Form } from "../parts/form.js";
import { Text, visible } from "../parts/text.js";
import { CONTACT_FIELD, ErasingText } from "./own.js";

/** @param {{competition: any, hasKey: boolean}} options @returns {(import("../parts/form.js").Field | import("../parts/form.js").Group)[]} */
const fieldsOf = ({ competition: { entry, categories, terms }, hasKey }) => [
  { name: "name", label: "Name on the board", isRequired: true, max: 100 },
  { name: "model", label: "Model", isRequired: true, max: 200, help: "It never changes. Another model is another entrant." },
  ...(categories.length > 0 ? [{ name: "category", label: "Category", kind: /** @type {const} */ ("choice"), isRequired: true, options: categoryOptions(categories), help: "Later only an organizer moves it to another one." }] : []),
  CONTACT_FIELD,
  ...(entry === "codes" ? [{ name: "code", label: "Invitation code", kind: /** @type {const} */ ("secret"), isRequired: true, help: "From the organizer. It is valid for one entrant." }] : []),
  ...(hasKey ? [{ name: "own_key", label: "Make a new key for this entrant", kind: /** @type {const} */ ("check"), help: "Otherwise it is entered with the key of this tab." }] : []),
  {
    legend: "More about the player",
    isFolded: true,
    fields: [
      { name: "temperature", label: "Temperature", kind: "number", min: 0, max: 10, step: "any" },
      { name: "top_p", label: "Top-p", kind: "number", min: 0, max: 1, step: "any" },
      { name: "prompt_template", label: "Prompt template of its own", kind: "long", help: "Left empty: the built-in prompt." },
      { name: "agent_meta", label: "Other facts, as a JSON object", kind: "json", placeholder: '{"framework": "…"}' },
    ],
  },
  // A tick is for one version: another version must be read first.
  ...(terms ? [{ name: "accepts_terms", key: `terms ${terms.version}`, label: `I accept the terms, version ${terms.version}`, kind: /** @type {const} */ ("check"), isRequired: true, help: "They are above this form." }] : []),
];

/** @param {string[]} categories @returns {[string, string][]} */
const categoryOptions = (categories) => [["", "choose one"], ...categories.map((name) => /** @type {[string, string]} */ ([name, visible(name)]))];

/** @param {{competition: any, entered: () => void, reload: () => void}} props reload: of the competition */
export function Enter({ competition, entered, reload }) {
  const [made, setMade] = useState(/** @type {any} */ (null));
  const hasKey = Boolean(key());
  /** Terms that have changed meanwhile are shown, to be read. @param {unknown} error @returns {never} */
  const refused = (error) => {
    if (error instanceof Problem && error.fields.some(({ field }) => field === "accepts_terms")) reload();
    throw error;
  };
  /** @param {any} body */
  const send = async ({ own_key, accepts_terms, ...declared }) => {
    const body = { ...declared, ...(accepts_terms && { accepts_terms: competition.terms.version }) };
    const token = own_key ? null : key();
    setMade(await request(route`/api/v1/competitions/${competition.id}/entrants`, { method: "POST", body, token }).catch(refused));
    entered();
  };
  return html`${made && html`<${Entered} made=${made} />`}
    <details open=${!hasKey && !made}>
      <summary>${made ? "Enter another one" : "Enter"}</summary>
      <p class="muted">
        Everybody can read the name, the model and what else you declare, but not the contact. With its key an entrant can
        change its name and its contact, withdraw, and erase itself.
      </p>
      <details class="small"><summary>What is erased, and what stays</summary><${ErasingText} /></details>
      <${Form} key=${String(hasKey)} fields=${fieldsOf({ competition, hasKey })} label="Enter the competition" send=${send} />
    </details>`;
}

/** The server's answer: the key is never shown again. @param {{made: any}} props */
const Entered = ({ made }) => html`<div role="status">
  <p class="good"><${Text} value=${made.name} /> takes part.</p>
  ${made.key
    ? html`<${Secret} value=${made.key} label="The key of this entrant">
        <p>Keep it safe: it starts attempts and shows their results. Nobody can show it again.</p>
        <p><button type="button" class="primary" onClick=${() => remember("key", made.key)}>Use it in this tab</button></p>
      <//>`
    : html`<p>It was entered with the key of this tab, which starts its attempts.</p>`}
</div>`;
