// The members of an entrant's team, each with a key of its own.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { ActButton } from "./act.js";
import { Secret } from "./copy.js";
import { Form } from "./form.js";
import { useLoaded } from "./load.js";
import { ProblemNote } from "./problem.js";
import { Text, visible } from "./text.js";
import { Time } from "./time.js";

/** @type {import("./form.js").Field[]} */
const FIELDS = [{ name: "name", label: "Name of the member", isRequired: true, max: 100, help: "The team, organizers and judges see it." }];

/** @param {{path: string, mayAdd: boolean}} props path: of the entrant in the API */
export function Team({ path, mayAdd }) {
  const { value, problem, reload } = useLoaded((signal) => request(`${path}/members`, { signal }), [path]);
  const [made, setMade] = useState(/** @type {any} */ (null));
  /** @param {{name: string}} body */
  const add = async (body) => {
    setMade(await request(`${path}/members`, { method: "POST", body }));
    reload();
  };
  const items = value?.items ?? [];
  const count = items.filter((/** @type {any} */ one) => !one.removed_at).length;
  return html`<details class="fields">
    <summary>Team${value && html`: ${count} ${count === 1 ? "member" : "members"} beside the one who entered`}</summary>
    <p class="muted">The key of a member does what the entrant's own key does: it starts attempts, changes the entrant, and adds members. Only the key that entered erases the entrant, or removes others.</p>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    <div role="status">
      ${made &&
      html`<${Secret} value=${made.key} label=${`The key of ${visible(made.name)}`}>
        <p>Give it to the member by a way that nobody else reads. It cannot be shown again.</p>
      <//>`}
    </div>
    ${items.length > 0 &&
    html`<div class="scroll" tabindex="0" role="region" aria-label="Table of members">
      <table>
        <thead><tr><th scope="col">Member</th><th scope="col"><span class="unseen">Remove</span></th></tr></thead>
        <tbody>${items.map((/** @type {any} */ one) => html`<${Member} key=${one.id} path=${path} one=${one} done=${reload} />`)}</tbody>
      </table>
    </div>`}
    ${mayAdd && html`<${Form} fields=${FIELDS} label="Add a member" send=${add} />`}
  </details>`;
}

/** @param {{path: string, one: any, done: () => void}} props */
const Member = ({ path, one, done }) => html`<tr class=${one.removed_at ? "out" : ""}>
  <th scope="row">
    <${Text} value=${one.name} />
    <div class="small muted">added <${Time} value=${one.added_at} /></div>
    ${one.removed_at && html`<div class="small">removed <${Time} value=${one.removed_at} /></div>`}
  </th>
  <td>
    ${!one.removed_at &&
    html`<${ActButton} label="Remove" of=${visible(one.name)} title=${html`Remove <${Text} value=${one.name} /> from the team?`} done=${done}
        act=${() => request(path + route`/members/${one.id}`, { method: "DELETE" })}>
        <p>The key is not accepted any more, at once and for ever, and neither are the tokens of attempts that run: make a new one for each.</p>
      <//>`}
  </td>
</tr>`;
