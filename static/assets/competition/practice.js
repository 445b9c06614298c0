// Practice: the tasks and settings of a competition on open seeds, with the key of an entrant.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { Form } from "../parts/form.js";
import { visible } from "../parts/text.js";
import { HowToPlay } from "./attempts.js";

/** @param {any[]} entrants @returns {import("../parts/form.js").Field[]} */
const fieldsOf = (entrants) => [
  ...(entrants.length > 1
    ? [{ name: "entrant", label: "For the entrant", kind: /** @type {const} */ ("choice"), initial: entrants[0].id, options: entrants.map(({ id, name }) => /** @type {[string, string]} */ ([id, visible(name)])) }]
    : []),
  { name: "seeds", label: "Seeds", kind: "numbers", placeholder: "1, 2, 3", help: "Up to 10 numbers. Every task is played once on each. Left empty, the server draws one." },
];

/** @param {{competition: any, entrants: any[]}} props entrants: of the key of this tab */
export function Practice({ competition, entrants }) {
  const [started, setStarted] = useState(/** @type {any} */ (null));
  const active = entrants.filter(({ status }) => status === "active");
  if (active.length === 0 || !["announced", "open"].includes(competition.phase)) return null;
  /** @param {{entrant?: string, seeds?: number[]}} body */
  const send = async ({ entrant, seeds }) => {
    setStarted(null);
    const body = { ...(entrant && { entrant }), ...(seeds?.length && { seeds }) };
    setStarted(await request(route`/api/v1/competitions/${competition.id}/practice`, { method: "POST", body }));
  };
  return html`<details>
    <summary>Practise</summary>
    <p class="muted">The same tasks and settings on open seeds. It counts nowhere, and everybody may see the games once they have ended. A practice run that still runs ends when you start another.</p>
    <${Form} fields=${fieldsOf(active)} label="Start a practice run" send=${send} />
    ${started &&
    html`<p>${started.games} games on ${started.seeds.length === 1 ? "the seed" : "the seeds"} ${started.seeds.join(", ")}: <a href=${route`/runs/${started.run}`}>see how they go</a>.</p>
      <${HowToPlay} run=${started.run} token=${started.swarm_token} label="The token of this practice run" />`}
  </details>`;
}
