// The page of a game, while it runs and after its end; also of imported games.
import { html, useEffect, useRef, useState } from "../ui.js";
import { route, withQuery } from "../api.js";
import { isLive, openGame, useChanges } from "../parts/game.js";
import { HiddenGame } from "../parts/served.js";
import { useLoaded } from "../parts/load.js";
import { ProblemNote } from "../parts/problem.js";
import { Actions, Facts, Seats, Verify } from "../game/about.js";
import { copy } from "../game/save.js";
import { Notices, Title, titleOf } from "../game/title.js";
import { Viewer } from "../game/viewer.js";

/** @import { Shown } from "../game/title.js" */
/** @import { Game } from "../parts/game.js" */

/** @param {{id: string, embedded: boolean}} props */
export function Page({ id, embedded }) {
  const kind = location.pathname.startsWith("/imports/") ? "imports" : "episodes";
  const { value: game, problem, reload } = useLoaded((signal) => openGame({ kind, id }, signal), [kind, id]);
  if (game) return html`<${ServedGame} game=${game} embedded=${embedded} />`;
  if (problem instanceof HiddenGame) return html`<${Hidden} summary=${problem.summary} reload=${reload} />`;
  if (problem) return html`<h1>Game</h1><${ProblemNote} problem=${problem} retry=${reload} /><p><a href="/episodes">All games</a></p>`;
  return html`<h1>Game</h1><p class="muted" role="status">Loading …</p>`;
}

/** The interval between checks whether a hidden game has ended. */
const HIDDEN_MS = 10_000;

/** A game whose holders must not see each other. @param {{summary: any, reload: () => void}} props */
function Hidden({ summary, reload }) {
  useEffect(() => {
    const timer = setInterval(() => document.hidden || reload(), HIDDEN_MS);
    return () => clearInterval(timer);
  }, []);
  const { id, task, status, round: rounds } = summary;
  /** @type {Shown} */
  const game = { kind: "episodes", summary, head: { id, task, status, rounds } };
  useEffect(() => void (document.title = `${titleOf(game)} · swarmbench`), []);
  return html`<div class="watch">
    <${Title} game=${game} />
    <div class="notice"><p><strong>What happens in this game is shown after its end.</strong> Its seats belong to several holders, who see only what their own agents see. This page shows the game by itself when it has ended.</p></div>
    <${Seats} game=${game} />
  </div>`;
}

/** @param {{game: Game, embedded: boolean}} props */
function ServedGame({ game, embedded }) {
  useChanges(game);
  const [problem, setProblem] = useState(/** @type {Error | null} */ (null));
  const [link, setLink] = useState(/** @type {{moment: string, isCopied: boolean} | null} */ (null));
  useEffect(() => {
    document.title = `${titleOf(game)} · swarmbench`;
    if (!isLive(game.head)) return;
    const aborted = new AbortController();
    game.follow(aborted.signal).catch((error) => aborted.signal.aborted || setProblem(error));
    return () => aborted.abort();
  }, [game]);

  const saveLink = async (/** @type {string} */ moment) => setLink({ moment, isCopied: await copy(moment) });
  const fork = useFork(game.head.id);
  const compare = (/** @type {number} */ round) => location.assign(`${withQuery("/compare", { a: game.head.id })}#r=${round}`);
  return html`<div class="watch">
    <${Title} game=${game} />
    <${Notices} game=${game} />
    ${problem && html`<${ProblemNote} problem=${problem} what="This game" />`}
    <${Viewer} game=${game} onLink=${embedded ? undefined : saveLink} onCompare=${embedded || game.kind === "imports" ? undefined : compare} onFork=${embedded || game.kind === "imports" ? undefined : fork.play}>
      ${embedded
        ? html`<p><a href=${route`/episodes/${game.head.id}`} target="_blank" rel="noopener">The whole page of this game</a></p>`
        : html`<${LinkNote} link=${link} />${fork.made}<${Actions} game=${game} />${game.kind === "episodes" && html`<${Elsewhere} game=${game} />`}<${Verify} game=${game} /><${Seats} game=${game} /><${Facts} game=${game} />`}
    <//>
  </div>`;
}

/** Makes one fork at a time of a game, and shows it. What does so is read when it is used. @param {string} id */
function useFork(id) {
  const [made, setMade] = useState(/** @type {unknown} */ (null));
  const isBusy = useRef(false);
  /** @param {number} round */
  const play = async (round) => {
    if (isBusy.current) return;
    isBusy.current = true;
    setMade(null);
    try {
      const { Forked, madeFork } = await import("../play/fork.js");
      setMade(html`<${Forked} ...${await madeFork(id, round)} />`);
    } catch (problem) {
      setMade(html`<${ProblemNote} problem=${problem} what="The new game" />`);
    }
    isBusy.current = false;
  };
  return { made, play };
}

/** Commands for other places, which are read when they are opened. @param {{game: Game}} props */
function Elsewhere({ game: { head, summary } }) {
  const [isOpen, setOpen] = useState(false);
  const { value, problem, reload } = useLoaded(async () => (isOpen ? import("../game/commands.js") : null), [isOpen]);
  return html`<details onToggle=${() => setOpen(true)}>
    <summary>Commands: animation, one file, check on your own machine</summary>
    ${problem && html`<${ProblemNote} problem=${problem} retry=${reload} />`}
    ${value && html`<${value.GameCommands} id=${head.id} mayEmbed=${summary.config?.visibility === "public" || !isLive(head)} />`}
  </details>`;
}

/** Says that the link was copied, or shows the link if the browser forbids copying. @param {{link: {moment: string, isCopied: boolean} | null}} props */
const LinkNote = ({ link }) => html`<div aria-live="polite">
  ${link && (link.isCopied ? html`<p class="muted">Copied: <span class="mono">${link.moment}</span></p>` : html`<p><label>The link to this moment <input readonly size="60" value=${link.moment} onFocus=${(/** @type {any} */ event) => event.currentTarget.select()} /></label></p>`)}
</div>`;
