// What a reader of a competition's page can do now: enter, or play as its entrant; what a judge or an organizer can see.
import { html, useState } from "../ui.js";
import { key, remember, route } from "../api.js";
import { Secret } from "../parts/copy.js";
import { openKeyDialog } from "../parts/header.js";
import { Folded, Part } from "../parts/load.js";
import { Text } from "../parts/text.js";

/** @typedef {{role: import("../parts/caller.js").Role, own: any[]}} Reader own: the entrants of the key of this tab */

/** @param {{competition: any, reader: Reader, changed: () => void, reload: () => void}} props changed: by what was done here; reload: of the page */
export function TakePart({ competition, reader: { role, own }, changed, reload }) {
  const [erased, setErased] = useState("");
  const { id, phase } = competition;
  const mayEnter = phase === "announced" || phase === "open";
  const isJudge = role === "judge";
  const oversees = role === "organizer" || isJudge;
  const hasOwn = own.length > 0;
  const isOffered = !hasOwn && !oversees;
  const title = hasOwn ? "Your entrant" : oversees ? "Your key" : mayEnter ? "Take part" : "";
  return html`<section aria-labelledby=${title && "part"}>
    ${title && html`<h2 id="part">${title}</h2>`}
    <div role="status">${erased && html`<p class="good"><${Text} value=${erased} /> was erased.</p>`}</div>
    ${oversees &&
    html`<p>
        ${isJudge
          ? "This is a judge's key: you read the whole board, all attempts and their games, also before the end. Tell an organizer what breaks the rules; with this key nothing can be changed. What you open of a sealed game is noted in the audit log."
          : "This is an organizer's key: you see the whole board, and all attempts and games, before others do."}
      </p>
      <p class="buttons"><a class="button primary" href=${route`/desk?view=competition&id=${id}`}>${isJudge ? "Look at all attempts" : "Manage it at the desk"}</a></p>`}
    ${hasOwn && html`<${Part} key=${key()} read=${() => import("./own.js")} name="Own" props=${{ competition, own, changed, erased: setErased }} />`}
    ${mayEnter && !isJudge && html`<${Enter} key=${erased} competition=${competition}
      hasOwn=${hasOwn} isOffered=${isOffered} entered=${changed} reload=${reload} />`}
    ${mayEnter && isOffered && !key() && html`<p>Have you entered already? <button type="button" onClick=${openKeyDialog}>Enter your key</button> It shows your place and your attempts.</p>`}
  </section>`;
}

/** A key that is shown once is above the form, which can be longer than the window. @param {HTMLElement | null} made */
const focus = (made) => made?.focus();

/** @param {{competition: any, hasOwn: boolean, isOffered: boolean, entered: () => void, reload: () => void}} props isOffered: it is the next step */
function Enter({ competition, hasOwn, isOffered, entered, reload }) {
  const [made, setMade] = useState(/** @type {any} */ (null));
  const done = (/** @type {any} */ one) => (setMade(one), entered());
  return html`${made &&
    html`<div key=${made.id} role="status" tabindex="-1" ref=${focus}>
      <p class="good"><${Text} value=${made.name} /> takes part.</p>
      ${made.key
        ? html`<${Secret} value=${made.key} label="The key of this entrant">
            <p>Keep it safe: it starts attempts and shows their results. Nobody can show it again.</p>
            <p><button type="button" class="primary" onClick=${() => remember("key", made.key)}>
              ${key() === made.key ? "This tab uses it" : "Use it in this tab"}
            </button></p>
          <//>`
        : html`<p>It was entered with the key of this tab, which starts its attempts.</p>`}
    </div>`}
    <${Folded} key=${made?.id} look=${isOffered && !made ? "button primary" : ""} summary=${made || hasOwn ? "Enter another one" : "Enter"}
      read=${() => import("./entrant.js")} name="Entry" props=${{ competition, entered: done, reload }} />`;
}
