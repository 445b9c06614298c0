// The inputs of forms: their elements, and their values in the body.
import { html } from "../ui.js";
import { Problem } from "../api.js";

/**
 * @typedef {object} Field
 * @property {string} name its place in the body: `clocks.bank_s`
 * @property {string} [key] its name among the values, where two fields have the same place
 * @property {boolean} [isLocal] it only decides which other fields are asked for
 * @property {string} label
 * @property {string} [help]
 * @property {Kind} [kind] text where it is left out
 * @property {any} [initial]
 * @property {string} [placeholder] what counts where the field is left empty
 * @property {[string, string][]} [options] value and text of each
 * @property {boolean} [isRequired]
 * @property {number} [min]
 * @property {number} [max]
 * @property {number | string} [step]
 * @property {(values: Record<string, any>) => boolean} [when] whether it is asked for
 */

/** @typedef {{field: Field, value: any, set: (value: any) => void, props: Record<string, any>}} InputProps */

/** @typedef {"text" | "secret" | "long" | "lines" | "numbers" | "facts" | "number" | "choice" | "time" | "checks" | "check" | "order" | "windows"} Kind */

/** @param {string} text @param {RegExp} between */
const split = (text, between) => text.split(between).map((part) => part.trim()).filter(Boolean);

/** @param {(value: any) => void} set */
const typed = (set) => (/** @type {any} */ event) => set(event.target.value);

/**
 * The element of an input, and its value in the body; `undefined` leaves the field out. isGroup: it is made of several elements.
 * @type {Record<Kind, {Input: (props: InputProps) => any, read: (value: any) => unknown, isGroup?: boolean}>}
 */
export const KINDS = {
  text: { Input: Line, read: (value) => value || undefined },
  secret: { Input: Line, read: (value) => value.trim() || undefined },
  long: { Input: Lines, read: (value) => value || undefined },
  lines: { Input: Lines, read: (value) => split(value, /\n/) },
  numbers: { Input: Line, read: (value) => split(value, /[\s,]/).map(Number) },
  facts: { Input: Lines, read: readFacts },
  number: { Input: Line, read: (value) => (value === "" ? undefined : Number(value)) },
  choice: {
    Input: ({ field, value, set, props }) => html`<select ...${props} value=${value} onChange=${typed(set)}>${field.options?.map(option)}</select>`,
    read: (value) => value || undefined,
  },
  time: { Input: Moment, read: readTime },
  check: {
    Input: ({ value, set, props }) => html`<input ...${props} type="checkbox" checked=${Boolean(value)} onChange=${(event) => set(event.target.checked)} />`,
    read: (value) => value || undefined,
  },
  checks: { Input: Checks, read: (value) => value, isGroup: true },
  order: { Input: Order, read: (value) => value, isGroup: true },
  windows: {
    Input: Windows,
    read: (value) => value.map(({ opens_at, closes_at }) => ({ opens_at: readTime(opens_at), closes_at: readTime(closes_at) })),
    isGroup: true,
  },
};

/** Facts by their names, from lines like `framework: its name`. @param {string} text */
function readFacts(text) {
  const facts = split(text, /\n/).map((line) => {
    const found = /^([^:]+):\s*(.+)$/.exec(line);
    if (!found) throw new Problem(422, { detail: `“${line}” has no colon between a name and what it says.` });
    return [found[1].trim(), found[2]];
  });
  return facts.length > 0 ? Object.fromEntries(facts) : undefined;
}

/** The sampling that a player declares. @type {Field[]} */
export const SAMPLING_FIELDS = [
  { name: "temperature", label: "Temperature, as declared", kind: "number", min: 0, max: 10, step: "any" },
  { name: "top_p", label: "Top-p, as declared", kind: "number", min: 0, max: 1, step: "any" },
];

/** What a player declares beside its model and its sampling. @type {Field[]} */
export const DECLARED_FIELDS = [
  { name: "prompt_template", label: "Prompt template of its own", kind: "long", help: "Left empty: the built-in prompt." },
  { name: "agent_meta", label: "Other facts, one a line", kind: "facts", placeholder: "framework: its name" },
];

/** A local time of an input, as the API takes it. @param {string} value */
function readTime(value) {
  const at = new Date(value);
  return value && !Number.isNaN(at.getTime()) ? at.toISOString() : undefined;
}

/** A time as an input shows it. @param {Date} at */
export const localTime = (at) => new Date(at.getTime() - at.getTimezoneOffset() * 60_000).toISOString().slice(0, 16);

