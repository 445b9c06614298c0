// Makes static/assets/vendor from the packages that package-lock.json names: bare imports become relative ones, as import
// maps are inline scripts, which the policy of the pages forbids. With --check the script writes nothing, and fails if the
// committed files differ.
import { mkdir, readFile, writeFile } from "node:fs/promises";
import { fileURLToPath } from "node:url";
import path from "node:path";

const here = path.dirname(fileURLToPath(import.meta.url));
const packages = path.join(here, "../node_modules");
const vendor = path.join(here, "../../static/assets/vendor");

const MODULES = {
  "preact.mjs": "preact/dist/preact.mjs",
  "hooks.mjs": "preact/hooks/dist/hooks.mjs",
  "htm.mjs": "htm/dist/htm.mjs",
};
const LICENSED = ["preact", "htm"];

/** @param {string} source */
const relative = (source) =>
  // Types of vendored files are not checked, as they are minified.
  `// @ts-nocheck\n${source}`
    .replaceAll(/from\s*"preact"/g, 'from"./preact.mjs"')
    .replaceAll(/\n?\/\/# sourceMappingURL=\S+\s*$/g, "\n");

/** @returns {Promise<Record<string, string>>} */
async function made() {
  const files = {};
  for (const [name, from] of Object.entries(MODULES)) {
    files[name] = relative(await readFile(path.join(packages, from), "utf8"));
  }
  const licences = LICENSED.map(async (name) => {
    const { version } = JSON.parse(await readFile(path.join(packages, name, "package.json"), "utf8"));
    const licence = await readFile(path.join(packages, name, "LICENSE"), "utf8");
    return `${name} ${version}\n\n${licence.trim()}\n`;
  });
  files["LICENSES.txt"] = (await Promise.all(licences)).join("\n\n");
  return files;
}

const files = await made();
if (process.argv.includes("--check")) {
  for (const [name, content] of Object.entries(files)) {
    const committed = await readFile(path.join(vendor, name), "utf8").catch(() => "");
    if (committed !== content) {
      console.error(`static/assets/vendor/${name} is not what the package has: run node tests/browser/vendor.mjs`);
      process.exitCode = 1;
    }
  }
} else {
  await mkdir(vendor, { recursive: true });
  for (const [name, content] of Object.entries(files)) {
    await writeFile(path.join(vendor, name), content);
  }
}
