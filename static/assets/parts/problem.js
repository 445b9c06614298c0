// Problems, and what to do about them.
import { html } from "../ui.js";
import { Problem, key, remember } from "../api.js";
import { openKeyDialog } from "./header.js";
import { Text } from "./text.js";

/** Codes of problems in words for visitors. */
const ADVICE = {
  offline: ["The server does not answer", "It may be restarting. This page tries again by itself, or at once:"],
  not_found: [
    "Not found",
    "The link may be wrong or cut off, or this is private: then enter the key of its creator, or of an organizer.",
  ],
  forbidden: ["Not for everybody yet", "Its creator and organizers can read it with a key."],
  unauthorized: [
    "The key or token is not accepted",
    "It was revoked, replaced, or has expired, or this server is private. Enter another one, or go on without.",
  ],
  no_key: ["This needs a key", "This server is private, or shows this only with a key. An organizer gives you one."],
  rate_limited: ["Too many requests", "Wait a moment."],
  overloaded: ["The server is busy", "Wait a moment."],
  unavailable: ["The server is not ready", "It may be starting. Wait a moment."],
};

/**
 * A problem in place of content that could not be loaded.
 * @param {{problem: Error, retry?: () => void, what?: string}} props
 */
export function ProblemNote({ problem, retry, what }) {
  const answered = problem instanceof Problem ? problem.code : "";
  const code = answered === "unauthorized" && !key() ? "no_key" : answered;
  const [title, advice] = ADVICE[/** @type {keyof typeof ADVICE} */ (code)] ?? [
    "Something went wrong",
    "Load the page again. If it happens again, tell the operator of this server.",
  ];
  const mayNeedKey = ["not_found", "forbidden", "unauthorized", "no_key"].includes(code);
  return html`<div class="problem" role="alert">
    <h2>${what ? html`${what}: ${title.toLowerCase()}` : title}</h2>
    ${code !== "no_key" && html`<p><${Text} value=${problem.message} /></p>`}
    ${problem instanceof Problem && html`<${FieldProblems} problem=${problem} />`}
    <p class="muted">${advice}</p>
    <p class="buttons">
      ${retry && html`<button type="button" onClick=${retry}>Try again</button>`}
      ${mayNeedKey && html`<button type="button" onClick=${openKeyDialog}>Enter a key</button>`}
      ${code === "unauthorized" && key() && html`<button type="button" onClick=${forget}>Forget the key</button>`}
      <a href="/">Front page</a>
    </p>
  </div>`;
}

function forget() {
  remember("key", null);
  location.reload();
}

/** The problems of a form's fields. @param {{problem: Problem}} props */
export const FieldProblems = ({ problem }) =>
  problem.fields.length > 0 &&
  html`<ul>
    ${problem.fields.map(
      ({ field, problem: what }) => html`<li><code><${Text} value=${field} /></code> <${Text} value=${what} /></li>`,
    )}
  </ul>`;
