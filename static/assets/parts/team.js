// The members of an entrant's team, each with a key of its own.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { ActButton } from "./act.js";
import { Made } from "./copy.js";
import { Form } from "./form.js";
import { Items, unseen } from "./listed.js";
import { useLoaded } from "./load.js";
import { ProblemNote } from "./problem.js";
import { Text, visible } from "./text.js";
import { Time } from "./time.js";

/** @param {{path: string, mayAdd: boolean, mayRemove?: boolean}} props path: of the entrant in the API */
export function Team({ path, mayAdd, mayRemove = true }) {
  const { value, problem, reload } = useLoaded((signal) => request(`${path}/members`, { signal }), [path]);
  const [made, setMade] = useState(/** @type {any} */ (null));
  const add = async (/** @type {{name: string}} */ body) => {
    setMade(await request(`${path}/members`, { method: "POST", body }));
    reload();
  };
  const field = { name: "name", label: "Name of the member", isRequired: true, max: 100, help: "The team, organizers and judges see it." };
  const items = value?.items ?? [];
  const count = items.filter((one) => !one.removed_at).length;
  const member = (/** @type {any} */ { name, added_at, removed_at }) => html`<${Text} value=${name} />
    <div class="small muted">added <${Time} value=${added_at} /></div>
    ${removed_at && html`<div class="small">removed <${Time} value=${removed_at} /></div>`}`;
  const remove = (/** @type {any} */ { id, name, removed_at }) =>
    mayRemove && !removed_at && html`<${ActButton} label="Remove" of=${visible(name)} title=${html`Remove <${Text} value=${name} /> from the team?`} done=${reload}
      act=${() => request(path + route`/members/${id}`, { method: "DELETE" })}
      text="The key is not accepted any more, at once and for ever, and neither are the tokens of attempts that run: make a new one for each." />`;
  return html`<details class="fields">
    <summary>Team${value && html`: ${count} ${count === 1 ? "member" : "members"} beside the one who entered`}</summary>
    <p class="muted">The key of a member does what the entrant's own key does: it starts attempts, changes the entrant, and adds members. Only the key that entered erases the entrant, or removes others.</p>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    <${Made} value=${made?.key} label=${`The key of ${visible(made?.name)}`} to="the member" />
    ${items.length > 0 && html`<${Items} items=${items} label="Table of members" columns=${[["Member", member], [unseen("Remove"), remove]]} look=${(one) => one.removed_at && "out"} />`}
    ${mayAdd && html`<${Form} fields=${[field]} label="Add a member" send=${add} />`}
  </details>`;
}
