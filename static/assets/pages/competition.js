// A competition: its phases, standings, rules and entrants; entering it, playing it, and checking it after its end.
import { html, useEffect, useState } from "../ui.js";
import { key, onRemembered, request, route, send } from "../api.js";
import { Announcements } from "../competition/announcements.js";
import { Attempts } from "../competition/attempts.js";
import { Enter } from "../competition/enter.js";
import { Entrants } from "../competition/entrants.js";
import { Commitment, Rules } from "../competition/facts.js";
import { OwnEntrant } from "../competition/own.js";
import { Phases } from "../competition/phases.js";
import { Practice } from "../competition/practice.js";
import { Prose } from "../competition/prose.js";
import { Standings } from "../competition/standings.js";
import { Terms } from "../competition/terms.js";
import { Verification } from "../competition/verification.js";
import { openKeyDialog } from "../parts/header.js";
import { useLoaded } from "../parts/load.js";
import { Actions, firstEnds } from "../parts/organizers.js";
import { usePages } from "../parts/pages.js";
import { ProblemNote } from "../parts/problem.js";
import { Text, visible } from "../parts/text.js";

const REFRESH_MS = 20_000;

/** @param {{id: string}} props */
export function Page({ id }) {
  const { value, problem, reload } = useLoaded((signal) => load(id, signal), [id], REFRESH_MS);
  const name = value?.competition.name;
  useEffect(() => {
    document.title = name ? `${visible(name)} · Competition` : "Competition";
  }, [name]);
  if (!value) {
    return problem
      ? html`<h1>Competition</h1><${ProblemNote} problem=${problem} retry=${reload} what="This competition" />`
      : html`<p class="muted" role="status">Loading …</p>`;
  }
  return html`<${Competition} key=${id} ...${value} isLost=${Boolean(problem)} reload=${reload} />`;
}

/** @param {{competition: any, aheadMs: number, isLost: boolean, reload: () => void}} props isLost: the server does not answer any more */
function Competition({ competition, aheadMs, isLost, reload }) {
  const entrants = usePages(route`/api/v1/competitions/${competition.id}/entrants`);
  const actions = usePages(route`/api/v1/competitions/${competition.id}/actions`, REFRESH_MS);
  const announcements = usePages(`${route`/api/v1/competitions/${competition.id}/announcements`}?limit=10`, REFRESH_MS);
  const [changes, setChanges] = useState(0);
  const names = new Map(entrants.items.map((one) => [one.id, one.name]));
  // A cancelled competition is revealed, too, but its phase stays.
  const isRevealed = Boolean(competition.revealed_at);
  const changed = () => {
    setChanges((changes) => changes + 1);
    entrants.reload();
  };
  const part = html`<${TakePart} competition=${competition} entrants=${entrants.items} changes=${changes} changed=${changed} reload=${reload} />`;
  return html`
    <h1><${Text} value=${competition.name} /></h1>
    ${isLost && html`<p class="bad" role="status">The server does not answer. What is shown may be out of date.</p>`}
    <${Phases} competition=${competition} aheadMs=${aheadMs} firstEnds=${firstEnds(actions.items)} />
    <${Prose} text=${competition.description.trim()} label="Description" />
    <${Announcements} list=${announcements} />
    <section aria-labelledby="standings"><h2 id="standings">Standings</h2><${Standings} competition=${competition} key=${`${competition.phase} ${changes}`} /></section>
    ${competition.terms && html`<${Terms} terms=${competition.terms} />`}
    ${!isRevealed && part}
    <section aria-labelledby="rules"><h2 id="rules">How it is played</h2><${Rules} competition=${competition} /></section>
    <section aria-labelledby="entrants"><h2 id="entrants">Entrants</h2><${Entrants} list=${entrants} hasCategories=${competition.categories.length > 0} /></section>
    <section aria-labelledby="actions"><h2 id="actions">What organizers did</h2><${Actions} list=${actions} names=${names} /></section>
    <section aria-labelledby="commitment"><h2 id="commitment">Commitment</h2><${Commitment} competition=${competition} /></section>
    ${isRevealed &&
    html`${key() && part}
      <section aria-labelledby="verify"><h2 id="verify">Check the results</h2><${Verification} competition=${competition} /></section>`}
  `;
}

/** @param {string} id @param {AbortSignal} signal */
async function load(id, signal) {
  const response = await send(route`/api/v1/competitions/${id}`, { signal });
  const at = Date.parse(response.headers.get("date") ?? "");
  const competition = await response.json();
  return { competition, aheadMs: Number.isNaN(at) ? 0 : Date.now() - at };
}

/**
 * Entering and playing, with or without a key.
 * @param {{competition: any, entrants: any[], changes: number, changed: () => void, reload: () => void}} props changes: how many were made here
 */
function TakePart({ competition, entrants, changes, changed, reload }) {
  const [ownKey, setOwnKey] = useState(key());
  const [erased, setErased] = useState("");
  useEffect(() => onRemembered(() => setOwnKey(key())), []);
  const mayEnter = competition.phase === "announced" || competition.phase === "open";
  return html`<section aria-labelledby="part">
    <h2 id="part">${mayEnter ? "Take part" : "My attempts"}</h2>
    <div role="status">${erased && html`<p class="good"><${Text} value=${erased} /> was erased.</p>`}</div>
    ${ownKey
      ? html`<${Own} key=${ownKey} competition=${competition} entrants=${entrants} changes=${changes} changed=${changed} erased=${setErased} />`
      : html`<p>If you have entered already, <button type="button" onClick=${openKeyDialog}>enter your key</button> to see your attempts.</p>`}
    ${mayEnter && html`<${Enter} competition=${competition} entered=${changed} reload=${reload} />`}
  </section>`;
}

const ATTEMPTS_REFRESH_MS = 5000;

/** @param {{competition: any, entrants: any[], changes: number, changed: () => void, erased: (name: string) => void}} props */
function Own({ competition, entrants, changes, changed, erased }) {
  const list = usePages(route`/api/v1/competitions/${competition.id}/attempts`, ATTEMPTS_REFRESH_MS);
  const own = useLoaded((signal) => request(`${route`/api/v1/competitions/${competition.id}/entrants`}?own=true`, { signal }), [competition.id, changes], REFRESH_MS);
  return html`<${Attempts} competition=${competition} list=${list} entrants=${entrants} />
    ${own.value && html`<${Practice} competition=${competition} entrants=${own.value.items} />`}
    ${own.value && html`<${OwnEntrant} competition=${competition} entrants=${own.value.items} changed=${changed} erased=${erased} />`}
    <p class="muted small">An organizer's key shows the attempts of all entrants, and manages them <a href=${`/desk?view=competition&id=${encodeURIComponent(competition.id)}`}>at the desk</a>.</p>`;
}
