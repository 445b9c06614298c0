// Invitation codes.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { Commands } from "../parts/copy.js";
import { Form } from "../parts/form.js";

/** @type {import("../parts/form.js").Field[]} */
const FIELDS = [
  { name: "labels", label: "Receivers, one a line", kind: "lines", isRequired: true, placeholder: "team blue\nteam red", help: "Organizers alone see them. Each gets a code, which is valid for one entrant." },
];

/** @param {{id: string}} props */
export function Codes({ id }) {
  const [made, setMade] = useState(/** @type {{label: string, code: string}[]} */ ([]));
  /** @param {any} body */
  const create = async (body) => {
    const { items } = await request(route`/api/v1/competitions/${id}/codes`, { method: "POST", body });
    setMade(items);
  };
  return html`<h3>Invitation codes</h3>
    ${made.length > 0 &&
    html`<div class="inset" role="status">
      <p><strong>New codes</strong> <span class="badge">shown once</span></p>
      <${Commands} lines=${made.map(({ label, code }) => `${label}\t${code}`)} label="New codes" what="all codes" />
    </div>`}
    <${Form} fields=${FIELDS} label="Make codes" send=${create} />`;
}
