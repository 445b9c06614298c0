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

/** @typedef {"text" | "secret" | "long" | "lines" | "numbers" | "json" | "number" | "choice" | "time" | "checks" | "check" | "order" | "windows"} Kind */

/** @param {string} text @param {RegExp} between */
const split = (text, between) => text.split(between).map((part) => part.trim()).filter(Boolean);

/**
 * The element of an input, and its value in the body; `undefined` leaves the field out.
 * @type {Record<Kind, {Input: (props: InputProps) => any, read: (value: any) => unknown}>}
 */
export const KINDS = {
  text: { Input: Line, read: (value) => value || undefined },
  secret: { Input: Line, read: (value) => value.trim() || undefined },
  long: { Input: Lines, read: (value) => value || undefined },
  lines: { Input: Lines, read: (value) => split(value, /\n/) },
  numbers: { Input: Line, read: (value) => split(value, /[\s,]/).map(Number) },
  json: { Input: Lines, read: readJson },
  number: { Input: Line, read: (value) => (value === "" ? undefined : Number(value)) },
  choice: { Input: Choice, read: (value) => value || undefined },
  time: { Input: Moment, read: readTime },
  checks: { Input: Checks, read: (value) => value },
  check: { Input: Check, read: (value) => value || undefined },
  order: { Input: Order, read: (value) => value },
  windows: { Input: Windows, read: (value) => value.map(readWindow) },
};

/** @param {string} value */
function readJson(value) {
  if (!value.trim()) return undefined;
  try {
    return JSON.parse(value);
  } catch {
    throw new Problem(422, { detail: "This is not JSON." });
  }
}

/** A local time of an input, as the API takes it. @param {string} value */
function readTime(value) {
  const at = new Date(value);
  return value && !Number.isNaN(at.getTime()) ? at.toISOString() : undefined;
}

/** @param {{opens_at: string, closes_at: string}} window */
const readWindow = (window) => ({ opens_at: readTime(window.opens_at), closes_at: readTime(window.closes_at) });

/** A time as an input shows it. @param {Date} at */
export function localTime(at) {
  const local = new Date(at.getTime() - at.getTimezoneOffset() * 60_000);
  return local.toISOString().slice(0, 16);
}

/** @param {InputProps} props */
function Line({ field, value, set, props }) {
  const isNumber = field.kind === "number";
  return html`<input
    ...${props}
    type=${field.kind === "secret" ? "password" : isNumber ? "number" : "text"}
    min=${field.min} max=${field.max} step=${isNumber ? field.step ?? 1 : undefined}
    maxlength=${isNumber ? undefined : field.max}
    placeholder=${field.placeholder} autocomplete="off" spellcheck=${false}
    value=${value}
    onInput=${(/** @type {any} */ event) => set(event.target.value)}
  />`;
}

/** @param {InputProps} props */
function Lines({ field, value, set, props }) {
  return html`<textarea ...${props} rows=${field.step ?? 4} maxlength=${field.max} placeholder=${field.placeholder} spellcheck=${false}
    value=${value} onInput=${(/** @type {any} */ event) => set(event.target.value)}></textarea>`;
}

/** @param {InputProps} props */
function Choice({ field, value, set, props }) {
  return html`<select ...${props} value=${value} onChange=${(/** @type {any} */ event) => set(event.target.value)}>
    ${field.options?.map(([name, text]) => html`<option value=${name}>${text}</option>`)}
  </select>`;
}

/** @param {InputProps} props */
function Check({ value, set, props }) {
  return html`<input ...${props} type="checkbox" checked=${Boolean(value)} onChange=${(/** @type {any} */ event) => set(event.target.checked)} />`;
}

/** @param {InputProps} props */
function Checks({ field, value, set, props }) {
  /** @param {string} name @param {boolean} isOn */
  const changed = (name, isOn) =>
    set(field.options?.map(([option]) => option).filter((option) => (option === name ? isOn : value.includes(option))));
  return html`<div role="group" id=${props.id} aria-labelledby=${props["aria-labelledby"]} aria-describedby=${props["aria-describedby"]} class="checks">
    ${field.options?.map(
      ([name, text]) => html`<label>
        <input type="checkbox" checked=${value.includes(name)} aria-invalid=${props["aria-invalid"]}
          onChange=${(/** @type {any} */ event) => changed(name, event.target.checked)} />
        ${text}
      </label>`,
    )}
  </div>`;
}

/** Some of the options, one after the other: each is chosen among those that are left. @param {InputProps} props */
function Order({ field, value, set, props }) {
  const options = field.options ?? [];
  const places = [...value, ""].slice(0, options.length);
  /** Values after an emptied place move up. @param {number} place @param {string} name */
  const changed = (place, name) => set(places.map((known, index) => (index === place ? name : known)).filter(Boolean));
  return html`<div role="group" id=${props.id} aria-labelledby=${props["aria-labelledby"]} aria-describedby=${props["aria-describedby"]} class="order">
    ${places.map(
      (chosen, place) => html`<label key=${place}>
        ${place === 0 ? "First" : "Then"}${" "}
        <select value=${chosen} aria-invalid=${props["aria-invalid"]} onChange=${(/** @type {any} */ event) => changed(place, event.target.value)}>
          <option value="">${place === 0 ? "none" : "nothing more"}</option>
          ${options.filter(([name]) => name === chosen || !value.includes(name)).map(([name, text]) => html`<option key=${name} value=${name}>${text}</option>`)}
        </select>
      </label>`,
    )}
  </div>`;
}

/** A time in the zone of who fills in the form, and the same in UTC. @param {InputProps} props */
function Moment({ value, set, props }) {
  const at = readTime(value);
  return html`<input ...${props} type="datetime-local" value=${value} onInput=${(/** @type {any} */ event) => set(event.target.value)} />
    <span class="muted small number">${at ? `${at.slice(0, 16).replace("T", " ")} UTC` : "your local time"}</span>`;
}

/** Attempts of a competition, each with a window of its own. */
const ATTEMPTS_MAX = 100;

/** @param {InputProps} props */
function Windows({ value, set, props }) {
  /** @param {number} place @param {string} name @param {string} time */
  const changed = (place, name, time) => set(value.map((window, index) => (index === place ? { ...window, [name]: time } : window)));
  return html`<div role="group" id=${props.id} aria-labelledby=${props["aria-labelledby"]} aria-describedby=${props["aria-describedby"]}>
    ${value.map(
      (window, place) => html`<div class="window">
        <strong>Attempt ${place + 1}</strong>
        ${[["opens_at", "opens"], ["closes_at", "closes"]].map(
          ([name, text]) => html`<label>
            ${text} <input type="datetime-local" aria-label=${`Attempt ${place + 1} ${text}`} aria-invalid=${props["aria-invalid"]} value=${window[name]}
              onInput=${(/** @type {any} */ event) => changed(place, name, event.target.value)} />
          </label>`,
        )}
        <button type="button" class="quiet" aria-label=${`Remove attempt ${place + 1}`} onClick=${() => set(value.filter((_, index) => index !== place))}>Remove</button>
      </div>`,
    )}
    <button type="button" disabled=${value.length >= ATTEMPTS_MAX} onClick=${() => set([...value, { opens_at: "", closes_at: "" }])}>Add an attempt</button>
  </div>`;
}
