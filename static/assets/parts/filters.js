// Filters above lists.
import { html, useEffect, useId, useState } from "../ui.js";
import { request } from "../api.js";
import { useLoaded } from "./load.js";
import { useQuery } from "./query.js";
import { visible } from "./text.js";

/** The number of models that are suggested. */
const MODELS_MAX = 1000;

/** The filters of a list, which the address has. `of` is what the input of one needs. @param {string[]} names */
export function useFilters(names) {
  const [query, change] = useQuery();
  const values = Object.fromEntries(names.map((name) => [name, query.get(name) ?? ""]));
  /** @param {string} name @param {string | boolean} value */
  const set = (name, value) => change({ [name]: value ? String(value) : null });
  const of = (/** @type {string} */ name) => ({ value: values[name], onChange: (value) => set(name, value) });
  const isFiltered = Object.values(values).some(Boolean);
  return { query, change, values, of, isFiltered, clear: () => change(Object.fromEntries(names.map((name) => [name, null]))) };
}

/** @param {{filters: ReturnType<typeof useFilters>, children: any}} props */
export const Filters = ({ filters: { isFiltered, clear }, children }) => html`<div class="buttons" role="search" aria-label="Filters">
  ${children}
  ${isFiltered && html`<button type="button" class="quiet" onClick=${clear}>Show all</button>`}
</div>`;

/**
 * A choice of one option, or of all.
 * @param {{label: string, value: string, options: (string | string[])[], all?: string | null, onChange: (value: string) => void}} props
 *   options: values, or values with their names; all: the name of the empty one, null where there is none
 */
export const Choice = ({ label, value, options, all = "all", onChange }) => html`<label>
  ${label}${" "}
  <select onChange=${(/** @type {any} */ event) => onChange(event.currentTarget.value)}>
    ${[...(all === null ? [] : [["", all]]), ...options].map((option) => {
      const [one, name] = typeof option === "string" ? [option, option] : option;
      return html`<option value=${one} selected=${value === one}>${visible(name)}</option>`;
    })}
  </select>
</label>`;

/** Something to filter by, or not. @param {{label: string, value: string | boolean, onChange: (value: boolean) => void}} props */
export const Check = ({ label, value, onChange }) => html`<label>
  <input type="checkbox" checked=${Boolean(value)} onChange=${(/** @type {any} */ event) => onChange(event.currentTarget.checked)} /> ${label}
</label>`;

/** Whether a name has a text in it, in any case. @param {string} name @param {string} text */
export const fits = (name, text) => name.toLowerCase().includes(text.toLowerCase());

/**
 * A name to filter by, with suggestions. `onType` gets each text, for what is shown already; `onChange` a name that is whole, or the
 * only one that fits.
 * @param {{label: string, value: string, names: string[], onType?: (text: string) => void, onChange: (value: string) => void,
 *   onFocus?: () => void}} props
 */
export function Named({ label, value, names, onType, onChange, onFocus }) {
  const id = useId();
  const [typed, setTyped] = useState(value);
  useEffect(() => setTyped(value), [value]);
  const read = (/** @type {any} */ { type, currentTarget }) => {
    const text = currentTarget.value.trim();
    const isWhole = type === "change" || text === "" || names.includes(text);
    const found = isWhole && text ? names.filter((name) => fits(name, text)) : [];
    const name = found.length === 1 ? found[0] : text;
    setTyped(isWhole ? name : currentTarget.value);
    onType?.(isWhole ? "" : text);
    if (isWhole && name !== value) onChange(name);
  };
  return html`<label>${label}${" "}
    <input type="search" list=${id} value=${typed} placeholder="a part of its name" autocomplete="off"
      onInput=${read} onChange=${read} onFocus=${onFocus} />
    <datalist id=${id}>${names.map((name) => html`<option value=${name} />`)}</datalist>
  </label>`;
}

/** A model to filter by: those of all games that anyone may read are suggested; `props` are those of `Named`. @param {object} props */
export function Model(props) {
  const [isWanted, setIsWanted] = useState(false);
  const { value } = useLoaded(async (signal) => isWanted && request(`/api/v1/models?limit=${MODELS_MAX}`, { signal }), [isWanted]);
  return html`<${Named} label="Model" names=${value ? value.items : []} onFocus=${() => setIsWanted(true)} ...${props} />`;
}
