// The page of a game, while it runs and after its end; also of imported games.
import { html, useEffect, useEvery, useState } from "../ui.js";
import { route, send, withQuery } from "../api.js";
import { isLive, useChanges } from "../parts/game.js";
import { HiddenGame, openGame } from "../parts/served.js";
import { Below, Folded, Loaded, Part, useLoaded, usePart, useTask } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { Notices, Title } from "../game/about.js";
import { PARTS } from "../game/parts.js";
import { Viewer } from "../game/viewer.js";

/** @import { Shown } from "../game/about.js" */
/** @import { Game } from "../parts/game.js" */

/** @param {{id: string, embedded: boolean}} props */
export function Page({ id, embedded }) {
  const loaded = useLoaded((signal) => openGame(id, signal), [id]);
  const { value: game, problem, reload } = loaded;
  if (game) return html`<${ServedGame} game=${game} embedded=${embedded} />`;
  if (problem instanceof HiddenGame) return html`<${Hidden} summary=${problem.summary} reload=${reload} />`;
  return html`<h1>Game</h1><${Loaded} of=${loaded} />${problem && html`<p><a href="/episodes">All games</a></p>`}`;
}

/** The interval between checks whether a hidden game has ended. */
const HIDDEN_MS = 10_000;

/** A game whose holders must not see each other. @param {{summary: any, reload: () => void}} props */
function Hidden({ summary, reload }) {
  useEvery(HIDDEN_MS, reload);
  const { id, task, status, round: rounds } = summary;
  /** @type {Shown} */
  const game = { kind: "episodes", summary, head: { id, task, status, rounds } };
  return html`<div class="watch">
    <${Title} game=${game} isLinked=${true} />
    <div class="notice"><p><strong>What happens in this game is shown after its end.</strong> Its seats belong to several holders, who see only what their own agents see. This page shows the game by itself when it has ended.</p></div>
    <${Seats} game=${game} />
  </div>`;
}

/** The holders of seats, if there can be several. @param {{game: Shown}} props */
function Seats({ game }) {
  const part = usePart(() => import("../parts/seats.js"), game.kind === "episodes" && game.summary.mixed);
  return part && html`<${part.Seats} game=${game} />`;
}

/** @param {{game: Game, embedded: boolean}} props */
function ServedGame({ game, embedded }) {
  useChanges(game);
  const [problem, setProblem] = useState(/** @type {Error | null} */ (null));
  useEffect(() => {
    if (!isLive(game.head)) return;
    const aborted = new AbortController();
    game.follow(aborted.signal).catch((error) => aborted.signal.aborted || setProblem(error));
    return () => aborted.abort();
  }, [game]);

  const { id } = game.head;
  const [made, setMade] = useState(/** @type {any} */ (null));
  const task = useTask();
  const isEpisode = game.kind === "episodes";
  const mayEmbed = isEpisode && (game.summary.config?.visibility === "public" || !isLive(game.head));
  // What a fork needs is read when one is made.
  const fork = async (/** @type {number} */ round) => {
    const { Forked, madeFork } = await import("../play/fork.js");
    setMade(html`<${Forked} ...${await madeFork(id, round)} />`);
  };
  const journal = async () => {
    const answer = await send(route`/api/v1/episodes/${id}/journal`, { token: /** @type {any} */ (game).token });
    const { save } = await import("../parts/download.js");
    save(await answer.blob(), `${id}.jsonl`);
  };
  /** @type {import("../game/viewer.js").Tools} */
  const tools = embedded ? {} : {
    hasLink: true,
    embed: mayEmbed ? `<iframe src="${location.origin}${route`/embed/episodes/${id}`}" width="800" height="700"></iframe>` : undefined,
    ...(isEpisode && {
      compare: (round) => location.assign(`${withQuery("/compare", { a: id })}#r=${round}`),
      fork: (round) => task.run(() => fork(round)),
      journal: () => task.run(journal),
    }),
  };
  return html`<div class="watch">
    <${Title} game=${game} isLinked=${!embedded} />
    <${Notices} game=${game} />
    ${problem && html`<${ProblemNote} problem=${problem} what="This game" />`}
    ${task.problem && html`<${ProblemNote} problem=${task.problem} />`}
    ${made}
    <${Viewer} game=${game} parts=${PARTS} tools=${tools}>
      ${embedded
        ? html`<p><a href=${route`/episodes/${id}`} target="_blank" rel="noopener">The whole page of this game</a></p>`
        : html`${isEpisode && html`<${Elsewhere} id=${id} />`}<${Seats} game=${game} /><${Below}><${Part} read=${PARTS.later} name="Facts" props=${{ game }} /><//>`}
    <//>
  </div>`;
}

/** Commands for other places. @param {{id: string}} props */
const Elsewhere = ({ id }) =>
  html`<${Folded} summary="Commands: animation, one file, check on your own machine" read=${PARTS.later} name="GameCommands" props=${{ id }} />`;
