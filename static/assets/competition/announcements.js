// Announcements of a competition's organizers.
import { html } from "../ui.js";
import { More } from "../parts/pages.js";
import { Lines } from "../parts/text.js";
import { Time } from "../parts/time.js";

/** Empty before the first announcement. @param {{list: ReturnType<typeof import("../parts/pages.js").usePages>}} props */
export function Announcements({ list }) {
  if (list.items.length === 0) return null;
  return html`<section aria-labelledby="announcements">
    <h2 id="announcements">Announcements</h2>
    ${list.items.map(
      ({ at, text }) => html`<article class="inset">
        <p class="muted small"><${Time} value=${at} both /></p>
        <${Lines} value=${text} />
      </article>`,
    )}
    <${More} list=${list} />
  </section>`;
}
