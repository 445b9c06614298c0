// Entrants of a competition: their details, and the changes that organizers make to one or to many of them.
import { html, useLayoutEffect, useRef, useState } from "../ui.js";
import { Problem, request, route, sleep } from "../api.js";
import { ActButton, ActMenu } from "../parts/act.js";
import { Copyable, Made } from "../parts/copy.js";
import { Form } from "../parts/form.js";
import { Items, unseen, useFilter } from "../parts/listed.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { Shown } from "../parts/table.js";
import { Team } from "../parts/team.js";
import { Name, Text, visible } from "../parts/text.js";
import { Time } from "../parts/time.js";

/** The maximum number of names in a dialog: what will happen stays in sight above them. */
const NAMES_SHOWN = 10;

/** @param {any} one */
const statusOf = (one) => (one.erased ? "erased" : one.status);

/** @param {number} count */
const entrantsText = (count) => (count === 1 ? "1 entrant" : `${count} entrants`);

/** The accepted version of the terms. @param {number | null} accepted @param {number} newest */
const termsText = (accepted, newest) => (accepted ? `version ${accepted}${accepted === newest ? "" : ` of ${newest}`}` : "none accepted");

/** Changes of one entrant or of many: for which ones, and what will happen. */
const CHANGES = [
  { label: "Vouch for", fits: (one) => !one.vouched && !one.erased, body: { vouched: true }, isDangerous: false, text: "Boards say from then on that you know that the declared model plays." },
  { label: "Stop vouching for", fits: (one) => one.vouched, body: { vouched: false }, isDangerous: false, text: "Boards no longer say that you know that the declared model plays." },
  { label: "Readmit", fits: (one) => one.status !== "active" && !one.erased, body: { status: "active" }, isDangerous: false, text: "Who is readmitted has a rank again, and can start attempts while the competition is open." },
  { label: "Withdraw", fits: (one) => one.status === "active", body: { status: "withdrawn" }, reason: "optional", text: "Who is withdrawn cannot start attempts, and stays on the board without a rank. You can readmit each." },
  { label: "Disqualify", fits: (one) => one.status === "active", body: { status: "disqualified" }, reason: "required", text: "What is played ends, and no attempts can be started. Who is disqualified stays on the board without a rank, with the reason. You can readmit each." },
];

/** @param {{competition: any, items: any[], mayChange: boolean, done: () => void}} props items: all entrants */
export function Entrants({ competition, items, mayChange, done }) {
  const { id, categories, terms } = competition;
  const [made, setMade] = useState(/** @type {{name: string, key: string} | null} */ (null));
  const [detailed, setDetailed] = useState("");
  const [chosen, setChosen] = useState(/** @type {Set<string>} */ (new Set()));
  const opener = useRef(/** @type {HTMLElement | null} */ (null));
  const textOf = (/** @type {any} */ one) => [one.name, one.model, one.category, one.reason, one.id].join("\n");
  const { shown, inputs } = useFilter(items, { name: "entrants", textOf, statusOf, placeholder: "a name, a model, a reason" });
  const one = items.find((entrant) => entrant.id === detailed);
  const show = (/** @type {string} */ entrant) => (/** @type {any} */ event) => {
    opener.current = event.currentTarget.closest("td").querySelector("button");
    setDetailed(entrant);
  };
  const close = () => {
    setDetailed("");
    opener.current?.focus();
  };
  if (items.length === 0) return html`<p class="empty">Nobody has entered.</p>`;
  const areAllChosen = shown.length > 0 && shown.every(({ id }) => chosen.has(id));
  const choose = (/** @type {any[]} */ some, /** @type {boolean} */ isOn) =>
    setChosen(isOn ? new Set([...chosen, ...some.map(({ id }) => id)]) : new Set([...chosen].filter((id) => !some.some((one) => one.id === id))));
  const tick = (/** @type {string} */ name, /** @type {any[]} */ some, /** @type {boolean} */ isOn) =>
    html`<input type="checkbox" aria-label=${name} checked=${isOn} onChange=${() => choose(some, !isOn)} />`;
  const columns = [
    mayChange && [html`<th scope="col">${tick("Choose all that fit", shown, areAllChosen)}</th>`, (one) => tick(`Choose ${visible(one.name)}`, [one], chosen.has(one.id))],
    ["Name and model", (one) => html`<${Name} value=${one.name} />${one.vouched && html` <span class="badge">vouched</span>`}
      <div class="small muted"><${Name} value=${one.model} /></div>`],
    categories.length > 0 && ["Category", (one) => html`<${Text} value=${one.category} />`],
    terms && ["Terms", (one) => html`<span class="nowrap">${termsText(one.terms, terms.version)}</span>`],
    ["Status", (one) => html`${one.status === "active" ? "active" : html`<span class="badge">${statusOf(one)}</span>`}
      ${one.reason && html`<div class="small"><${Text} value=${one.reason} /></div>`}`],
    ["Entered", (one) => html`<${Time} value=${one.registered_at} />`],
    [unseen("Actions"), (one) => html`<${ActMenu} of=${visible(one.name)} acts=${mayChange ? actsOf(id, one, setMade) : []} done=${done}>
      <button type="button" onClick=${show(one.id)}>Details</button>
    <//>`],
  ];
  const table = (/** @type {any[]} */ some) =>
    html`<${Items} items=${some} label="Table of entrants" columns=${columns} header=${mayChange ? 1 : 0} look=${(one) => one.status !== "active" && "out"} />`;
  return html`
    <${Made} value=${made?.key} label=${`The new key of ${visible(made?.name)}`} to="the entrant"><p>The earlier key is not accepted any more.</p><//>
    ${one && html`<${Details} key=${one.id} competition=${competition} one=${one} mayChange=${mayChange} done=${done} close=${close} />`}
    ${inputs}
    ${mayChange && html`<${Many} id=${id} chosen=${items.filter((one) => chosen.has(one.id))} clear=${() => setChosen(new Set())} done=${done} />`}
    <${Shown} items=${shown} wrap=${table} />`;
}

