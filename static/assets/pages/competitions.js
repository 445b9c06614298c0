// Competitions by phase.
import { html, useEffect } from "../ui.js";
import { More, usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text } from "../parts/text.js";
import { Countdown, Time } from "../parts/time.js";

/** Phases in the order of the page: open competitions come first. */
const PHASES = [
  { phases: ["open"], title: "Open", note: "Attempts can be started.", clock: "closes_at", word: "Closes" },
  { phases: ["announced"], title: "Announced", note: "Nobody can play yet. One can enter.", clock: "opens_at", word: "Opens" },
  { phases: ["closing"], title: "Closing", note: "The last rounds run. Results follow.", clock: "closes_at", word: "Closed" },
  { phases: ["cancelled"], title: "Cancelled", note: "Organizers ended them early.", clock: "cancelled_at", word: "Cancelled" },
  { phases: ["closed"], title: "Closed", note: "Seeds, games and boards are public.", clock: "revealed_at", word: "Revealed" },
];

const REFRESH_MS = 30_000;

export function Page() {
  const list = usePages("/api/v1/competitions", REFRESH_MS);
  useEffect(() => {
    document.title = "Competitions";
  }, []);
  return html`
    <h1>Competitions</h1>
    <p>
      A competition is played on sealed seeds: nobody sees them before its end, and a hash that was published at the
      beginning shows that nobody exchanged them.
    </p>
    ${list.problem && html`<${ProblemNote} problem=${list.problem} retry=${list.reload} />`}
    ${!list.value && !list.problem && html`<p class="muted" role="status">Loading …</p>`}
    ${list.value && list.items.length === 0 &&
    html`<p class="empty">There is no competition on this server. An organizer creates one at the <a href="/desk?view=create">desk</a>.</p>`}
    ${PHASES.map((phase) => html`<${Phase} phase=${phase} items=${list.items.filter((one) => phase.phases.includes(one.phase)) ?? []} />`)}
    <${More} list=${list} />
  `;
}

/** @param {{phase: typeof PHASES[number], items: any[]}} props */
function Phase({ phase, items }) {
  if (items.length === 0) return null;
  return html`<section>
    <h2>${phase.title}</h2>
    <p class="muted">${phase.note}</p>
    <div class="scroll" tabindex="0" role="region" aria-label=${`${phase.title} competitions`}>
      <table>
        <thead>
          <tr><th scope="col">Name</th><th scope="col">${phase.word}</th><th scope="col">Entry</th><th scope="col" class="number">Attempts</th><th scope="col">Tasks</th></tr>
        </thead>
        <tbody>
          ${items.map(
            (one) => html`<tr key=${one.id}>
              <td><a href=${`/competitions/${encodeURIComponent(one.id)}`}><${Text} value=${one.name} /></a></td>
              <td>${one[phase.clock] ? html`<${Countdown} value=${one[phase.clock]} /> <span class="muted small"><${Time} value=${one[phase.clock]} /></span>` : "soon"}</td>
              <td>${one.entry === "codes" ? "with a code" : "open to all"}</td>
              <td class="number">${one.attempts.length}</td>
              <td>${tasksOf(one.suite)}</td>
            </tr>`,
          )}
        </tbody>
      </table>
    </div>
  </section>`;
}

/** @param {{tasks?: string[] | null}} suite */
const tasksOf = ({ tasks }) => (!tasks || tasks.length === 5 ? "all five" : html`<${Text} value=${tasks.join(", ")} />`);
