"""All tables and figures of the paper for a set of games, in one folder, and the command `swarmseat-analysis`."""

import argparse
import html
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from ..errors import SwarmbenchError
from .attribution import ACTS_MAX, action_attribution
from .correlations import convergence_by_model, convergence_by_task, correlations, failure_modes
from .figures import (
    plot_attribution,
    plot_blocks,
    plot_correlation_matrix,
    plot_correlations,
    plot_dynamics,
    plot_keywords,
    plot_scatter,
    plot_score_trends,
    plot_scores,
    plot_sensitivity,
    plot_shap,
    save,
)
from .problems import AnalysisError, FilesError
from .regression import blocks, regression
from .scores import score_table, scores
from .stopwords import SOURCE
from .tables import Games, load
from .texts import relate_to_edits
from .words import distinctive_words, keywords
from .write import html_table, latex_table, markdown_table, markdown_text

FORMATS = ("png", "svg")

ROWS_SHOWN_MAX = 60
"""The maximum number of rows of a table in the report; the files have all rows."""

PANELS_MAX = 100
"""The maximum number of pairs of model and task whose dynamics are drawn."""

CAUTIONS = (
    "The paper speaks of twelve metrics and defines thirteen. The deviation of message lengths is the one that its "
    "figures do not show; correlations and regressions here use the other twelve.",
    "The paper concludes that what agents say matters little for the score. The metric with the largest correlation "
    "is still one of messages in two of its five tasks.",
    "The exploration rate is a number of cells, not a share. The dynamics figure draws the distance walked since the "
    "start; tables have the distance of one round.",
    "In the paper, messages that an agent received include its own last one. Here the agent's own message and action "
    "are a block of their own.",
    "A push event is also counted where an agent only follows another that walks away by itself (`pushes_strict` "
    "leaves those out).",
    "Where all messages of a round are the same text, their homogeneity is 1 here; the figures of the paper have 0 "
    "there.",
    "Correlations over all tasks of a model pool scores of different scales. Read the columns `within_r` and "
    "`within_p`, which are standardised within each task.",
    "The paper does not correct for testing many metrics. Read `q`, not `p`, to judge one metric among twelve, and "
    "the intervals of the bootstrap: games of one model are not independent of each other.",
)
"""Caveats of comparisons with numbers of the paper."""


class _Part(NamedTuple):
    """A piece of the report: a table or a figure, or the reason why it is missing."""

    kind: str
    name: str
    title: str
    markdown: str
    html: str


