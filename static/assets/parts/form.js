// Forms from lists of fields. The server's problem with a field stands next to it.
import { html, useId, useLayoutEffect, useRef, useState } from "../ui.js";
import { Problem } from "../api.js";
import { KINDS } from "./inputs.js";
import { useTask } from "./load.js";
import { FieldProblems } from "./problem.js";
import { LongText, Text } from "./text.js";

/** @typedef {import("./inputs.js").Field} Field */
/** @typedef {{legend: string, fields: Field[], isFolded?: boolean}} Group */
/** What was done, in a sentence, and the values that the form has next: its first ones. @typedef {{note?: string, values?: Record<string, any>}} Sent */

/** Fields one after the other, those of groups too. @param {(Field | Group)[]} fields @returns {Field[]} */
export const single = (fields) => fields.flatMap((one) => ("fields" in one ? one.fields : one));

/** @param {Field} field */
const keyOf = (field) => field.key ?? field.name;

/** The body to send, and the problems of inputs. @param {Field[]} fields @param {Record<string, any>} values */
function bodyOf(fields, values) {
  const body = {};
  const problems = [];
  for (const field of fields.filter(({ isLocal }) => !isLocal)) {
    try {
      const value = KINDS[field.kind ?? "text"].read(values[keyOf(field)] ?? "");
      const path = field.name.split(".");
      const last = path.pop() ?? "";
      if (value !== undefined) path.reduce((parent, name) => (parent[name] ??= {}), body)[last] = value;
    } catch (error) {
      problems.push({ field: field.name, problem: error instanceof Error ? error.message : "" });
    }
  }
  return { body, problems };
}

/** A problem in the words of the form: the server names other fields as its API does. @param {string} problem @param {Field[]} fields */
const worded = (problem, fields) =>
  fields.reduce((text, { name, label }) => {
    const own = name.split(".").at(-1) ?? "";
    return own.includes("_") ? text.replaceAll(own, `“${label}”`) : text;
  }, problem);

/** @param {(Field | Group)[]} fields @returns {Record<string, any>} */
export const initialValues = (fields) => Object.fromEntries(single(fields).map((field) => [keyOf(field), field.initial ?? ""]));

/**
 * A form. `send` gets the body, and the values of the inputs.
 * @param {{fields: (Field | Group)[], label: string, send: (body: any, values: Record<string, any>) => Promise<Sent | void>, hasPreview?: boolean}} props
 */
export function Form({ fields, label, send, hasPreview }) {
  const [values, setValues] = useState(() => initialValues(fields));
  const { isBusy, problem, run } = useTask();
  const [note, setNote] = useState("");
  const form = useRef(/** @type {HTMLFormElement | null} */ (null));
  const all = single(fields);
  const isAsked = (/** @type {Field} */ { when }) => !when || when(values);
  const asked = all.filter(isAsked);
  const { body, problems } = bodyOf(asked, values);

  // The focus moves before the problem is painted.
  useLayoutEffect(() => {
    if (!problem) return;
    const wrong = form.current?.querySelector("[aria-invalid=true]");
    const target = wrong ?? form.current?.querySelector("[role=alert]");
    target?.closest("details")?.setAttribute("open", "");
    if (target instanceof HTMLElement) target.focus();
  }, [problem]);

  const submit = async () => {
    setNote("");
    if (problems.length > 0) throw new Problem(422, { detail: "Some fields cannot be read.", fields: problems });
    const { note = "", values: next = initialValues(fields) } = (await send(body, values)) ?? {};
    setNote(note);
    setValues(next);
  };
  const known = (problem instanceof Problem ? problem.fields : []).map((one) => ({ ...one, problem: worded(one.problem, all) }));
  const elsewhere = known.filter((one) => !asked.some((field) => isOf(field, one.field)));
  const entry = (/** @type {Field} */ field) => {
    const key = keyOf(field);
    const set = (/** @type {any} */ value) => setValues((values) => ({ ...values, [key]: value }));
    const own = known.filter((one) => isOf(field, one.field));
    return isAsked(field) && html`<${Entry} key=${field.name} field=${field} value=${values[key]} set=${set} problems=${own} />`;
  };
  return html`<form ref=${form} onSubmit=${(/** @type {Event} */ event) => (event.preventDefault(), run(submit))}>
    ${fields.map((one) => {
      if (!("fields" in one)) return entry(one);
      return one.isFolded
        ? html`<details class="fields"><summary>${one.legend}</summary>${one.fields.map(entry)}</details>`
        : html`<fieldset><legend>${one.legend}</legend>${one.fields.map(entry)}</fieldset>`;
    })}
    ${hasPreview &&
    html`<details><summary>The same for a program, as JSON</summary><${LongText} value=${JSON.stringify(body, null, 2)} label="What is sent" /></details>`}
    ${problem &&
    html`<div class="problem" role="alert" tabindex="-1"><p><${Text} value=${worded(problem.message, all)} /></p><${FieldProblems} problem=${{ fields: elsewhere }} /></div>`}
    <p class="buttons">
      <button type="submit" class="primary" disabled=${isBusy}>${isBusy ? "Sending …" : label}</button>
      <span class="good" role="status">${note}</span>
    </p>
  </form>`;
}

/** Whether a problem with this name concerns a field. @param {Field} field @param {string} name */
const isOf = (field, name) => name === field.name || name.startsWith(`${field.name}[`) || name.startsWith(`${field.name}.`);

/**
 * A field with its label, its explanation and its problem.
 * @param {{field: Field, value: any, set: (value: any) => void, problems?: {field: string, problem: string}[]}} props
 */
export function Entry({ field, value, set, problems = [] }) {
  const id = useId();
  const { name, label, help, kind = "text", isRequired } = field;
  const { Input, isGroup } = KINDS[kind];
  const props = {
    id,
    "aria-describedby": `${id}-help`,
    "aria-invalid": problems.length > 0 ? "true" : undefined,
    "aria-labelledby": isGroup ? `${id}-label` : undefined,
    required: isRequired,
  };
  const title = html`<label id=${`${id}-label`} for=${isGroup ? undefined : id}>${label}${isRequired && html` <span class="muted">(required)</span>`}</label>`;
  const input = html`<${Input} ...${{ field, value, set, props }} />`;
  return html`<div class="field">
    ${kind === "check" ? html`${input} ${title}` : html`${title}${input}`}
    <div id=${`${id}-help`} class="small">
      ${problems.map((one) => html`<div class="bad"><${Text} value=${one.field === name ? one.problem : `${one.field.slice(name.length)}: ${one.problem}`} /></div>`)}
      ${help && html`<span class="muted">${help}</span>`}
    </div>
  </div>`;
}
