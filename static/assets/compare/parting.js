// The first round in which two games differ: found by reading both until then.
import { html, useEffect, useRef, useState } from "../ui.js";
import { actionOf } from "../parts/actions.js";
import { isLive } from "../parts/game.js";
import { Text } from "../parts/text.js";
import { differences, findDifference, saidBy } from "./pair.js";

/**
 * @param {{pair: import("./pair.js").Pair, isGroundSame: boolean, onFound: (round: number | null) => void,
 *   onGo: (round: number) => void}} props
 */
export function Parting({ pair, isGroundSame, onFound, onGo }) {
  const search = useSearch(pair, onFound);
  const { round, places, seen, problem } = search;
  const both = `${pair.a.last === pair.b.last ? "all" : "the first"} ${pair.common} rounds`;
  const mayGoOn = isLive(pair.a.head) || isLive(pair.b.head);
  if (problem) return html`<p class="bad" role="status">The games could not be read to the round in which they part. <button type="button" onClick=${search.again}>Try again</button></p>`;
  if (round === null && seen < pair.common) {
    return html`<p role="status">Looking for the round in which they part: ${seen} of ${pair.common} … <progress max=${pair.common} value=${seen} aria-label="Rounds that were compared"></progress></p>`;
  }
  if (round === null) {
    return html`<p role="status"><strong>They never part${mayGoOn ? " so far" : ""}:</strong> ${both} are the same in both.
      ${pair.a.last !== pair.b.last && " One of them is longer."}</p>`;
  }
  return html`<p class="parts" role="status">
    ${!isGroundSame || places === 0
      ? html`<strong>They differ from the beginning:</strong> their layouts are not the same.`
      : html`<strong>They part in round ${round}.</strong> <${How} pair=${pair} round=${round} />`}
    ${" "}<button type="button" onClick=${() => onGo(round)}>Go to round ${round}</button>
    ${places !== null && places > round && html`${" "}On the map they differ from <button type="button" onClick=${() => onGo(places)}>round ${places}</button> on.`}
  </p>`;
}

/** @type {{round: number | null, places: number | null, seen: number, problem: boolean}} */
const NOT_FOUND = { round: null, places: null, seen: 0, problem: false };

/** Searches on as the games grow. @param {import("./pair.js").Pair} pair @param {(round: number | null) => void} onFound */
function useSearch(pair, onFound) {
  const [state, setState] = useState(NOT_FOUND);
  const [count, setCount] = useState(0);
  const from = useRef(0);
  useEffect(() => {
    if (state.round !== null) return;
    const aborted = new AbortController();
    const common = pair.common;
    const seen = (/** @type {number} */ seen) => setState({ ...NOT_FOUND, seen });
    const search = async () => {
      const round = await findDifference(pair, from.current, 1, aborted.signal, { onRound: seen });
      const places = round === null ? null : await findDifference(pair, round, 1, aborted.signal, { onlyPlaces: true });
      if (aborted.signal.aborted) return;
      // The decisions of the newest round are not known yet.
      from.current = common;
      setState({ round, places, seen: common, problem: false });
      onFound(round);
    };
    search().catch(() => aborted.signal.aborted || setState((state) => ({ ...state, problem: true })));
    return () => aborted.abort();
  }, [pair, pair.common, count]);
  return { ...state, again: () => setCount(count + 1) };
}

/** The acts of the first agent that differs, in both games. @param {{pair: import("./pair.js").Pair, round: number}} props */
function How({ pair, round }) {
  const at = (/** @type {import("../parts/game.js").Game} */ game) => ({ state: game.peek(round), next: game.peek(round + 1) });
  const [a, b] = [at(pair.a), at(pair.b)];
  if (!a.state || !b.state) return null;
  const { agents } = differences(pair.a.head, /** @type {any} */ (a), /** @type {any} */ (b));
  const first = [...agents].find(([, { action, message }]) => action || message);
  if (!first) return null;
  const [agent, { action }] = first;
  const others = agents.size - 1;
  const does = (/** @type {any} */ next) =>
    action ? html`<b>${actionOf(next, agent)?.name}</b>` : saidBy(next, agent) ? html`“<${Text} value=${saidBy(next, agent)} />”` : "nothing";
  return html`Agent ${agent} ${action ? "chooses" : "says"} ${does(a.next)} in A and ${does(b.next)} in
    B${others > 0 ? `; ${others} other${others === 1 ? " agent differs" : "s differ"} too` : ""}.`;
}
