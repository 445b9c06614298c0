// Games as files, for analysis.
import { html, useState } from "../ui.js";
import { withQuery } from "../api.js";
import { Download } from "../parts/download.js";
import { TASKS } from "../parts/tasks.js";

const FILES = [
  ["episodes", "a row a game"],
  ["acts", "a row an act, with answers and reasoning"],
  ["rounds", "a row a state"],
  ["heard", "a row a message that an agent received"],
  ["views", "a row an agent's window"],
];

/** @type {[string, string][]} */
const NAMES = [
  ["dataset.zip", "dataset.zip: the files of the public toolkit"],
  ...FILES.flatMap(([name, text]) => ["jsonl", "parquet"].map((form) => /** @type {[string, string]} */ ([`${name}.${form}`, `${name}.${form}: ${text}`]))),
];

const EMPTY = { task: "", model: "", status: "", run: "", episode: "", mixed: "" };

export function View() {
  const [file, setFile] = useState("episodes.jsonl");
  const [filters, setFilters] = useState(EMPTY);
  const set = (/** @type {string} */ name) => (/** @type {any} */ event) => setFilters({ ...filters, [name]: event.target.value.trim() });
  return html`
    <h2>Exports</h2>
    <p>Games that have ended, in one file. What is left empty does not filter.</p>
    <form onSubmit=${(/** @type {Event} */ event) => event.preventDefault()}>
      <${Choice} label="File" value=${file} set=${(/** @type {any} */ event) => setFile(event.target.value)} options=${NAMES} />
      <${Choice} label="Task" value=${filters.task} set=${set("task")} options=${[["", "all"], ...TASKS.map((task) => [task, task])]} />
      <${Choice} label="Status" value=${filters.status} set=${set("status")} options=${[["", "all that have ended"], ...["finished", "aborted", "abandoned", "running"].map((name) => [name, name])]} />
      <${Choice} label="Seats" value=${filters.mixed} set=${set("mixed")} options=${[["", "any"], ["true", "of several holders"], ["false", "of one holder"]]} />
      ${["model", "run", "episode"].map(
        (name) => html`<label class="field">${{ model: "Model", run: "Id of a run", episode: "Id of a game" }[name]}<input value=${filters[name]} onInput=${set(name)} autocomplete="off" spellcheck=${false} /></label>`,
      )}
      <p class="buttons"><${Download} href=${withQuery(`/api/v1/exports/${file}`, filters)} name=${file}>Download<//></p>
    </form>
  `;
}

/** @param {{label: string, value: string, set: (event: any) => void, options: string[][]}} props */
const Choice = ({ label, value, set, options }) => html`<label class="field">${label}<select value=${value} onChange=${set}>
  ${options.map(([name, text]) => html`<option value=${name}>${text}</option>`)}
</select></label>`;
