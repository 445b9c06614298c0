// Competitions by phase.
import { html } from "../ui.js";
import { route } from "../api.js";
import { Items } from "../parts/listed.js";
import { Listed, usePages } from "../parts/pages.js";
import { useTitle } from "../parts/query.js";
import { Text } from "../parts/text.js";
import { Countdown, Time } from "../parts/time.js";

/** Phases in the order of the page: open competitions come first. */
const PHASES = [
  { phase: "open", title: "Open", note: "You can enter, and play attempts.", clock: "closes_at", word: "Closes" },
  { phase: "announced", title: "Announced", note: "Entry is open; nobody can play yet.", clock: "opens_at", word: "Opens" },
  { phase: "closing", title: "Closing", note: "The last rounds run. Results follow.", clock: "closes_at", word: "Closed" },
  { phase: "cancelled", title: "Cancelled", note: "Organizers ended them early.", clock: "cancelled_at", word: "Cancelled" },
  { phase: "closed", title: "Closed", note: "Seeds, games and boards are public.", clock: "revealed_at", word: "Revealed" },
];

const REFRESH_MS = 30_000;

export function Page() {
  const list = usePages("/api/v1/competitions", REFRESH_MS);
  useTitle("Competitions");
  return html`
    <h1>Competitions</h1>
    <p>
      A competition is played on sealed seeds: nobody sees them before its end, and a hash that was published at the
      beginning shows that nobody exchanged them.
    </p>
    <${Listed} list=${list} empty=${html`<p class="empty">There is no competition on this server yet.</p>`}>
      ${PHASES.map((one) => html`<${Phase} ...${one} items=${list.items.filter(({ phase }) => phase === one.phase)} />`)}
    <//>
  `;
}

/** @param {typeof PHASES[number] & {items: any[]}} props */
function Phase({ title, note, clock, word, items }) {
  const time = (/** @type {any} */ { [clock]: at }) =>
    at ? html`<${Countdown} value=${at} isAhead=${["Opens", "Closes"].includes(word)} /> <span class="muted small"><${Time} value=${at} /></span>` : "soon";
  const tasks = ({ suite: { tasks } }) => (!tasks || tasks.length === 5 ? "all five" : html`<${Text} value=${tasks.join(", ")} />`);
  return items.length > 0 && html`<section>
    <h2>${title}</h2>
    <p class="muted">${note}</p>
    <${Items} items=${items} label=${`${title} competitions`} columns=${[
      ["Name", ({ id, name }) => html`<a href=${route`/competitions/${id}`}><${Text} value=${name} /></a>`],
      [word, time],
      ["Entry", ({ entry }) => (entry === "codes" ? "with a code" : "open to all")],
      ["#Attempts", ({ attempts }) => attempts.length],
      ["Tasks", tasks],
    ]} />
  </section>`;
}
