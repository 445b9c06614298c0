// Changing a competition, cancelling it, and hiding it from lists.
import { html, useState } from "../ui.js";
import { Problem, request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { Form, initialValues, single } from "../parts/form.js";
import { localTime } from "../parts/inputs.js";
import { Text } from "../parts/text.js";

/** @typedef {import("../parts/form.js").Field} Field */

/** The texts of a competition. @param {any} [known] one that is changed @returns {Field[]} */
export const textFields = (known) => [
  { name: "name", label: "Name", isRequired: true, max: 100, initial: known?.name },
  { name: "description", label: "What entrants should know", kind: "long", max: 10_000, initial: known?.description, help: "Plain text; line breaks stay." },
  {
    ...{ name: "terms", label: "Terms that entrants accept", kind: "long", max: 20_000, initial: known?.terms?.text, isRequired: Boolean(known?.terms) },
    help: known
      ? "Another text is their next version. Who has entered keeps the version that it accepted, until it accepts the newest."
      : "Plain text; line breaks stay. Left empty: there is nothing to accept.",
  },
];

/** An end as the form shows it, to the minute. @param {string} name @param {string} label @param {string} end @param {string} [help] @returns {Field} */
const endField = (name, label, end, help) => ({ name, label, kind: "time", isRequired: true, initial: localTime(new Date(end)), help });

/** @param {any} competition @returns {(Field | import("../parts/form.js").Group)[]} */
function changeFields(competition) {
  const { attempts, closes_at, hidden } = competition;
  const ends = attempts.map((window, place) => endField(`attempts[${place}]`, `Attempt ${place + 1} closes`, window.closes_at));
  const hasOwnEnds = attempts.some((window) => window.closes_at !== closes_at);
  return [
    ...textFields(competition),
    endField("closes_at", "Closes", closes_at, "Later only. Games that are open keep the end that they have; games that are opened afterwards have the new one."),
    ...(hasOwnEnds ? [{ legend: "Ends of windows", isFolded: attempts.length > 3, fields: ends }] : []),
    { name: "hidden", label: "In no list but the organizers'", kind: "check", initial: hidden },
    { name: "reason", label: "Reason", max: 500, help: "Everybody may read it." },
  ];
}

/**
 * The changes to a competition. A field that was not typed into is no change: the form rounds the times that it shows.
 * @param {any} base the competition @param {any} body what the form has @param {string[]} typed fields @param {Record<string, any>} values
 */
function changeOf(base, body, typed, values) {
  const own = typed.filter((name) => !name.startsWith("attempts["));
  const change = Object.fromEntries(own.map((name) => [name, name === "closes_at" ? body[name] : values[name]]));
  // Windows that end with the competition follow its new end, unless they got another one.
  const followed = (/** @type {string} */ end) => (end === base.closes_at ? (change.closes_at ?? end) : end);
  const endOf = (/** @type {string} */ name, /** @type {string} */ end) => (typed.includes(name) ? body[name] : followed(end));
  // All windows are sent, so that the server's attempts[1] is attempt 2.
  const ends = base.attempts.map(({ closes_at }, place) => ({ attempt: place + 1, closes_at: endOf(`attempts[${place}]`, closes_at) }));
  return own.length < typed.length ? { ...change, attempts: ends } : change;
}

/** @param {{competition: any, changed: () => void}} props */
export function Change({ competition, changed }) {
  // Typed values survive a reload of the competition.
  const [base, setBase] = useState(competition);
  const path = route`/api/v1/competitions/${base.id}`;
  const send = async (/** @type {any} */ body, /** @type {Record<string, any>} */ values) => {
    const before = initialValues(changeFields(base));
    const typed = Object.keys(before).filter((name) => values[name] !== before[name]);
    if (typed.every((name) => name === "reason")) return { note: "Nothing differs from how it is." };
    const next = { note: "It was changed, and everybody sees what.", values: {} };
    let now;
    try {
      now = await request(path, { method: "PATCH", body: { ...changeOf(base, body, typed, values), if_revision: base.revision } });
    } catch (error) {
      if (!(error instanceof Problem && error.code === "changed")) throw error;
      now = await request(path);
      const after = initialValues(changeFields(now));
      const theirs = single(changeFields(now)).filter(({ name }) => after[name] !== before[name]).map(({ label }) => label);
      next.note = `Nothing was changed yet: another organizer has changed it meanwhile (${theirs.join(", ") || "a window"}). The form has that now, and what you typed. Send it again if it is still right.`;
      next.values = Object.fromEntries(typed.filter((name) => name in after).map((name) => [name, values[name]]));
    }
    setBase(now);
    changed();
    return { ...next, values: { ...initialValues(changeFields(now)), ...next.values } };
  };
  return html`<details>
    <summary>Change it: later ends, other texts</summary>
    <p class="muted">Nothing is ever shortened, and what is played never changes.</p>
    <${Form} fields=${changeFields(base)} label="Change the competition" send=${send} />
  </details>`;
}

/** Ends a competition early. @param {{competition: any, changed: () => void}} props */
export const Cancel = ({ competition: { id, name }, changed }) => html`<${ActButton} label="Cancel the competition"
  title=${html`Cancel <${Text} value=${name} />?`} reason="required" dismiss="Keep it" done=${changed}
  act=${(reason) => request(route`/api/v1/competitions/${id}/cancel`, { method: "POST", body: { reason } })}
  text="Nobody enters or starts an attempt any more, and attempts that run end at once. Its seeds are published at the time at which it would have closed. This cannot be undone." />`;

/** Hides a finished competition from lists, or shows it. @param {{competition: any, changed: () => void}} props */
export const Listing = ({ competition: { id, name, hidden }, changed }) => html`<${ActButton} label=${hidden ? "Show in lists" : "Hide from lists"}
  title=${html`${hidden ? "Show" : "Hide"} <${Text} value=${name} />?`} reason="optional" isDangerous=${false} done=${changed}
  act=${(reason) => request(route`/api/v1/competitions/${id}`, { method: "PATCH", body: { hidden: !hidden, ...(reason && { reason }) } })}
  text=${`Who has its address finds it in any case, and everybody sees that it was ${hidden ? "shown again" : "hidden"}.`} />`;
