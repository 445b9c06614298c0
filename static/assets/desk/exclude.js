// Excluding many entrants at once: first a preview, then the act.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { Form } from "../parts/form.js";
import { localTime } from "../parts/inputs.js";
import { Text } from "../parts/text.js";
import { Time } from "../parts/time.js";

/** @typedef {{name?: string, address?: string, registered_from?: string, registered_before?: string}} Description */

/** @param {Description} known @returns {import("../parts/form.js").Field[]} */
const fieldsOf = (known) => [
  { name: "name", label: "Name", max: 100, initial: known.name, placeholder: "bot-*", help: "A pattern: * stands for any characters, ? for one. Upper and lower case are the same." },
  { name: "address", label: "Address or network from which they entered", initial: known.address, placeholder: "203.0.113.7 or 2001:db8::/32" },
  { name: "registered_from", label: "Entered from", kind: "time", initial: known.registered_from && localTime(new Date(known.registered_from)) },
  { name: "registered_before", label: "Entered before", kind: "time", initial: known.registered_before && localTime(new Date(known.registered_before)) },
];

/** @param {{id: string, done: () => void}} props */
export function Exclude({ id, done }) {
  const [preview, setPreview] = useState(/** @type {{wanted: Description, count: number, items: any[]} | null} */ (null));
  const [note, setNote] = useState("");
  const path = route`/api/v1/competitions/${id}/exclusions`;
  /** @param {Description} wanted */
  const look = async (wanted) => {
    setNote("");
    const { count, items } = await request(path, { method: "POST", body: wanted });
    setPreview({ wanted, count, items });
    return fieldsOf(wanted);
  };
  const excluded = () => {
    setNote(`${entrantsText(preview?.count ?? 0)} excluded. Readmit restores one, in the table of entrants.`);
    setPreview(null);
    done();
  };
  return html`<details>
    <summary>Exclude many at once</summary>
    <p class="muted">All active entrants that fit every field that is filled in. First you see who they are.</p>
    <${Form} fields=${fieldsOf({})} label="Show who they are" send=${look} />
    <div role="status">
      ${note && html`<p class="good">${note}</p>`}
      ${preview && html`<p><strong>${preview.count === 0 ? "No active entrant fits" : entrantsText(preview.count)}</strong>: ${words(preview.wanted)}.</p>`}
    </div>
    ${preview &&
    preview.count > 0 &&
    html`<${Found} items=${preview.items} count=${preview.count} />
      <p class="buttons">
        <${ActButton} label=${`Exclude ${entrantsText(preview.count)}`} title=${`Exclude ${entrantsText(preview.count)}?`} reason="required" done=${excluded}
          act=${(/** @type {string} */ reason) => request(path, { method: "POST", body: { ...preview.wanted, count: preview.count, reason } })}>
          <p>They are disqualified: what they play ends, they cannot start attempts, and stay on the board without a rank, with the reason. You can readmit each of them.</p>
          <p>If more or fewer fit by now, nothing is done.</p>
        <//>
      </p>`}
  </details>`;
}

/** @param {number} count */
const entrantsText = (count) => (count === 1 ? "1 entrant" : `${count} entrants`);

/** @param {Description} wanted */
const words = ({ name, address, registered_from, registered_before }) =>
  [
    name && html`name like <${Text} value=${name} />`,
    address && html`from <${Text} value=${address} />`,
    registered_from && html`entered from <${Time} value=${registered_from} both /> on`,
    registered_before && html`entered before <${Time} value=${registered_before} both />`,
  ]
    .filter(Boolean)
    .map((part, index) => html`${index > 0 && ", "}${part}`);

/** @param {{items: any[], count: number}} props */
const Found = ({ items, count }) => html`<div class="scroll found" tabindex="0" role="region" aria-label="Table of entrants that fit">
    <table>
      <thead><tr><th scope="col">Name</th><th scope="col">Model</th><th scope="col">Entered</th></tr></thead>
      <tbody>
        ${items.map(
          (one) => html`<tr key=${one.id}><th scope="row"><${Text} value=${one.name} /></th><td><${Text} value=${one.model} /></td><td><${Time} value=${one.registered_at} /></td></tr>`,
        )}
      </tbody>
    </table>
  </div>
  ${items.length < count && html`<p class="muted">These are the first ${items.length} of ${count}.</p>`}`;
