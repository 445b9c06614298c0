// Commands to paste into a terminal.
import { html, useState } from "../ui.js";

const COPIED_MS = 2000;

/** @param {{lines: string[]}} props */
export function Command({ lines }) {
  const [isCopied, setIsCopied] = useState(false);
  const text = lines.join("\n");
  const copy = async () => {
    await navigator.clipboard.writeText(text);
    setIsCopied(true);
    setTimeout(() => setIsCopied(false), COPIED_MS);
  };
  return html`<div class="command">
    <pre tabindex="0" role="region" aria-label="Command">${text}</pre>
    ${navigator.clipboard && html`<button type="button" class="quiet" aria-live="polite" onClick=${copy}>${isCopied ? "Copied" : "Copy"}</button>`}
  </div>`;
}
