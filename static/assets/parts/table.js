// Tables that scroll sideways, and heads that sort them.
import { html, useState } from "../ui.js";

/**
 * A table; heads of numbers begin with "#".
 * @param {{label: string, heads: any[], name?: string, caption?: any, children?: any}} props
 */
export const Table = ({ label, heads, name, caption, children }) => html`<div class="scroll" tabindex="0" role="region" aria-label=${label}>
  <table class=${name}>
    ${caption && html`<caption>${caption}</caption>`}
    <thead>
      <tr>${heads.map((head) => (typeof head === "string" ? html`<th scope="col" class=${head[0] === "#" ? "number" : ""}>${head.replace("#", "")}</th>` : head))}</tr>
    </thead>
    ${children}
  </table>
</div>`;

/** The number of things shown at first; more on request. */
export const SHOWN = 48;

/** The first of many things, and a button for more. @param {{items: any[], wrap: (shown: any[]) => unknown}} props */
export function Shown({ items, wrap }) {
  const [count, setCount] = useState(SHOWN);
  return html`${wrap(items.slice(0, count))}
  ${items.length > count && html`<p><button type="button" onClick=${() => setCount(count + SHOWN)}>Show more (${items.length - count})</button></p>`}`;
}

/** Facts by their names; those without a value are left out. @param {{facts: any[], look?: string}} props look: the class of values */
export const Facts = ({ facts, look }) => html`<dl class="facts">
  ${facts.filter((fact) => fact && ![null, undefined, false, ""].includes(fact[1])).map(([name, value]) => html`<dt>${name}</dt><dd class=${look}>${value}</dd>`)}
</dl>`;

/**
 * A head that sorts by its column, and turns the order around where `back` is another one.
 * @param {{name: string, by: string, back?: string, sort: string, onSort: (by: string) => void, isUp?: boolean, isNumber?: boolean, about?: string}} props
 *   isUp: whether `by` begins with the lowest
 */
export function SortHead({ name, by, back = by, sort, onSort, isUp, isNumber, about }) {
  const isBack = sort === back && back !== by;
  const isAscending = Boolean(isUp) !== isBack;
  const isSorted = sort === by || isBack;
  return html`<th scope="col" class=${isNumber ? "number" : ""} aria-sort=${isSorted ? (isAscending ? "ascending" : "descending") : undefined} title=${about}>
    <button type="button" onClick=${() => onSort(sort === by ? back : by)}>${name}<span aria-hidden="true">${isSorted ? (isAscending ? " ▲" : " ▼") : ""}</span></button>
  </th>`;
}