@dataclass
class Report:
    """The written files, and the missing pieces.

    Attributes:
        folder: The folder of the files.
        files: The files, by name.
        missing: The missing pieces, with reasons.
    """

    folder: Path
    formats: Sequence[str] = FORMATS
    files: list[str] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)
    _parts: list[_Part] = field(default_factory=list, repr=False)

    def heading(self, title: str) -> None:
        """Begins a section."""
        self._parts.append(_Part("heading", "", title, f"## {title}\n", f"<h2>{html.escape(title)}</h2>"))

    def text(self, text: str) -> None:
        """Adds a paragraph."""
        self._parts.append(_Part("text", "", "", markdown_text(text) + "\n", f"<p>{html.escape(text)}</p>"))

    def table(self, name: str, title: str, table: pd.DataFrame) -> None:
        """Writes a table as CSV, Markdown and LaTeX, and shows it."""
        table.to_csv(self._path(f"tables/{name}.csv"), index=False, lineterminator="\n")
        self._write(f"tables/{name}.md", markdown_table(table))
        self._write(f"tables/{name}.tex", latex_table(table, title))
        shown = table.head(ROWS_SHOWN_MAX)
        more = "" if len(shown) == len(table) else f"{len(table) - len(shown)} more rows are in tables/{name}.csv."
        self._parts.append(
            _Part(
                "table",
                name,
                title,
                f"**{markdown_text(title)}** ([CSV](tables/{name}.csv), [LaTeX](tables/{name}.tex))\n\n"
                f"{markdown_table(shown)}\n{more}\n",
                f"<h3>{html.escape(title)}</h3>{html_table(shown)}<p>{more}</p>",
            )
        )

    def figure(self, name: str, title: str, figure: Figure) -> None:
        """Writes a figure in all formats, and shows it."""
        for kind in self.formats:
            save(figure, self._path(f"figures/{name}.{kind}"))
        shown, caption = f"figures/{name}.{self.formats[0]}", html.escape(title)
        self._parts.append(
            _Part(
                "figure",
                name,
                title,
                f"![{markdown_text(title)}]({shown})\n",
                f'<figure><img src="{shown}" alt="{caption}"><figcaption>{caption}</figcaption></figure>',
            )
        )

    @contextmanager
    def attempt(self, title: str) -> Iterator[None]:
        """Writes into the report why a piece cannot be made, instead of raising the error."""
        try:
            yield
        except AnalysisError as error:
            self.missing[title] = str(error)
            self._parts.append(
                _Part(
                    "missing",
                    "",
                    title,
                    f"**{markdown_text(title)}**: not made. {markdown_text(str(error))}\n",
                    f"<p><strong>{html.escape(title)}</strong>: not made. {html.escape(str(error))}</p>",
                )
            )

    def finish(self, title: str) -> None:
        """Writes `report.md` and `report.html`."""
        self._write("report.md", "\n".join([f"# {markdown_text(title)}\n", *(part.markdown for part in self._parts)]))
        body = "\n".join(part.html for part in self._parts)
        self._write("report.html", _PAGE.format(title=html.escape(title), body=body))

    def _path(self, name: str) -> Path:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        self.files.append(name)
        return path

    def _write(self, name: str, text: str) -> None:
        self._path(name).write_text(text, encoding="utf-8")


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; }}
table {{ border-collapse: collapse; font-size: 13px; display: block; overflow-x: auto; }}
th, td {{ border-bottom: 1px solid #ccc; padding: .2rem .6rem; text-align: left; }}
img {{ max-width: 100%; }} figure {{ margin: 1rem 0; }}
</style></head><body><h1>{title}</h1>
{body}
</body></html>
"""

Step = tuple[str, Callable[[], None]]


def report(
    games: Games,
    out: str | Path,
    *,
    quick: bool = False,
    acts: int = ACTS_MAX,
    formats: Sequence[str] = FORMATS,
    progress: Callable[[str], None] = lambda _: None,
) -> Report:
    """Writes all tables and figures for the games into a folder.

    Args:
        games: The games.
        out: A folder that does not exist, or is empty.
        quick: Leaves out the attribution of actions, which takes longest.
        acts: The maximum number of acts of a model in a task that the attribution uses.
        formats: Formats of figures: `png`, `svg`, `pdf`. The first is shown in the report.
        progress: A function that gets a line before each step.

    Returns:
        The written files, and the missing pieces. A missing piece does not end the report.

    Raises:
        FilesError: The folder has files.
    """
    folder = Path(out)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise FilesError(f"{folder} has files, and nothing is overwritten: name another folder")
    folder.mkdir(parents=True, exist_ok=True)
    made = Report(folder, tuple(formats))
    made.heading("Games")
    made.text(_about(games))
    for sentence in games.left_out:
        made.text(sentence)
    steps = _steps(games, made, progress, acts=0 if quick else acts)
    for at, (title, step) in enumerate(steps, 1):
        progress(f"[{at:>{len(str(len(steps)))}}/{len(steps)}] {title}")
        with made.attempt(title):
            step()
    made.heading("What to be careful about")
    for caution in CAUTIONS:
        made.text(caution)
    made.finish("Analysis of SwarmBench games")
    return made


def _about(games: Games) -> str:
    count = {"games": len(games), "models": len(games.models), "tasks": len(games.tasks)}
    known = [
        f"{what} {games.episodes[name].dropna().iloc[0]}"
        for name, what in (("metrics_revision", "metrics of revision"), ("embedder", "text vectors of"))
        if name in games.episodes and games.episodes[name].notna().any()
    ]
    return ", ".join([*(f"{number} {name}" for name, number in count.items()), *known]) + "."


def _steps(games: Games, made: Report, progress: Callable[[str], None], *, acts: int) -> list[Step]:
    steps: list[Step] = [
        ("Scores", lambda: _scores(games, made)),
        ("Scores by setting", lambda: _by_setting(games, made)),
    ]
    steps.append(
        ("Score trends", lambda: made.figure("score-trends", "Scores round by round", plot_score_trends(games)))
    )
    for task in games.tasks:
        steps += [(f"{task}: {what}", _of_task(step, games, task, made)) for what, step in _TASK_STEPS.items()]
    steps += [
        ("Physical metrics and communication", lambda: _blocks(games, made)),
        ("Failure modes", lambda: made.table("failure-modes", "Failure modes and the score", failure_modes(games))),
        (
            "Convergence by task",
            lambda: made.table("convergence-by-task", "Convergence and the score, by task", convergence_by_task(games)),
        ),
        (
            "Convergence by model",
            lambda: made.table(
                "convergence-by-model", "Convergence and the score, by model", convergence_by_model(games)
            ),
        ),
        ("Homogeneity and edit similarity", lambda: _edits(games, made)),
        ("Keywords", lambda: _keywords(games, made)),
        (
            "Distinctive words",
            lambda: made.table("distinctive-words", "Words that set a model apart", distinctive_words(games)),
        ),
    ]
    if acts:
        steps.append(("Attribution of actions", lambda: _attribution(games, made, acts, progress)))
    played = games.episodes[["task", "model"]].drop_duplicates().sort_values(["task", "model"])
    for number, (task, model) in enumerate(played.head(PANELS_MAX).itertuples(index=False, name=None), 1):
        steps.append((f"Dynamics: {task}, {model}", _dynamics(games, task, model, number, made)))
    return steps


def _of_task(step: Callable[[Games, str, Report], None], games: Games, task: str, made: Report) -> Callable[[], None]:
    return lambda: step(games.where(task=task), task, made)


def _scores(games: Games, made: Report) -> None:
    made.heading("Scores")
    made.table("scores", "Scores: mean ± population deviation (games)", score_table(games))
    made.figure("scores", "Scores by task and model", plot_scores(games))


def _by_setting(games: Games, made: Report) -> None:
    differing = games.differing()
    if not differing:
        return
    by = ["model", "task", *differing]
    made.table("scores-by-setting", f"Scores by {', '.join(by)}", scores(games, by))
    if {"num_agents", "view_size"} <= set(differing):
        made.figure("sensitivity", "Scores by number of agents and view size", plot_sensitivity(games))


def _correlations(games: Games, task: str, made: Report) -> None:
    made.heading(task)
    table = correlations(games)
    made.table(f"correlations-{task}", f"{task}: metrics and the score", table.drop(columns="task"))
    made.figure(f"correlations-{task}", f"{task}: metrics and the score", plot_correlations(table, task))
    made.figure(f"matrix-{task}", f"{task}: all pairs of metrics", plot_correlation_matrix(games, task))
    made.figure(f"scatter-{task}", f"{task}: the metric with the largest correlation", plot_scatter(games, task))


def _regression(games: Games, task: str, made: Report) -> None:
    found = regression(games, task)
    made.table(f"regression-{task}", f"{task}: the score on all metrics", found.coefficients)
    made.table(f"regression-quality-{task}", f"{task}: quality of the regression", pd.DataFrame([found.quality]))
    for note in found.notes:
        made.text(note)
    made.figure(f"shap-{task}", f"{task}: SHAP values", plot_shap(found))


_TASK_STEPS: dict[str, Callable[[Games, str, Report], None]] = {
    "correlations": _correlations,
    "regression": _regression,
}


def _blocks(games: Games, made: Report) -> None:
    made.heading("All tasks")
    table = blocks(games)
    made.table("blocks", "Physical metrics and communication: how much of the score each explains", table)
    made.figure("blocks", "Shares of the explained variance", plot_blocks(table))


def _edits(games: Games, made: Report) -> None:
    made.table(
        "homogeneity-and-edits",
        "Homogeneity and edit similarity",
        relate_to_edits(games),
    )


def _keywords(games: Games, made: Report) -> None:
    table = keywords(games)
    made.table("keywords", f"Keywords (without the words of: {SOURCE})", table)
    made.figure("keywords", "Keywords by task and model", plot_keywords(table))


def _attribution(games: Games, made: Report, acts: int, progress: Callable[[str], None]) -> None:
    table = action_attribution(games, acts=acts, progress=lambda line: progress(f"    {line}"))
    made.table("attribution", "What actions follow from", table)
    made.figure("attribution", "Importance of blocks of inputs for the next action", plot_attribution(table))


def _dynamics(games: Games, task: str, model: str, number: int, made: Report) -> Callable[[], None]:
    # Names of models are not valid file names; the number distinguishes names that become the same.
    name = f"dynamics-{task}-{number:03}-{re.sub(r'[^A-Za-z0-9]+', '-', model)[:40]}"
    return lambda: made.figure(name, f"Dynamics: {task}, {model}", plot_dynamics(games, task, model))


def main(arguments: Sequence[str] | None = None) -> int:
    """The command `swarmseat-analysis`. Returns the exit status: 0, 1 for a problem, 130 if it was interrupted."""
    asked = _parser().parse_args(arguments)
    try:
        games = load(asked.source, **dict(asked.where))
        made = report(
            games,
            asked.out,
            quick=asked.quick,
            acts=asked.acts,
            formats=asked.formats,
            progress=lambda line: print(line, file=sys.stderr),
        )
    except SwarmbenchError as error:
        print(f"swarmseat-analysis: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"stopped: what was made until then is in {asked.out}, without report.md", file=sys.stderr)
        return 130
    for title, reason in made.missing.items():
        print(f"not made: {title}: {reason}", file=sys.stderr)
    print(made.folder / "report.html")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="swarmseat-analysis", description="Analyses games of SwarmBench.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    command = commands.add_parser("report", help="write all tables and figures of the paper into a folder")
    command.add_argument(
        "source", help="a folder of `swarmbench export --format parquet` (or jsonl), or a server's address"
    )
    command.add_argument("--out", required=True, help="the folder to write; it must not exist, or be empty")
    command.add_argument(
        "--quick", action="store_true", help="leave out the attribution of actions, which takes longest"
    )
    command.add_argument(
        "--acts",
        type=_positive,
        default=ACTS_MAX,
        metavar="N",
        help=f"how many acts of a model in a task the attribution uses at most ({ACTS_MAX})",
    )
    command.add_argument(
        "--where",
        action="append",
        default=[],
        type=_condition,
        metavar="COLUMN=VALUE",
        help="only these games, such as num_agents=12; may be repeated for several columns",
    )
    command.add_argument(
        "--formats", default=FORMATS, type=_formats, metavar="LIST", help="formats of figures (png,svg); also pdf"
    )
    return parser


def _condition(text: str) -> tuple[str, Any]:
    name, found, value = text.partition("=")
    if not found:
        raise argparse.ArgumentTypeError(f"{text!r} is not COLUMN=VALUE, such as task=Pursuit")
    for kind in (int, float):
        try:
            return name, kind(value)
        except ValueError:
            continue
    return name, {"true": True, "false": False}.get(value, value)


def _positive(text: str) -> int:
    if not text.isdecimal() or not int(text):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1")
    return int(text)


def _formats(text: str) -> tuple[str, ...]:
    kinds = tuple(text.split(","))
    unknown = set(kinds) - {"png", "svg", "pdf"}
    if unknown:
        raise argparse.ArgumentTypeError(f"{', '.join(sorted(unknown))}: formats are png, svg and pdf")
    return kinds
