// The decision of a person in a round: an action by key or button, a message, and its receiver.
import { html, useEffect, useRef, useState } from "../ui.js";
import { remember, remembered } from "../api.js";
import { MESSAGE_CHARS_MAX, readMessage } from "./said.js";

/** Actions with their keys, places and names. @type {Record<string, {keys: string[], shown: string, name: string}>} */
const ACTIONS = {
  UP: { keys: ["ArrowUp"], shown: "↑", name: "Up" },
  LEFT: { keys: ["ArrowLeft"], shown: "←", name: "Left" },
  STAY: { keys: ["s", "S"], shown: "S", name: "Stay" },
  RIGHT: { keys: ["ArrowRight"], shown: "→", name: "Right" },
  DOWN: { keys: ["ArrowDown"], shown: "↓", name: "Down" },
  SWITCH: { keys: ["l", "L", " "], shown: "L", name: "Switch the light" },
};

/** The symbol of an action on the agent's own cell. @param {string | null} action */
export const signOf = (action) => (action === "STAY" ? "•" : action === "SWITCH" ? "☼" : action ? (ACTIONS[action]?.shown ?? "") : "");

const NOTHING = { action: /** @type {string | null} */ (null), message: "", to: "" };

/**
 * The choice that is not sent yet. It survives a reload.
 * @param {any} obs
 * @param {any} receipt of the last act that the server took
 */
function useDraft(obs, receipt) {
  const name = `draft:${obs.episode}:${obs.agent}`;
  const [draft, setDraft] = useState(() => stored(name, obs.round));
  /** @param {Partial<typeof NOTHING>} change */
  const change = (change) =>
    setDraft((draft) => {
      const next = { ...draft, ...change };
      remember(name, JSON.stringify({ ...next, round: obs.round }));
      return next;
    });
  const turn = `${name}:${obs.round}`;
  const lastTurn = useRef(turn);
  useEffect(() => {
    // An unsent message stays when a clock ends the round.
    if (lastTurn.current !== turn) setDraft((draft) => ({ ...draft, action: null }));
    lastTurn.current = turn;
  }, [turn]);
  useEffect(() => {
    if (!receipt) return;
    const isNext = receipt.round !== obs.round;
    setDraft((draft) => ({ ...NOTHING, action: isNext ? draft.action : null }));
    remember(name, null);
  }, [receipt]);
  return { draft, change };
}

/** @param {string} name @param {number} round */
function stored(name, round) {
  const found = JSON.parse(remembered(name) ?? "null");
  return found ? { ...NOTHING, message: found.message, to: found.to, action: found.round === round ? found.action : null } : NOTHING;
}

/**
 * @param {{obs: any, phase: string, receipt: any, receivers: string[], onChoose: (action: string | null) => void,
 *   onSend: (choice: {action: string, message?: string, to?: string}) => void}} props
 */
