// Announcements to all who follow a competition.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { Form } from "../parts/form.js";

/** @type {import("../parts/form.js").Field[]} */
const FIELDS = [
  { name: "text", label: "Announcement", kind: "long", isRequired: true, max: 2000, help: "It is shown above the standings and stays as it is: correct a mistake by another one." },
];

/** @param {{id: string, changed: () => void}} props */
export function Announce({ id, changed }) {
  const [note, setNote] = useState("");
  /** @param {{text: string}} body */
  const send = async (body) => {
    setNote("");
    await request(route`/api/v1/competitions/${id}/announcements`, { method: "POST", body });
    setNote("It was announced.");
    changed();
  };
  return html`<h3>Announce</h3>
    <${Form} fields=${FIELDS} label="Announce" send=${send} />
    <p class="good" role="status">${note}</p>`;
}
