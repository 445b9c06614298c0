// A competition: what its reader can do now, its rules, standings and entrants, and checking it after its end.
import { html, useEffect, useState } from "../ui.js";
import { key, onRemembered, request, route, send, withQuery } from "../api.js";
import { Announcements, Commitment, Moments, Phase, Prose, Rules } from "../competition/about.js";
import { TakePart } from "../competition/part.js";
import { Entrants, Standings } from "../competition/standings.js";
import { holder } from "../parts/caller.js";
import { Below, Part, useLoaded } from "../parts/load.js";
import { Actions, firstEnds } from "../parts/organizers.js";
import { usePages } from "../parts/pages.js";
import { Waiting } from "../parts/problem.js";
import { useTitle } from "../parts/query.js";
import { Text, visible } from "../parts/text.js";

const REFRESH_MS = 20_000;

/** The number of entrants that are shown at first, and with each request for more. */
const ROWS = 25;

/** @param {{id: string}} props */
export function Page({ id }) {
  const [ownKey, setOwnKey] = useState(key());
  useEffect(() => onRemembered(() => setOwnKey(key())), []);
  const loaded = useLoaded((signal) => load(id, signal), [id, ownKey], REFRESH_MS);
  const { value, problem, reload } = loaded;
  // The section of a link is on the page once this is loaded.
  useEffect(() => void (value && location.hash && document.getElementById(location.hash.slice(1))?.scrollIntoView()), [!value]);
  useTitle(value && `${visible(value.competition.name)}: competition`);
  if (!value) return html`<h1>Competition</h1><${Waiting} of=${loaded} what="This competition" />`;
  return html`<${Competition} key=${id} ...${value} isLost=${Boolean(problem)} reload=${reload} />`;
}

/**
 * @param {{competition: any, aheadMs: number, reader: import("../competition/part.js").Reader, isLost: boolean, reload: () => void}} props
 *   isLost: the server does not answer any more
 */
function Competition({ competition, aheadMs, reader, isLost, reload }) {
  const entrants = usePages(withQuery(route`/api/v1/competitions/${competition.id}/entrants`, { limit: ROWS }));
  const actions = usePages(route`/api/v1/competitions/${competition.id}/actions`, REFRESH_MS);
  const announcements = usePages(`${route`/api/v1/competitions/${competition.id}/announcements`}?limit=10`, REFRESH_MS);
  const [changes, setChanges] = useState(0);
  const names = new Map([...entrants.items, ...reader.own].map((one) => [one.id, one.name]));
  // A cancelled competition is revealed, too, but its phase stays.
  const isRevealed = Boolean(competition.revealed_at);
  const changed = () => {
    setChanges((changes) => changes + 1);
    reload();
    entrants.reload();
  };
  const section = (/** @type {string} */ id, /** @type {string} */ title, /** @type {any} */ content) =>
    html`<section aria-labelledby=${id}><h2 id=${id}>${title}</h2>${content}</section>`;
  const standings = section("standings", "Standings", html`<${Standings} competition=${competition} own=${reader.own} key=${`${competition.phase} ${changes}`} />`);
  const { terms } = competition;
  return html`
    <h1><${Text} value=${competition.name} /></h1>
    ${isLost && html`<p class="bad" role="status">The server does not answer. What is shown may be out of date.</p>`}
    <${Phase} competition=${competition} aheadMs=${aheadMs} />
    <${TakePart} competition=${competition} reader=${reader} changed=${changed} reload=${reload} />
    <${Announcements} list=${announcements} />
    ${isRevealed && standings}
    <section aria-labelledby="rules">
      <h2 id="rules">How it is played</h2>
      <${Prose} text=${competition.description.trim()} label="Description" />
      <${Moments} competition=${competition} firstEnds=${firstEnds(actions.items)} />
      <${Rules} competition=${competition} />
    </section>
    ${!isRevealed && standings}
    ${terms && section("terms", `Terms, version ${terms.version}`, html`<${Prose} text=${terms.text} label="The text of the terms" />`)}
    ${section("entrants", "Entrants", html`<${Entrants} list=${entrants} hasCategories=${competition.categories.length > 0} own=${reader.own} />`)}
    ${section("actions", "What organizers did", html`<${Actions} list=${actions} names=${names} />`)}
    ${section("commitment", "Commitment", html`<${Commitment} competition=${competition} />`)}
    ${isRevealed && section("verify", "Check the results", html`<${Below}><${Part} read=${() => import("../competition/verification.js")} name="Verification" props=${{ competition }} /><//>`)}
  `;
}

/** @param {string} id @param {AbortSignal} signal */
async function load(id, signal) {
  const path = route`/api/v1/competitions/${id}`;
  const response = await send(path, { signal });
  const aheadMs = Date.now() - Date.parse(response.headers.get("date") ?? "") || 0;
  const competition = await response.json();
  return { competition, aheadMs, reader: await readerOf(path, competition, signal) };
}

/** @param {string} path @param {any} competition @param {AbortSignal} signal @returns {Promise<import("../competition/part.js").Reader>} */
async function readerOf(path, competition, signal) {
  if (!key()) return { role: "none", own: [] };
  const { items: own } = await request(`${path}/entrants?own=true`, { signal });
  // Before the end the whole board is for organizers and judges: nobody else is asked for more. Afterwards it is everybody's.
  const oversees = !competition.revealed_at && (await request(`${path}/board?limit=1`, { signal })).shows === "all";
  return { role: oversees ? (await holder()).role : "other", own };
}
