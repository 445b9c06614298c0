// Tables from columns: of items, and of lists of the server, which can be filtered.
import { html, useState } from "../ui.js";
import { Choice, fits } from "./filters.js";
import { Listed } from "./pages.js";
import { Table } from "./table.js";

/** The head of a column, of numbers after "#", and the cell of an item. @typedef {[any, (item: any, place: number) => any]} Column */

/**
 * A table of items. columns: without those that are left out; header: the column that names an item, the first; name: in style sheets;
 * look: the class of a row.
 * @typedef {{label: string, columns: (Column | false | 0 | undefined)[], header?: number, name?: string,
 *   look?: (item: any, place: number) => string | false, keyOf?: (item: any) => string}} OfItems
 */

/** The head of a column whose content says by itself what it is. @param {string} name for those who hear it */
export const unseen = (name) => html`<th scope="col"><span class="unseen">${name}</span></th>`;

/** Whether a head, as a text or an element, is that of numbers. @param {any} head */
const isOfNumbers = (head) => head[0] === "#" || head.props?.isNumber;

/** @param {OfItems & {items: any[]}} props */
export function Items({ label, columns, items, header = 0, name, look, keyOf = ({ id, run }) => id ?? run }) {
  const shown = /** @type {Column[]} */ (columns.filter(Boolean));
  const cells = (/** @type {any} */ item, /** @type {number} */ place) =>
    shown.map(([head, cell], column) =>
      column === header ? html`<th scope="row">${cell(item, place)}</th>` : html`<td class=${isOfNumbers(head) ? "number" : ""}>${cell(item, place)}</td>`,
    );
  return html`<${Table} label=${label} name=${name} heads=${shown.map(([head]) => head)}>
    <tbody>${items.map((item, place) => html`<tr key=${keyOf(item)} class=${look?.(item, place) || ""}>${cells(item, place)}</tr>`)}</tbody>
  <//>`;
}

/**
 * A list with a row for each item, and with more of them on request.
 * @param {OfItems & {list: ReturnType<typeof import("./pages.js").usePages>, filter?: Filter, empty?: any}} props
 */
export function ListTable({ list, filter, empty = "There is none.", ...table }) {
  const { shown, inputs } = useFilter(list.items, filter);
  return html`<${Listed} list=${list} empty=${html`<p class="empty">${empty}</p>`}>
    ${inputs}
    ${shown.length > 0 ? html`<${Items} ...${table} items=${shown} />` : html`<p class="empty">None fits.</p>`}
  <//>`;
}

/**
 * How a table is filtered as its reader types: by a text, and by a status.
 * @typedef {{name?: string, textOf: (item: any) => string, statusOf: (item: any) => string, label?: string, placeholder: string, initial?: string}} Filter
 *   name: of the table; label: what a status is called here
 */

/** The items that fit, and the inputs. @param {any[]} items @param {Filter} [filter] */
export function useFilter(items, filter) {
  const [text, setText] = useState("");
  const [status, setStatus] = useState(filter?.initial ?? "");
  if (!filter) return { shown: items, inputs: null };
  const { name = "the table", textOf, statusOf, label = "Status", placeholder } = filter;
  const statuses = [...new Set([...items.map(statusOf), ...(status ? [status] : [])])].sort();
  const shown = items.filter((item) => (!status || statusOf(item) === status) && fits(textOf(item), text.trim()));
  const inputs = html`<div class="buttons" role="search" aria-label=${`Filters of ${name}`}>
    <label>Find <input type="search" size="24" value=${text} placeholder=${placeholder} onInput=${(/** @type {any} */ event) => setText(event.target.value)} /></label>
    <${Choice} label=${label} value=${status} options=${statuses} onChange=${setStatus} />
    <span class="muted small" role="status">${shown.length} of ${items.length}</span>
  </div>`;
  return { shown, inputs };
}
