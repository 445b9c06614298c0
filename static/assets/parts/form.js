// Forms from lists of fields. The server's problem with a field stands next to it.
import { html, useId, useLayoutEffect, useRef, useState } from "../ui.js";
import { Problem } from "../api.js";
import { KINDS } from "./inputs.js";
import { Text, LongText } from "./text.js";

/** @typedef {import("./inputs.js").Field} Field */
/** @typedef {{legend: string, fields: Field[], isFolded?: boolean}} Group */

/**
 * The body to send, and the problems of inputs.
 * @param {(Field | Group)[]} fields
 * @param {Record<string, any>} values
 */
function bodyOf(fields, values) {
  /** @type {Record<string, any>} */
  const body = {};
  /** @type {{field: string, problem: string}[]} */
  const problems = [];
  for (const field of flat(fields)) {
    if (field.isLocal || (field.when && !field.when(values))) continue;
    try {
      const value = KINDS[field.kind ?? "text"].read(values[keyOf(field)] ?? "");
      if (value !== undefined) put(body, field.name.split("."), value);
    } catch (error) {
      problems.push({ field: field.name, problem: error instanceof Error ? error.message : "" });
    }
  }
  return { body, problems };
}

/** @param {Record<string, any>} body @param {string[]} path @param {unknown} value */
function put(body, path, value) {
  const [name, ...rest] = path;
  if (rest.length === 0) body[name] = value;
  else put(/** @type {any} */ (body[name] ??= {}), rest, value);
}

/** @param {Field} field */
const keyOf = (field) => field.key ?? field.name;

/** @param {(Field | Group)[]} fields @returns {Field[]} */
const flat = (fields) => fields.flatMap((one) => ("fields" in one ? one.fields : one));

/** @param {(Field | Group)[]} fields */
const initialValues = (fields) => Object.fromEntries(flat(fields).map((field) => [keyOf(field), field.initial ?? ""]));

/**
 * A form. `send` gets the body; afterwards the form is reset, to the fields that `send` returns, if any.
 * @param {{fields: (Field | Group)[], label: string, send: (body: any) => Promise<void | (Field | Group)[]>, hasPreview?: boolean}} props
 */
export function Form({ fields, label, send, hasPreview }) {
  const [values, setValues] = useState(() => initialValues(fields));
  const [problem, setProblem] = useState(/** @type {Problem | null} */ (null));
  const [isSending, setIsSending] = useState(false);
  const form = useRef(/** @type {HTMLFormElement | null} */ (null));
  const { body, problems } = bodyOf(fields, values);

  // The focus moves before the problem is painted.
  useLayoutEffect(() => {
    if (!problem) return;
    const wrong = form.current?.querySelector("[aria-invalid=true]");
    const target = wrong ?? form.current?.querySelector("[role=alert]");
    target?.closest("details")?.setAttribute("open", "");
    if (target instanceof HTMLElement) target.focus();
  }, [problem]);

  /** @param {Event} event */
  const submitted = async (event) => {
    event.preventDefault();
    if (problems.length > 0) return setProblem(new Problem(422, { detail: "Some fields cannot be read.", fields: problems }));
    setProblem(null);
    setIsSending(true);
    try {
      const next = await send(body);
      setValues(initialValues(next ?? fields));
    } catch (error) {
      setProblem(error instanceof Problem ? error : new Problem(0, { detail: String(error) }));
    } finally {
      setIsSending(false);
    }
  };
  const shown = flat(fields).filter((field) => !field.when || field.when(values));
  const elsewhere = problem?.fields.filter((one) => !shown.some((field) => isOf(field, one.field))) ?? [];
  /** @param {Field} field */
  const entry = (field) =>
    (!field.when || field.when(values)) &&
    html`<${Entry}
      key=${keyOf(field)}
      field=${field}
      value=${values[keyOf(field)]}
      set=${(/** @type {any} */ value) => setValues((values) => ({ ...values, [keyOf(field)]: value }))}
      problems=${problem?.fields.filter((one) => isOf(field, one.field)) ?? []}
    />`;
  return html`<form ref=${form} onSubmit=${submitted}>
    ${fields.map((one) => ("fields" in one ? html`<${Fieldset} group=${one} entry=${entry} />` : entry(one)))}
    ${hasPreview &&
    html`<details><summary>What is sent</summary><${LongText} value=${JSON.stringify(body, null, 2)} label="What is sent" /></details>`}
    ${problem &&
    html`<div class="problem" role="alert" tabindex="-1">
      <p><${Text} value=${problem.message} /></p>
      ${elsewhere.length > 0 &&
      html`<ul>${elsewhere.map((one) => html`<li><code><${Text} value=${one.field} /></code> <${Text} value=${one.problem} /></li>`)}</ul>`}
    </div>`}
    <p class="buttons"><button type="submit" class="primary" disabled=${isSending}>${isSending ? "Sending …" : label}</button></p>
  </form>`;
}

/** Whether a problem with this name concerns a field. @param {Field} field @param {string} name */
const isOf = (field, name) => name === field.name || name.startsWith(`${field.name}[`) || name.startsWith(`${field.name}.`);

/** @param {{group: Group, entry: (field: Field) => any}} props */
const Fieldset = ({ group, entry }) =>
  group.isFolded
    ? html`<details class="fields"><summary>${group.legend}</summary>${group.fields.map(entry)}</details>`
    : html`<fieldset><legend>${group.legend}</legend>${group.fields.map(entry)}</fieldset>`;

/**
 * A field with its label, its explanation and its problem.
 * @param {{field: Field, value: any, set: (value: any) => void, problems: {field: string, problem: string}[]}} props
 */
function Entry({ field, value, set, problems }) {
  const id = useId();
  const kind = field.kind ?? "text";
  const { Input } = KINDS[kind];
  const isGroup = kind === "checks" || kind === "order" || kind === "windows";
  const props = {
    id,
    "aria-describedby": `${id}-help`,
    "aria-invalid": problems.length > 0 ? "true" : undefined,
    "aria-labelledby": isGroup ? `${id}-label` : undefined,
    required: field.isRequired,
  };
  const label = html`<label id=${`${id}-label`} for=${isGroup ? undefined : id}>
    ${field.label}${field.isRequired && html` <span class="muted">(required)</span>`}
  </label>`;
  return html`<div class="field">
    ${kind === "check" ? html`<${Input} ...${{ field, value, set, props }} /> ${label}` : html`${label}<${Input} ...${{ field, value, set, props }} />`}
    <div id=${`${id}-help`} class="small">
      ${problems.map((one) => html`<div class="bad"><${Text} value=${one.field === field.name ? one.problem : `${one.field.slice(field.name.length)}: ${one.problem}`} /></div>`)}
      ${field.help && html`<span class="muted">${field.help}</span>`}
    </div>
  </div>`;
}