/** Changes of the entrants that are chosen. @param {{id: string, chosen: any[], clear: () => void, done: () => void}} props */
function Many({ id, chosen, clear, done }) {
  /** @param {any[]} fitting @param {object} body */
  const changeAll = async (fitting, body) => {
    const failed = [];
    for (const one of fitting) await change(id, one, body).catch((error) => failed.push(`${one.name}: ${error.message}`));
    done();
    if (failed.length > 0) throw new Problem(0, { detail: `${fitting.length - failed.length} of ${fitting.length} were changed. ${failed.join("; ")}` });
    clear();
  };
  return html`<p class="buttons many">
    <span role="status" class="muted">${chosen.length > 0 && `${chosen.length} chosen`}</span>
    ${CHANGES.map(({ label, fits, body, ...act }) => {
      const fitting = chosen.filter(fits);
      return fitting.length > 0 && html`<${ActButton} key=${label} label=${`${label} ${entrantsText(fitting.length)}`} ...${act}
        act=${(/** @type {string} */ reason) => changeAll(fitting, { ...body, ...(reason && { reason }) })}>
        <p><${Text} value=${fitting.slice(0, NAMES_SHOWN).map(({ name }) => name).join(", ")} />${fitting.length > NAMES_SHOWN && `, and ${fitting.length - NAMES_SHOWN} more`}</p>
      <//>`;
    })}
    ${chosen.length > 0 && html`<button type="button" class="quiet" onClick=${clear}>Choose none</button>`}
  </p>`;
}

/** Changes an entrant, again where that came too fast. @param {string} id @param {any} one @param {object} body @returns {Promise<void>} */
async function change(id, one, body) {
  try {
    await request(route`/api/v1/competitions/${id}/entrants/${one.id}`, { method: "PATCH", body });
  } catch (error) {
    if (!(error instanceof Problem && error.status === 429)) throw error;
    await sleep(error.retryAfterMs ?? 1000);
    await change(id, one, body);
  }
}

/** The acts of an entrant's menu. @param {string} id @param {any} one @param {(made: {name: string, key: string}) => void} setMade */
const actsOf = (id, one, setMade) => [
  ...CHANGES.filter(({ fits }) => fits(one)).map(({ label, body, ...act }) => ({
    ...act,
    label: label.replace(/ for$/, ""),
    title: html`${label} <${Text} value=${one.name} />?`,
    act: (/** @type {string} */ reason) => change(id, one, { ...body, ...(reason && { reason }) }),
  })),
  !one.erased && {
    label: "Replace the key",
    title: html`Replace the key of <${Text} value=${one.name} />?`,
    act: async () => setMade({ name: one.name, ...(await request(route`/api/v1/competitions/${id}/entrants/${one.id}/key`, { method: "POST" })) }),
    text: "For an entrant that has lost its key. The earlier key is not accepted any more, at once and for ever; attempts that run keep their tokens.",
    children: html`<p class="muted">Only a key that was made when it entered can be replaced here. Who entered with a key of its own gets another one under Keys.</p>`,
  },
];

/** An entrant's contact, team and category. @param {{competition: any, one: any, mayChange: boolean, done: () => void, close: () => void}} props */
function Details({ competition, one, mayChange, done, close }) {
  const { id, categories, terms, revealed_at, cancelled_at } = competition;
  const panel = useRef(/** @type {HTMLElement | null} */ (null));
  const path = route`/api/v1/competitions/${id}/entrants/${one.id}`;
  const { value, problem, reload } = useLoaded((signal) => request(path, { signal }), [path]);
  useLayoutEffect(() => panel.current?.focus(), []);
  const maySet = mayChange && !revealed_at && !cancelled_at && !one.erased;
  const options = categories.map((name) => [name, visible(name)]);
  const category = { name: "category", label: "Category", kind: "choice", initial: one.category, options, help: "Everybody sees that you have changed it." };
  const move = async (/** @type {{category: string}} */ body, /** @type {any} */ values) => {
    if (body.category === one.category) return { note: "It is in this category." };
    await request(path, { method: "PATCH", body });
    done();
    return { note: "It was moved.", values };
  };
  return html`<section class="inset" ref=${panel} tabindex="-1" aria-labelledby="details">
    <h4 id="details">Details of <${Text} value=${one.name} />${one.erased && html` <span class="badge">erased</span>`}</h4>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    <dl class="facts">
      ${mayChange && html`<dt>Contact</dt><dd>${value?.contact ? html`<${Text} value=${value.contact} />` : value ? "none" : "…"}</dd>`}
      <dt>Id</dt>
      <dd><${Copyable} value=${one.id} label="the id" /></dd>
      ${terms && html`<dt>Terms</dt><dd>${termsText(one.terms, terms.version)}</dd>`}
    </dl>
    ${maySet && categories.length > 0 && html`<${Form} label="Move it" send=${move} fields=${[category]} />`}
    <${Team} path=${path} mayAdd=${maySet && one.status === "active"} mayRemove=${mayChange} />
    <p class="buttons"><button type="button" onClick=${close}>Close the details</button></p>
  </section>`;
}

/** @type {import("../parts/form.js").Field[]} */
const EXCLUDED_FIELDS = [
  { name: "name", label: "Name", max: 100, placeholder: "bot-*", help: "A pattern: * stands for any characters, ? for one. Upper and lower case are the same." },
  { name: "address", label: "Address or network from which they entered", placeholder: "203.0.113.7 or 2001:db8::/32" },
  { name: "registered_from", label: "Entered from", kind: "time" },
  { name: "registered_before", label: "Entered before", kind: "time" },
];

/** Excludes many entrants at once: first a preview, then the act. @param {{id: string, done: () => void}} props */
export function Exclude({ id, done }) {
  const [preview, setPreview] = useState(/** @type {{wanted: any, count: number, items: any[]} | null} */ (null));
  const [note, setNote] = useState("");
  const path = route`/api/v1/competitions/${id}/exclusions`;
  const look = async (/** @type {any} */ wanted, /** @type {any} */ values) => {
    setNote("");
    setPreview({ wanted, ...(await request(path, { method: "POST", body: wanted })) });
    return { values };
  };
  const excluded = () => {
    setNote(`${entrantsText(preview?.count ?? 0)} excluded. Readmit restores one, in the table of entrants.`);
    setPreview(null);
    done();
  };
  return html`<details>
    <summary>Disqualify by name, address or time of entry</summary>
    <p class="muted">All active entrants that fit every field that is filled in. First you see who they are.</p>
    <${Form} fields=${EXCLUDED_FIELDS} label="Show who they are" send=${look} />
    <div role="status">
      ${note && html`<p class="good">${note}</p>`}
      ${preview && html`<p><strong>${preview.count === 0 ? "No active entrant fits" : entrantsText(preview.count)}</strong>: ${words(preview.wanted)}.</p>`}
    </div>
    ${preview && preview.count > 0 && html`<${Items} items=${preview.items} label="Table of entrants that fit" columns=${[
        ["Name", (one) => html`<${Text} value=${one.name} />`],
        ["Model", (one) => html`<${Text} value=${one.model} />`],
        ["Entered", (one) => html`<${Time} value=${one.registered_at} />`],
      ]} />
      ${preview.items.length < preview.count && html`<p class="muted">These are the first ${preview.items.length} of ${preview.count}.</p>`}
      <p class="buttons">
        <${ActButton} label=${`Exclude ${entrantsText(preview.count)}`} reason="required" done=${excluded}
          act=${(/** @type {string} */ reason) => request(path, { method: "POST", body: { ...preview.wanted, count: preview.count, reason } })}>
          <p>They are disqualified: what they play ends, they cannot start attempts, and stay on the board without a rank, with the reason. You can readmit each of them.</p>
          <p>If more or fewer fit by now, nothing is done.</p>
        <//>
      </p>`}
  </details>`;
}

/** The entrants that are wanted, in words. @param {{name?: string, address?: string, registered_from?: string, registered_before?: string}} wanted */
const words = ({ name, address, registered_from, registered_before }) =>
  [
    name && html`name like <${Text} value=${name} />`,
    address && html`from <${Text} value=${address} />`,
    registered_from && html`entered from <${Time} value=${registered_from} both /> on`,
    registered_before && html`entered before <${Time} value=${registered_before} both />`,
  ].filter(Boolean).map((part, index) => html`${index > 0 && ", "}${part}`);
