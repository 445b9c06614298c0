// One competition for organizers: codes, entrants, attempts, the file.
import { html } from "../ui.js";
import { request, route } from "../api.js";
import { Copyable } from "../parts/copy.js";
import { Download } from "../parts/download.js";
import { useLoaded } from "../parts/load.js";
import { Actions } from "../parts/organizers.js";
import { usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Countdown } from "../parts/time.js";
import { Announce } from "./announce.js";
import { Attempts } from "./attempts.js";
import { Change, Listing } from "./change.js";
import { Codes } from "./codes.js";
import { Entrants } from "./entrants.js";
import { Exclude } from "./exclude.js";

const REFRESH_MS = 10_000;

/** @param {{query: URLSearchParams}} props */
export function View({ query }) {
  const id = query.get("id") ?? "";
  const { value, problem, reload } = useLoaded((signal) => request(route`/api/v1/competitions/${id}`, { signal }), [id], REFRESH_MS);
  const entrants = usePages(route`/api/v1/competitions/${id}/entrants`);
  const actions = usePages(route`/api/v1/competitions/${id}/actions`, REFRESH_MS);
  const names = new Map(entrants.items.map((one) => [one.id, one.name]));
  const isOpen = value?.phase === "announced" || value?.phase === "open";
  const changed = () => {
    reload();
    actions.reload();
  };
  const entrantsChanged = () => {
    entrants.reload();
    actions.reload();
  };
  if (!value) {
    return problem
      ? html`<${ProblemNote} problem=${problem} retry=${reload} what="This competition" />`
      : html`<p class="muted" role="status">Loading …</p>`;
  }
  const next = value.phase === "announced" ? ["opens", value.opens_at] : value.phase === "open" ? ["closes", value.closes_at] : null;
  return html`
    <h2><${Text} value=${value.name} /></h2>
    <p>
      <span class="badge">${value.phase}</span> ${next && html`${next[0]} <${Countdown} value=${next[1]} />. `}
      <a href=${`/competitions/${encodeURIComponent(id)}`}>Its page, as others see it</a>
      ${value.hidden && html` <span class="badge">hidden</span>`}
      ${value.cancel_reason && html`<br />The reason: <${Text} value=${value.cancel_reason} />`}
    </p>
    <p>
      Publish the commitment where you cannot change it unnoticed: <${Copyable} value=${value.commitment} label="the commitment" />
    </p>
    ${isOpen ? html`<${Change} key=${id} competition=${value} changed=${changed} />` : html`<${Listing} competition=${value} changed=${changed} />`}
    <${Announce} id=${id} changed=${changed} />
    ${value.entry === "codes" && html`<${Codes} id=${id} names=${names} mayMake=${isOpen} />`}
    <h3>Entrants</h3>
    <p class="buttons"><${Download} href=${`${route`/api/v1/competitions/${id}/contacts`}?format=csv`} name=${`${id}-contacts.csv`}>Contacts as CSV<//></p>
    <${Entrants} competition=${value} list=${{ ...entrants, reload: entrantsChanged }} />
    ${entrants.items.length > 0 && html`<${Exclude} id=${id} done=${entrantsChanged} />`}
    <h3>Attempts</h3>
    <${Attempts} competition=${value} names=${names} />
    <h3>What organizers did</h3>
    <p class="muted">Everybody sees this on the page of the competition. The <a href="/desk?view=audit">audit log</a> also says who did it.</p>
    <${Actions} list=${actions} names=${names} />
    <h3>The file</h3>
    <p>
      ${value.revealed_at
        ? "It is public: it has all seeds, journals and the board, and anybody can check it."
        : "It has the sealed seeds: keep it to yourself until everything is revealed. This download is written to the audit log."}${" "}
      Everything is revealed by itself when the last game has ended. Nobody can do that earlier.
    </p>
    <p class="buttons">
      <${Download} href=${route`/api/v1/exports/competitions/${id}`} name=${`${id}.jsonl`}>Download the file<//>
      <${Download} href=${`${route`/api/v1/competitions/${id}/board`}?format=csv`} name=${`${id}.csv`}>Board as CSV<//>
    </p>
  `;
}
