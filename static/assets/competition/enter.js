// Entering a competition.
import { html, useState } from "../ui.js";
import { key, remember, request, route } from "../api.js";
import { Secret } from "../parts/copy.js";
import { Form } from "../parts/form.js";
import { Text } from "../parts/text.js";
import { ErasingText, rememberEntrant } from "./own.js";

/** @param {{entry: string, hasKey: boolean}} options @returns {(import("../parts/form.js").Field | import("../parts/form.js").Group)[]} */
const fieldsOf = ({ entry, hasKey }) => [
  { name: "name", label: "Name on the board", isRequired: true, max: 100 },
  { name: "model", label: "Model", isRequired: true, max: 200, help: "It never changes. Another model is another entrant." },
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
];

/** @param {{competition: any, entered?: () => void}} props */
export function Enter({ competition, entered }) {
  const [made, setMade] = useState(/** @type {any} */ (null));
  const hasKey = Boolean(key());
  /** @param {any} body */
  const send = async ({ own_key, ...body }) => {
    const token = own_key ? null : key();
    const answer = await request(route`/api/v1/competitions/${competition.id}/entrants`, { method: "POST", body, token });
    if (!answer.key) rememberEntrant(competition.id, answer.id);
    setMade(answer);
    entered?.();
  };
  return html`${made && html`<${Entered} competition=${competition.id} made=${made} />`}
    <details open=${!hasKey && !made}>
      <summary>${made ? "Enter another one" : "Enter"}</summary>
      <p class="muted">
        Everybody can read the name, the model and what else you declare. With its key an entrant can change its name, withdraw, and erase itself.
      </p>
      <details class="small"><summary>What is erased, and what stays</summary><${ErasingText} /></details>
      <${Form} key=${String(hasKey)} fields=${fieldsOf({ entry: competition.entry, hasKey })} label="Enter the competition" send=${send} />
    </details>`;
}

/** What the server answered: the key is never shown again. @param {{competition: string, made: any}} props */
function Entered({ competition, made }) {
  const use = () => {
    rememberEntrant(competition, made.id);
    remember("key", made.key);
  };
  return html`<div role="status">
  <p class="good"><${Text} value=${made.name} /> takes part.</p>
  ${made.key
    ? html`<${Secret} value=${made.key} label="The key of this entrant">
        <p>Keep it safe: it starts attempts and shows their results. Nobody can show it again.</p>
        <p><button type="button" class="primary" onClick=${use}>Use it in this tab</button></p>
      <//>`
    : html`<p>It was entered with the key of this tab, which starts its attempts.</p>`}
</div>`;
}
