// Details of an entrant beside the table: its contact, its team, and its category.
import { html, useLayoutEffect, useRef, useState } from "../ui.js";
import { request, route } from "../api.js";
import { Form } from "../parts/form.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { Team } from "../parts/team.js";
import { Text, visible } from "../parts/text.js";

/** The accepted version of the terms. @param {number | null} accepted @param {number} newest */
export function termsText(accepted, newest) {
  if (!accepted) return "none accepted";
  return accepted === newest ? `version ${accepted}` : `version ${accepted} of ${newest}`;
}

/** @param {{competition: any, one: any, done: () => void, close: () => void}} props */
export function Details({ competition, one, done, close }) {
  const panel = useRef(/** @type {HTMLElement | null} */ (null));
  const path = route`/api/v1/competitions/${competition.id}/entrants/${one.id}`;
  const { value, problem, reload } = useLoaded((signal) => request(path, { signal }), [path]);
  useLayoutEffect(() => panel.current?.focus(), []);
  const isOver = Boolean(competition.revealed_at || competition.cancelled_at);
  return html`<section class="inset" ref=${panel} tabindex="-1" aria-labelledby="details">
    <h4 id="details">Details of <${Text} value=${one.name} />${one.erased && html` <span class="badge">erased</span>`}</h4>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    <dl class="facts">
      <dt>Contact</dt>
      <dd>${value?.contact ? html`<${Text} value=${value.contact} />` : value ? "none" : "…"}</dd>
      ${competition.terms && html`<dt>Terms</dt><dd>${termsText(one.terms, competition.terms.version)}</dd>`}
    </dl>
    ${competition.categories.length > 0 && !isOver && !one.erased && html`<${Move} categories=${competition.categories} one=${one} path=${path} done=${done} />`}
    <${Team} path=${path} mayAdd=${!isOver && !one.erased && one.status === "active"} />
    <p class="buttons"><button type="button" onClick=${close}>Close the details</button></p>
  </section>`;
}

/** @param {string[]} categories @param {string} initial @returns {import("../parts/form.js").Field[]} */
const moveFields = (categories, initial) => [
  { name: "category", label: "Category", kind: "choice", initial, options: categories.map((name) => [name, visible(name)]), help: "Everybody sees that you have changed it." },
];

/** @param {{categories: string[], one: any, path: string, done: () => void}} props */
function Move({ categories, one, path, done }) {
  const [note, setNote] = useState("");
  /** @param {{category: string}} body */
  const move = async (body) => {
    setNote("");
    if (body.category === one.category) {
      setNote("It is in this category.");
      return;
    }
    const { category } = await request(path, { method: "PATCH", body });
    setNote("It was moved.");
    done();
    return moveFields(categories, category);
  };
  return html`<${Form} fields=${moveFields(categories, one.category)} label="Move it" send=${move} />
    <p class="good" role="status">${note}</p>`;
}
