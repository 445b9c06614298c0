// The entry of a page that is one file: a game that opens without a server. The document contains everything.
import { html, render } from "./ui.js";
import { Notices, Title } from "./game/about.js";
import * as later from "./game/later.js";
import { Viewer } from "./game/viewer.js";
import * as codes from "./parts/codes.js";
import { PackedGame } from "./parts/packed.js";

const PARTS = { codes: async () => codes, later: async () => later };

/** @param {{game: PackedGame}} props */
function File({ game }) {
  return html`<main id="main" tabindex="-1">
    <div class="watch">
      <${Title} game=${game} />
      <${Notices} game=${game} />
      <${Viewer} game=${game} parts=${PARTS}><${later.Facts} game=${game} /><//>
    </div>
  </main>`;
}

const [root, content] = [document.getElementById("app"), document.getElementById("game")];
if (root && content) render(html`<${File} game=${new PackedGame(JSON.parse(content.textContent ?? ""))} />`, root);
