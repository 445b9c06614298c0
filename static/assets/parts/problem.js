// Problems, and what to do about them.
import { html } from "../ui.js";
import { Problem, key } from "../api.js";
import { openKeyDialog, takeKey } from "./header.js";
import { Text } from "./text.js";

/** Codes of problems in words for visitors: what happened, and what to do. */
const ADVICE = {
  offline: ["The server does not answer", "It may be restarting. This page tries again by itself, or at once:"],
  not_found: ["Not found", "The link may be wrong or cut off, or this is private: then enter the key of its creator, or of an organizer."],
  forbidden: ["Not for everybody yet", "Its creator and organizers can read it with a key."],
  unauthorized: [
    "The key or token is not accepted",
    "It was revoked, replaced, or has expired, or this server is private. Enter another one, or go on without.",
  ],
  no_key: ["This needs a key", "This server is private, or shows this only with a key. An organizer gives you one."],
  rate_limited: ["Too many requests", "Wait a moment."],
  overloaded: ["The server is busy", "Wait a moment."],
  unavailable: ["The server is not ready", "It may be starting. Wait a moment."],
  other: ["Something went wrong", "Load the page again. If it happens again, tell the operator of this server."],
};

/**
 * A problem in place of content that could not be loaded.
 * @param {{problem: Error, retry?: () => void, what?: string}} props
 */
export function ProblemNote({ problem, retry, what }) {
  const answered = problem instanceof Problem ? problem.code : "";
  const code = answered === "unauthorized" && !key() ? "no_key" : answered;
  const [title, advice] = ADVICE[/** @type {keyof typeof ADVICE} */ (code)] ?? ADVICE.other;
  const mayNeedKey = ["not_found", "forbidden", "unauthorized", "no_key"].includes(code);
  return html`<div class="problem" role="alert">
    <h2>${what ? html`${what}: ${title.toLowerCase()}` : title}</h2>
    ${code !== "no_key" && html`<p><${Text} value=${problem.message} /></p>`}
    <${FieldProblems} problem=${problem} />
    <p class="muted">${advice}</p>
    <p class="buttons">
      ${retry && html`<button type="button" onClick=${retry}>Try again</button>`}
      ${mayNeedKey && html`<button type="button" onClick=${openKeyDialog}>Enter a key</button>`}
      ${code === "unauthorized" && key() && html`<button type="button" onClick=${() => takeKey(null)}>Forget the key</button>`}
      <a href="/">Front page</a>
    </p>
  </div>`;
}

/**
 * Stands in place of content that is not loaded: it loads, or could not be loaded.
 * @param {{of: {problem: Error | null, reload: () => void}, what?: string}} props of: what `useLoaded` returns
 */
export const Waiting = ({ of: { problem, reload }, what }) =>
  problem ? html`<${ProblemNote} problem=${problem} retry=${reload} what=${what} />` : html`<p class="muted" role="status">Loading …</p>`;

/** The problems of a form's fields. @param {{problem: any}} props */
export const FieldProblems = ({ problem: { fields = [] } }) =>
  fields.length > 0 && html`<ul>${fields.map(({ field, problem }) => html`<li><code><${Text} value=${field} /></code> <${Text} value=${problem} /></li>`)}</ul>`;
