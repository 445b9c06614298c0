// Without scripts every page links to the same data, and says what it is.
import assert from "node:assert/strict";
import { PLACES, full } from "./support/site.mjs";
import { suite } from "./support/suite.mjs";

const { visit } = suite({ keys: true }, full);

visit(
  "pages without scripts link to their data",
  async ({ page, context, watch }, { program, data }) => {
    // Without scripts Chromium does not preload them either.
    watch.expect(/^failed: .*\.m?js csp$/);
    for (const { name, address } of PLACES.filter(({ name }) => name !== "missing")) {
      await page.goto(address(data));
      await page.getByRole("heading", { level: 1 }).waitFor();
      const links = await page.getByRole("link").evaluateAll((links) => links.map((link) => link.getAttribute("href") ?? ""));
      assert.ok(links.includes("/docs"), name);
      for (const link of links.filter((link) => link !== "/docs")) {
        const answer = await context.request.get(link, { headers: { Authorization: `Bearer ${program.organizer}` } });
        assert.equal(answer.status(), 200, `${name}: ${link}`);
      }
    }
  },
  { javaScriptEnabled: false },
);
