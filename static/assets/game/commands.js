// Commands that show or check a game elsewhere, and markup that shows it in another page.
import { html } from "../ui.js";
import { route } from "../api.js";
import { Commands } from "../parts/copy.js";

/** @param {{id: string, mayEmbed: boolean}} props */
export function GameCommands({ id, mayEmbed }) {
  const server = location.origin;
  return html`<p>An animated GIF:</p>
    <${Commands} label="Command for the animation" what="the command for the animation" lines=${[`swarmbench replay ${id} --gif game.gif --messages --server ${server}`]} />
    <p>This page as one file, which opens without a server:</p>
    <${Commands} label="Command for one file" what="the command for one file" lines=${[`swarmbench replay ${id} --html game.html --server ${server}`]} />
    <p>Check the journal without trusting this server:</p>
    <${Commands} label="Command for the check" what="the command for the check" lines=${[`swarmbench verify ${id}.jsonl`]} />
    ${mayEmbed && html`<p>The game in another page:</p><${Commands} label="Markup for another page" what="the markup" lines=${[`<iframe src="${server}${route`/embed/episodes/${id}`}" width="800" height="900"></iframe>`]} />`}`;
}
