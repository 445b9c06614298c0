// One competition for organizers and judges: announcements, codes, entrants, attempts, the file.
import { html, useState } from "../ui.js";
import { request, route } from "../api.js";
import { ActMenu } from "../parts/act.js";
import { Commands, Copyable } from "../parts/copy.js";
import { Download } from "../parts/download.js";
import { Form } from "../parts/form.js";
import { ListTable, unseen } from "../parts/listed.js";
import { useLoaded } from "../parts/load.js";
import { Actions } from "../parts/organizers.js";
import { eachPage, usePages } from "../parts/pages.js";
import { Waiting } from "../parts/problem.js";
import { Text, visible } from "../parts/text.js";
import { Countdown, Time } from "../parts/time.js";
import { Cancel, Change, Listing } from "./change.js";
import { Entrants, Exclude } from "./entrants.js";
import { Attempts } from "./played.js";

const REFRESH_MS = 10_000;

/** The maximum number of entrants in an answer. */
const WHOLE_ROWS = 1000;

/** The number of codes shown at first; more on request. */
const PAGE_CODES = 50;

/** @param {{query: URLSearchParams, mayChange: boolean}} props */
export function Competition({ query, mayChange }) {
  const id = query.get("id") ?? "";
  const path = route`/api/v1/competitions/${id}`;
  const loaded = useLoaded((signal) => request(path, { signal }), [id], REFRESH_MS);
  const entrants = useLoaded(async (signal) => {
    const items = [];
    await eachPage(`${path}/entrants`, { limit: WHOLE_ROWS }, signal, (page) => void items.push(...page.items));
    return items;
  }, [id]);
  const actions = usePages(`${path}/actions`, REFRESH_MS);
  const { value } = loaded;
  if (!value) return html`<${Waiting} of=${loaded} what="This competition" />`;
  const items = entrants.value ?? [];
  const names = new Map(items.map((one) => [one.id, one.name]));
  const changed = () => (loaded.reload(), actions.reload());
  const entrantsChanged = () => (entrants.reload(), actions.reload());
  const isOpen = value.phase === "announced" || value.phase === "open";
  const next = value.phase === "announced" ? ["opens", value.opens_at] : ["closes", value.closes_at];
  return html`
    <h2><${Text} value=${value.name} /></h2>
    <p>
      <span class="badge">${value.phase}</span> ${isOpen && html`${next[0]} <${Countdown} value=${next[1]} isAhead />. `}
      <a href=${route`/competitions/${id}`}>Its page, as others see it</a>
      ${value.hidden && html` <span class="badge">hidden</span>`}
      ${value.cancel_reason && html`<br />The reason: <${Text} value=${value.cancel_reason} />`}
    </p>
    ${mayChange && isOpen && html`<p>Publish the commitment where you cannot change it unnoticed: <${Copyable} value=${value.commitment} label="the commitment" /></p>`}
    ${mayChange && html`<${Announce} path=${path} changed=${changed} />${isOpen && html`<${Change} key=${id} competition=${value} changed=${changed} />`}
      <p class="buttons"><${isOpen ? Cancel : Listing} competition=${value} changed=${changed} /></p>`}
    ${value.entry === "codes" && html`<${Codes} path=${`${path}/codes`} names=${names} mayMake=${mayChange && isOpen} />`}
    <h3>Entrants</h3>
    ${entrants.value
      ? html`<${Entrants} competition=${value} items=${items} mayChange=${mayChange} done=${entrantsChanged} />`
      : html`<${Waiting} of=${entrants} />`}
    ${mayChange && items.length > 0 && html`<${Exclude} id=${id} done=${entrantsChanged} />
      <p class="buttons"><${Download} href=${`${path}/contacts?format=csv`} name=${`${id}-contacts.csv`}>Contacts as CSV<//></p>`}
    <h3>Attempts</h3>
    <${Attempts} competition=${value} names=${names} mayChange=${mayChange} />
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
      <${Download} href=${`${path}/board?format=csv`} name=${`${id}.csv`}>Board as CSV<//>
    </p>
  `;
}

/** Announces something to all who follow a competition. @param {{path: string, changed: () => void}} props */
function Announce({ path, changed }) {
  const send = async (/** @type {{text: string}} */ body) => {
    await request(`${path}/announcements`, { method: "POST", body });
    changed();
    return { note: "It was announced." };
  };
  const help = "It is shown above the standings and stays as it is: correct a mistake by another one.";
  return html`<details>
    <summary>Announce something</summary>
    <${Form} fields=${[{ name: "text", label: "Announcement", kind: "long", isRequired: true, max: 2000, help }]} label="Announce" send=${send} />
  </details>`;
}

/** Invitation codes. @param {{path: string, names: Map<string, string>, mayMake: boolean}} props */
function Codes({ path, names, mayMake }) {
  const [made, setMade] = useState(/** @type {{label: string, code: string}[]} */ ([]));
  const list = usePages(`${path}?limit=${PAGE_CODES}`);
  const create = async (/** @type {any} */ body) => {
    setMade((await request(path, { method: "POST", body })).items);
    list.reload();
  };
  const help = "Organizers alone see them. Each gets a code, which is valid for one entrant.";
  const labels = { name: "labels", label: "Receivers, one a line", kind: "lines", isRequired: true, placeholder: "team blue\nteam red", help };
  const revoke = (/** @type {string} */ label) => ({
    ...{ label: "Revoke", act: () => request(`${path}/revoke`, { method: "POST", body: { labels: [label] } }) },
    text: "Nobody can enter with them any more: with no unused code that has this label. This cannot be taken back; you can make a new code.",
  });
  return html`<h3>Invitation codes</h3>
    ${made.length > 0 &&
    html`<div class="inset" role="status">
      <p><strong>New codes</strong> <span class="badge">shown once</span></p>
      <${Commands} lines=${made.map(({ label, code }) => `${label}\t${code}`)} label="New codes" what="all codes" />
    </div>`}
    <${ListTable} list=${list} label="Table of codes"
      filter=${{ name: "codes", textOf: (one) => one.label, statusOf: (one) => one.state, label: "State", placeholder: "a receiver" }}
      columns=${[
        ["Receiver", (one) => html`<${Text} value=${one.label} />`],
        ["State", (one) => html`${one.state}${one.revoked_at && html` <${Time} value=${one.revoked_at} />`}`],
        ["Used by", (one) => (one.entrant ? html`<${Text} value=${names.get(one.entrant) ?? one.entrant} />` : html`<span class="muted">–</span>`)],
        ["Made", (one) => html`<${Time} value=${one.created_at} />`],
        [unseen("Actions"), ({ label, state }) => html`<${ActMenu} of=${`codes of ${visible(label)}`} done=${list.reload}
          acts=${[mayMake && state === "unused" && revoke(label)]} />`],
      ]} />
    ${mayMake && html`<${Form} fields=${[labels]} label="Make codes" send=${create} />`}`;
}
