// Keys for people.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { Secret } from "../parts/copy.js";
import { Form } from "../parts/form.js";
import { More, usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text, visible } from "../parts/text.js";
import { Time } from "../parts/time.js";

/** @type {import("../parts/form.js").Field[]} */
const FIELDS = [
  { name: "name", label: "Whose it is", isRequired: true, max: 100 },
  {
    name: "role",
    label: "Role",
    kind: "choice",
    initial: "member",
    options: [
      ["member", "member: creates games and runs, enters competitions"],
      ["entrant", "entrant: enters competitions and plays their attempts"],
      ["judge", "judge: reads everything but keys and contacts, changes nothing"],
      ["organizer", "organizer: may do everything"],
    ],
  },
  { name: "expires_at", label: "Expires", kind: "time", help: "Left empty: never." },
];

export function View() {
  const list = usePages("/api/v1/keys");
  const [made, setMade] = useState(/** @type {any} */ (null));
  const [showsAll, setShowsAll] = useState(false);
  const items = list.items.filter(({ state }) => showsAll || state === "good") ?? [];
  /** @param {any} body */
  const create = async (body) => {
    setMade(await request("/api/v1/keys", { method: "POST", body }));
    list.reload();
  };
  return html`
    <h2>Keys</h2>
    ${made &&
    html`<div role="status"><${Secret} value=${made.secret} label=${`Key of ${visible(made.name)} (${made.role})`}>
      <p>Give it to its holder by a way that nobody else reads. It cannot be shown again.</p>
    <//></div>`}
    <details><summary>New key</summary><${Form} fields=${FIELDS} label="Create a key" send=${create} /></details>
    <p><label><input type="checkbox" checked=${showsAll} onChange=${(/** @type {any} */ event) => setShowsAll(event.target.checked)} /> Show expired and revoked ones</label></p>
    ${list.problem && html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`}
    <div class="scroll" tabindex="0" role="region" aria-label="Table of keys">
      <table>
        <thead><tr><th scope="col">Holder</th><th scope="col">Role</th><th scope="col">State</th><th scope="col">Created</th><th scope="col">Expires</th><th scope="col">Id</th><th scope="col"><span class="unseen">Revoke</span></th></tr></thead>
        <tbody>
          ${items.map(
            (one) => html`<tr key=${one.id}>
              <th scope="row"><${Text} value=${one.name} /></th>
              <td>${one.role}</td>
              <td>${one.state}${one.revoked_at && html` <${Time} value=${one.revoked_at} />`}</td>
              <td><${Time} value=${one.created_at} /></td>
              <td>${one.expires_at ? html`<${Time} value=${one.expires_at} />` : "never"}</td>
              <td><code class="id">${one.id}</code></td>
              <td>${one.state === "good" && html`<${Revoke} one=${one} done=${list.reload} />`}</td>
            </tr>`,
          )}
        </tbody>
      </table>
    </div>
    <${More} list=${list} />
  `;
}

/** @param {{one: any, done: () => void}} props */
const Revoke = ({ one, done }) => html`<${ActButton}
  label="Revoke"
  of=${`the key of ${visible(one.name)}`}
  title=${html`Revoke the key of <${Text} value=${one.name} />?`}
  act=${() => request(route`/api/v1/keys/${one.id}`, { method: "DELETE" })}
  done=${done}
>
  <p>It is not accepted any more, at once and for ever. Games that were created with it continue, and their tokens stay valid.</p>
  <p class="muted">Where it is the key of this tab, this desk closes.</p>
<//>`;
