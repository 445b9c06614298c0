// Who plays: the name of a person on boards, and what a game says about them.
import { html, useState } from "../ui.js";
import { remember, remembered } from "../api.js";

const NAME_CHARS_MAX = 200;

/** The name that was typed in this tab. */
export const playerName = () => remembered("player") ?? "human";

/** What the seats of people say about who holds them. */
export const HUMAN = { kind: "human" };

/** Text that nobody guesses, so that a request can be repeated without doing its work twice. */
export const onceKey = () => [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");

export function NameField() {
  const [name, setName] = useState(playerName());
  /** @param {any} event */
  const change = (event) => {
    setName(event.target.value);
    remember("player", event.target.value.trim() || null);
  };
  return html`<label class="field"
    >Your name on boards
    <input value=${name} maxlength=${NAME_CHARS_MAX} autocomplete="nickname" onInput=${change} />
  </label>`;
}