/** @param {[string, string]} option */
const option = ([name, text]) => html`<option key=${name} value=${name}>${text}</option>`;

/** @param {InputProps} props */
function Line({ field, value, set, props }) {
  const isNumber = field.kind === "number";
  const type = field.kind === "secret" ? "password" : isNumber ? "number" : "text";
  const limits = isNumber ? { min: field.min, max: field.max, step: field.step ?? 1 } : { maxlength: field.max };
  return html`<input ...${props} type=${type} ...${limits} placeholder=${field.placeholder} autocomplete="off" spellcheck=${false}
    value=${value} onInput=${typed(set)} />`;
}

/** @param {InputProps} props */
function Lines({ field, value, set, props }) {
  return html`<textarea ...${props} rows=${field.step ?? 4} maxlength=${field.max} placeholder=${field.placeholder} spellcheck=${false}
    value=${value} onInput=${typed(set)}></textarea>`;
}

/** A time in the zone of who fills in the form, and the same in UTC. @param {InputProps} props */
function Moment({ value, set, props }) {
  const at = readTime(value);
  return html`<input ...${props} type="datetime-local" value=${value} onInput=${typed(set)} />
    <span class="muted small number">${at ? `${at.slice(0, 16).replace("T", " ")} UTC` : "your local time"}</span>`;
}

/** Several elements under the label of one field. @param {{props: Record<string, any>, name?: string, children?: any}} props */
const Several = ({ props, name, children }) =>
  html`<div role="group" id=${props.id} aria-labelledby=${props["aria-labelledby"]} aria-describedby=${props["aria-describedby"]} class=${name}>${children}</div>`;

/** @param {InputProps} props */
function Checks({ field: { options = [] }, value, set, props }) {
  const changed = (/** @type {string} */ name, /** @type {boolean} */ isOn) =>
    set(options.map(([option]) => option).filter((option) => (option === name ? isOn : value.includes(option))));
  return html`<${Several} props=${props} name="checks">
    ${options.map(
      ([name, text]) => html`<label>
        <input type="checkbox" checked=${value.includes(name)} aria-invalid=${props["aria-invalid"]}
          onChange=${(/** @type {any} */ event) => changed(name, event.target.checked)} /> ${text}
      </label>`,
    )}
  <//>`;
}

/** Some of the options, one after the other: each is chosen among those that are left. @param {InputProps} props */
function Order({ field: { options = [] }, value, set, props }) {
  const places = [...value, ""].slice(0, options.length);
  // Values after an emptied place move up.
  const changed = (/** @type {number} */ place, /** @type {string} */ name) => set(places.with(place, name).filter(Boolean));
  return html`<${Several} props=${props} name="order">
    ${places.map(
      (chosen, place) => html`<label key=${place}>
        ${place === 0 ? "First" : "Then"}${" "}
        <select value=${chosen} aria-invalid=${props["aria-invalid"]} onChange=${typed((name) => changed(place, name))}>
          <option value="">${place === 0 ? "none" : "nothing more"}</option>
          ${options.filter(([name]) => name === chosen || !value.includes(name)).map(option)}
        </select>
      </label>`,
    )}
  <//>`;
}

/** Attempts of a competition, each with a window of its own. */
const ATTEMPTS_MAX = 100;

/** @param {InputProps} props */
function Windows({ value, set, props }) {
  const end = (/** @type {number} */ place, /** @type {string} */ name, /** @type {string} */ text) => html`<label>
    ${text} <input type="datetime-local" aria-label=${`Attempt ${place + 1} ${text}`} aria-invalid=${props["aria-invalid"]} value=${value[place][name]}
      onInput=${typed((time) => set(value.with(place, { ...value[place], [name]: time })))} />
  </label>`;
  return html`<${Several} props=${props}>
    ${value.map(
      (_, place) => html`<div class="window">
        <strong>Attempt ${place + 1}</strong> ${end(place, "opens_at", "opens")} ${end(place, "closes_at", "closes")}
        <button type="button" class="quiet" aria-label=${`Remove attempt ${place + 1}`} onClick=${() => set(value.toSpliced(place, 1))}>Remove</button>
      </div>`,
    )}
    <button type="button" disabled=${value.length >= ATTEMPTS_MAX} onClick=${() => set([...value, { opens_at: "", closes_at: "" }])}>Add an attempt</button>
  <//>`;
}
