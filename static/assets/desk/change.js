// Changing a competition, and cancelling it.
import { html, useState } from "../ui.js";
import { Problem, request, route } from "../api.js";
import { ActButton } from "../parts/act.js";
import { Form } from "../parts/form.js";
import { localTime } from "../parts/inputs.js";
import { Text } from "../parts/text.js";
import { TERMS_CHARS_MAX } from "./fields.js";

/** @typedef {import("../parts/form.js").Field} Field */

/** An end as the form shows it, to the minute. @param {string} time */
const shownEnd = (time) => localTime(new Date(time));

/** @param {any} competition */
const hasOwnEnds = ({ attempts, closes_at }) => attempts.some((window) => window.closes_at !== closes_at);

/** @param {any} competition @returns {(Field | import("../parts/form.js").Group)[]} */
const fieldsOf = (competition) => [
  { name: "name", label: "Name", isRequired: true, max: 100, initial: competition.name },
  { name: "description", label: "What entrants should know", kind: "long", max: 10_000, initial: competition.description },
  { name: "terms", label: "Terms that entrants accept", kind: "long", max: TERMS_CHARS_MAX, initial: competition.terms?.text, isRequired: Boolean(competition.terms), help: "Another text is their next version. Who has entered keeps the version that it accepted, until it accepts the newest." },
  { name: "closes_at", label: "Closes", kind: "time", isRequired: true, initial: shownEnd(competition.closes_at), help: "Later only. Games that are open keep the end that they have; games that are opened afterwards have the new one." },
  ...(hasOwnEnds(competition) ? [{ legend: "Ends of windows", isFolded: competition.attempts.length > 3, fields: competition.attempts.map(windowField) }] : []),
  { name: "hidden", label: "In no list but the organizers'", kind: "check", initial: competition.hidden },
  { name: "reason", label: "Reason", max: 500, help: "Everybody may read it." },
];

/** @param {any} window @param {number} place @returns {Field} */
const windowField = (window, place) => ({
  name: `attempts[${place}]`,
  label: `Attempt ${place + 1} closes`,
  kind: "time",
  isRequired: true,
  initial: shownEnd(window.closes_at),
});

/** End from the form. An unchanged field keeps the exact time, which the form rounds. @param {string} typed @param {string} known */
const endOf = (typed, known) => (shownEnd(typed) === shownEnd(known) ? known : typed);

/** The changes to a competition. @param {any} competition @param {any} body what the form has */
export function changeOf(competition, body) {
  const closes_at = endOf(body.closes_at, competition.closes_at);
  const description = body.description ?? "";
  const hidden = body.hidden ?? false;
  const terms = body.terms ?? "";
  // Windows that end with the competition follow its new end, unless they got another one.
  const followed = (/** @type {string} */ end) => (end === competition.closes_at ? closes_at : end);
  const ends = competition.attempts.map((window, place) => endOf(body[`attempts[${place}]`] ?? window.closes_at, window.closes_at));
  const hasEnds = ends.some((end, place) => end !== competition.attempts[place].closes_at);
  return {
    ...(body.name !== competition.name && { name: body.name }),
    ...(description !== competition.description && { description }),
    ...(terms !== (competition.terms?.text ?? "") && { terms }),
    ...(closes_at !== competition.closes_at && { closes_at }),
    // All windows are sent, so that the server's attempts[1] is attempt 2.
    ...(hasEnds && { attempts: ends.map((end, place) => ({ attempt: place + 1, closes_at: followed(end) })) }),
    ...(hidden !== competition.hidden && { hidden }),
    ...(body.reason && { reason: body.reason }),
  };
}

/** Fields one after the other, those of groups too. @param {ReturnType<typeof fieldsOf>} fields @returns {Field[]} */
const single = (fields) => fields.flatMap((one) => ("fields" in one ? one.fields : [one]));

/**
 * The fields of a competition that another organizer has changed meanwhile, with the typed values, and the labels of those changes.
 * @param {any} base what was typed into @param {any} now @param {any} body what the form has
 */
export function together(base, now, body) {
  const before = new Map(single(fieldsOf(base)).map((field) => [field.name, field.initial ?? ""]));
  const typed = (/** @type {Field} */ field) => (field.kind === "time" ? shownEnd(body[field.name]) : (body[field.name] ?? (field.kind === "check" ? false : "")));
  const kept = (/** @type {Field} */ field) =>
    before.has(field.name) && typed(field) !== before.get(field.name) ? { ...field, initial: typed(field) } : field;
  const theirs = single(fieldsOf(now)).filter((field) => before.get(field.name) !== (field.initial ?? ""));
  const fields = fieldsOf(now).map((one) => ("fields" in one ? { ...one, fields: one.fields.map(kept) } : kept(one)));
  return { fields, theirs: theirs.map((field) => field.label) };
}

/** @param {{competition: any, changed: () => void}} props */
export function Change({ competition, changed }) {
  // Typed values survive a reload of the competition.
  const [base, setBase] = useState(competition);
  const [note, setNote] = useState("");
  /** @param {any} body */
  const send = async (body) => {
    setNote("");
    const { reason, ...change } = changeOf(base, body);
    if (Object.keys(change).length === 0) {
      setNote("Nothing differs from how it is.");
      return fieldsOf({ ...base });
    }
    const path = route`/api/v1/competitions/${base.id}`;
    let now;
    try {
      now = await request(path, { method: "PATCH", body: { ...change, reason, if_revision: base.revision } });
    } catch (error) {
      if (!(error instanceof Problem && error.code === "changed")) throw error;
      const theirs = await request(path);
      const merged = together(base, theirs, body);
      setBase(theirs);
      setNote(`Nothing was changed yet: another organizer has changed it meanwhile (${merged.theirs.join(", ") || "a window"}). The form has that now, and what you typed. Send it again if it is still right.`);
      changed();
      return merged.fields;
    }
    setBase(now);
    setNote("It was changed, and everybody sees what.");
    changed();
    return fieldsOf(now);
  };
  return html`<h3>Change</h3>
    <p class="muted">Nothing is ever shortened, and what is played never changes.</p>
    <details><summary>Later ends, other texts</summary>
      <${Form} fields=${fieldsOf(base)} label="Change the competition" send=${send} />
      <p class="good" role="status">${note}</p>
    </details>
    <p class="buttons">
      <${ActButton} label="Cancel the competition" title=${html`Cancel <${Text} value=${competition.name} />?`} reason="required" dismiss="Keep it" done=${changed}
        act=${(/** @type {string} */ reason) => request(route`/api/v1/competitions/${competition.id}/cancel`, { method: "POST", body: { reason } })}>
        <p>
          Nobody enters or starts an attempt any more, and attempts that run end at once. Its seeds are published at the time at which
          it would have closed. This cannot be undone.
        </p>
      <//>
    </p>`;
}

/** Hides a finished competition from lists, or shows it. @param {{competition: any, changed: () => void}} props */
export function Listing({ competition: { id, name, hidden }, changed }) {
  const send = (/** @type {string} */ reason) =>
    request(route`/api/v1/competitions/${id}`, { method: "PATCH", body: { hidden: !hidden, ...(reason && { reason }) } });
  const [label, title] = hidden ? ["Show in lists", "Show"] : ["Hide from lists", "Hide"];
  return html`<p class="buttons">
    <${ActButton} label=${label} title=${html`${title} <${Text} value=${name} />?`} reason="optional" isDangerous=${false} done=${changed} act=${send}>
      <p>Who has its address finds it in any case, and everybody sees that it was ${hidden ? "shown again" : "hidden"}.</p>
    <//>
  </p>`;
}