export function Controls({ obs, phase, receipt, receivers, onChoose, onSend }) {
  const { draft, change } = useDraft(obs, receipt);
  const [isQuick, setIsQuick] = useState(remembered("quick") === "yes");
  const [hint, setHint] = useState("");
  const input = useRef(/** @type {HTMLInputElement | null} */ (null));
  const pad = useRef(/** @type {HTMLElement | null} */ (null));
  const isOpen = phase === "choose";

  useEffect(() => onChoose(draft.action), [draft.action]);

  const leaveMessage = () => document.activeElement === input.current && pad.current?.focus();
  /** @param {string | null} [action] */
  const send = (action = draft.action) => {
    if (!isOpen) return;
    if (!action) return setHint("Choose an action first: an arrow key, or S to stay.");
    const { line } = readMessage(draft.message);
    setHint("");
    // Keys of the next round act again.
    leaveMessage();
    onSend({ action, ...(line ? { message: line } : {}), ...(line && draft.to ? { to: draft.to } : {}) });
  };
  /** @param {string} action */
  const choose = (action) => {
    if (!isOpen) return;
    setHint("");
    change({ action });
    if (isQuick) send(action);
  };
  useKeys({ actions: obs.actions, chosen: draft.action, choose, send, write: () => input.current?.focus() });

  return html`<form
    class="controls"
    onSubmit=${(/** @type {Event} */ event) => {
      event.preventDefault();
      send();
    }}
  >
    <div class="pad" role="group" aria-label="Action" tabindex="-1" ref=${pad}>
      ${obs.actions.map(
        (/** @type {string} */ action) => html`<button
          type="button"
          key=${action}
          data-action=${action}
          class=${action.toLowerCase()}
          aria-pressed=${draft.action === action}
          aria-disabled=${!isOpen}
          onClick=${() => choose(action)}
        >
          <kbd>${ACTIONS[action]?.shown ?? ""}</kbd> ${ACTIONS[action]?.name ?? action}
        </button>`,
      )}
    </div>
    <${MessageBox} draft=${draft} change=${change} input=${input} receivers=${receivers} leave=${leaveMessage} />
    <p class="buttons">
      <button type="submit" class="primary" aria-disabled=${!isOpen || !draft.action}><kbd>Enter</kbd> Send</button>
      <label class="small"
        ><input
          type="checkbox"
          checked=${isQuick}
          onChange=${(/** @type {any} */ event) => {
            remember("quick", event.target.checked ? "yes" : null);
            setIsQuick(event.target.checked);
          }}
        />
        an action is sent as soon as it is chosen</label
      >
    </p>
    <p class="small bad hint" role="status">${hint}</p>
  </form>`;
}

/** @param {{draft: typeof NOTHING, change: (change: Partial<typeof NOTHING>) => void, input: any, receivers: string[], leave: () => void}} props */
function MessageBox({ draft, change, input, receivers, leave }) {
  const { count, cut } = readMessage(draft.message);
  return html`<div class="message">
    ${receivers.length > 0 &&
    html`<label
      >To
      <select value=${draft.to} onChange=${(/** @type {any} */ event) => change({ to: event.target.value })}>
        <option value="">all agents</option>
        ${receivers.map((agent) => html`<option value=${agent}>${agent}</option>`)}
      </select></label
    >`}
    <label for="message"><kbd>M</kbd> Message</label>
    <input
      id="message"
      ref=${input}
      autocomplete="off"
      aria-describedby="message-count"
      value=${draft.message}
      onInput=${(/** @type {any} */ event) => change({ message: event.target.value })}
      onKeyDown=${(/** @type {KeyboardEvent} */ event) => event.key === "Escape" && leave()}
    />
    <span id="message-count" class=${`small number ${cut ? "bad" : "muted"}`}>
      ${cut ? `${cut} too many: the first ${MESSAGE_CHARS_MAX} are sent, with "..." after them` : `${count} of ${MESSAGE_CHARS_MAX}`}
    </span>
  </div>`;
}

/**
 * Keys act on the whole page, but not in fields, and not with modifiers.
 * @param {{actions: string[], chosen: string | null, choose: (action: string) => void, send: () => void, write: () => void}} does
 */
function useKeys(does) {
  const latest = useRef(does);
  latest.current = does;
  useEffect(() => {
    const pressed = (/** @type {KeyboardEvent} */ event) => {
      const { actions, chosen, choose, send, write } = latest.current;
      const target = event.target instanceof Element ? event.target : null;
      if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || event.isComposing) return;
      if (target?.closest("input:not([type=checkbox]), select, textarea, dialog")) return;
      const button = target?.closest("button, a, summary, input");
      const action = actions.find((action) => ACTIONS[action]?.keys.includes(event.key));
      if (action && !(button && event.key === " ")) choose(action);
      else if (event.key === "m" || event.key === "M") write();
      // Enter presses the button that has the focus, except the one of the chosen action.
      else if (event.key === "Enter" && (!button || (chosen && button.getAttribute("data-action") === chosen))) send();
      else return;
      event.preventDefault();
    };
    document.addEventListener("keydown", pressed);
    return () => document.removeEventListener("keydown", pressed);
  }, []);
}
