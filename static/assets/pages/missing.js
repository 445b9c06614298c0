import { html } from "../ui.js";
import { Text } from "../parts/text.js";

/** The page for an unknown address. */
export const Page = () => html`
  <h1>No such page</h1>
  <p>There is nothing at <code><${Text} value=${location.pathname} /></code>. The link may be wrong or cut off.</p>
  <ul>
    <li><a href="/">Front page</a>: live games and boards</li>
    <li><a href="/boards">Boards</a>, <a href="/competitions">competitions</a>, <a href="/episodes">games</a></li>
    <li><a href="/docs">All routes of the API</a></li>
  </ul>
`;
