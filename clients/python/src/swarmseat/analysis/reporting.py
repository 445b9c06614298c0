"""The command `swarmseat-analysis`: one table or figure of the paper, or all of them in a folder with a report."""

import argparse
import csv
import html
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from ..errors import SwarmbenchError
from .attribution import ACTS_MAX
from .figures import save
from .metrics import TWELVE
from .pieces import OF_TEAMS, PIECES, Options, Output, Piece
from .problems import AnalysisError, FilesError
from .tables import Games, load

FORMATS = ("png", "svg")

FIGURES = ("png", "svg", "pdf")
TABLES = ("csv", "tex", "html")

DIGITS = 4
"""The significant digits of numbers; CSV files have all digits."""

ROWS_SHOWN_MAX = 60
"""The maximum number of rows of a table in the report; the files have all rows."""

PANELS_MAX = 100
"""The maximum number of pairs of model and task whose dynamics are drawn."""

CAUTION = (
    "Games of one model are not independent, and twelve metrics are tested: docs/evaluate/analysis.md says how to read "
    "p, q and the intervals, and docs/evaluate/metrics.md in which points the paper contradicts itself."
)


def write_table(table: pd.DataFrame, path: str | Path) -> None:
    """Writes a table in the format of the name's end: `.csv`, `.html`, or `.tex` for the LaTeX package booktabs.

    Text of players is escaped.
    """
    path = Path(path)
    if path.suffix == ".csv":
        table.to_csv(path, index=False, lineterminator="\n")
        return
    look: dict[str, Any] = {"index": False, "escape": True, "na_rep": "", "float_format": f"%.{DIGITS}g"}
    text = _html(table) if path.suffix == ".html" else table.to_latex(**look)
    path.write_text(text, encoding="utf-8")


def _html(table: pd.DataFrame) -> str:
    look = f"{{:.{DIGITS}g}}".format
    return str(table.to_html(index=False, escape=True, na_rep="", float_format=look, border=0))


@dataclass
class Report:
    """A folder of tables and figures, with a page around them.

    Attributes:
        folder: The folder.
        formats: The formats of figures; the page shows the first.
        missing: The missing pieces, with reasons.
    """

    folder: Path
    formats: Sequence[str] = FORMATS
    missing: dict[str, str] = field(default_factory=dict)
    _parts: list[str] = field(default_factory=list, repr=False)

    def heading(self, title: str) -> None:
        """Begins a section."""
        self._parts.append(f"<h2>{html.escape(title)}</h2>")

    def add(self, name: str, title: str, output: Output) -> None:
        """Adds a paragraph, a table (as CSV and LaTeX), or a figure in all formats."""
        caption = html.escape(title)
        if isinstance(output, Figure):
            for kind in self.formats:
                save(output, self._path(f"figures/{name}.{kind}"))
            shown = f"figures/{name}.{self.formats[0]}"
            self._parts.append(
                f'<figure><img src="{shown}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'
            )
        elif isinstance(output, pd.DataFrame):
            for kind in ("csv", "tex"):
                write_table(output, self._path(f"tables/{name}.{kind}"))
            more = len(output) - ROWS_SHOWN_MAX
            rest = f"<p>{more} more rows are in tables/{name}.csv.</p>" if more > 0 else ""
            self._parts.append(f"<h3>{caption}</h3>{_html(output.head(ROWS_SHOWN_MAX))}{rest}")
        else:
            self._parts.append(f"<p>{html.escape(output)}</p>")

    def attempt(self, name: str, title: str, outputs: Iterator[Output]) -> None:
        """Adds all outputs of a piece. Where they end with an error, the report says why."""
        try:
            for output in outputs:
                self.add(name, title, output)
        except AnalysisError as error:
            self.missing[title] = str(error)
            why = html.escape(str(error))
            self._parts.append(f"<p><strong>{html.escape(title)}</strong>: not made. {why}</p>")

    def finish(self, title: str) -> None:
        """Writes `report.html`."""
        body = "\n".join(self._parts)
        self._path("report.html").write_text(_PAGE.format(title=html.escape(title), body=body), encoding="utf-8")

    def _path(self, name: str) -> Path:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


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
        The report, which names the missing pieces: these do not end it.

    Raises:
        FilesError: The folder has files.
    """
    folder = Path(out)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise FilesError(f"{folder} has files, and nothing is overwritten: name another folder")
    folder.mkdir(parents=True, exist_ok=True)
    made = Report(folder, tuple(formats))
    made.heading("Games")
    for sentence in (_about(games), *games.left_out, CAUTION):
        made.add("", "", sentence)
    pieces = {name: piece for name, piece in PIECES.items() if _is_wanted(name, games, quick=quick)}
    asked = Options(acts=acts, progress=lambda line: progress(f"    {line}"))
    for at, (name, piece) in enumerate(pieces.items(), 1):
        progress(f"[{at:>{len(str(len(pieces)))}}/{len(pieces)}] {piece.title}")
        made.heading(piece.title)
        for file, title, own in _parts(name, piece, games):
            made.attempt(file, title, piece.make(own, asked))
    made.finish("Analysis of SwarmBench games")
    return made


def _is_wanted(name: str, games: Games, *, quick: bool) -> bool:
    if name == "sensitivity":
        return bool((games.episodes[["num_agents", "view_size"]].nunique() > 1).all())
    if name in OF_TEAMS:
        return "team" in games.episodes and bool(games.episodes["team"].str.contains(",", na=False).any())
    return not (quick and name == "attribution")


def _parts(name: str, piece: Piece, games: Games) -> Iterator[tuple[str, str, Games]]:
    """The name, the title and the games of each table or figure of a piece."""
    if piece.of == "all":
        yield name, piece.title, games
    elif piece.of == "task":
        for task in games.tasks:
            yield f"{name}-{task}", f"{task}: {piece.title}", games.where(task=task)
    else:
        played = games.episodes[["task", "model"]].drop_duplicates().sort_values(["task", "model"])
        for number, (task, model) in enumerate(played.head(PANELS_MAX).itertuples(index=False, name=None), 1):
            # Names of models are not valid file names; the number distinguishes names that become the same.
            file = f"{name}-{task}-{number:03}-{re.sub(r'[^A-Za-z0-9]+', '-', model)[:40]}"
            yield file, f"{task}, {model}: {piece.title}", games.where(task=task, model=model)


def _about(games: Games) -> str:
    count = {"games": len(games), "models": len(games.models), "tasks": len(games.tasks)}
    known = [
        f"{what} {games.episodes[name].dropna().iloc[0]}"
        for name, what in (("metrics_revision", "metrics of revision"), ("embedder", "text vectors of"))
        if name in games.episodes and games.episodes[name].notna().any()
    ]
    return ", ".join([*(f"{number} {name}" for name, number in count.items()), *known]) + "."


def main(arguments: Sequence[str] | None = None) -> int:
    """The command `swarmseat-analysis`. Returns the exit status: 0, 1 for a problem, 130 if it was interrupted."""
    asked = _parser().parse_args(arguments)
    try:
        usual = {"mixed": [True, False]} if asked.piece in OF_TEAMS else {}
        games = load(asked.source, **{**usual, **dict(asked.where)})
        if asked.piece == "report":
            _report(asked, games)
        else:
            _piece(asked, games)
    except SwarmbenchError as error:
        _say(f"swarmseat-analysis: {error}")
        return 1
    except KeyboardInterrupt:
        _say("stopped" if asked.out is None else f"stopped: what was made until then is in {asked.out}")
        return 130
    return 0


def _say(line: str) -> None:
    print(line, file=sys.stderr)


def _report(asked: argparse.Namespace, games: Games) -> None:
    made = report(games, asked.out, quick=asked.quick, acts=asked.acts, formats=asked.formats, progress=_say)
    for title, reason in made.missing.items():
        _say(f"not made: {title}: {reason}")
    print(made.folder / "report.html")


def _piece(asked: argparse.Namespace, games: Games) -> None:
    """Writes the table or the figure of a piece, by the end of the file's name; without a file the table is shown."""
    piece, end = PIECES[asked.piece], "" if asked.out is None else asked.out.suffix[1:]
    kind = Figure if end in FIGURES else pd.DataFrame
    options = Options(progress=_say, **{name: getattr(asked, name) for name in piece.options})
    for output in piece.make(games, options):
        if isinstance(output, str):
            _say(output)
        elif isinstance(output, kind):
            _put(output, asked.out)
            return
    what, ends = ("figure", FIGURES) if kind is pd.DataFrame else ("table", TABLES)
    raise AnalysisError(f"{asked.piece} is a {what}: name a file with --out that ends in .{', .'.join(ends)}")


def _put(output: pd.DataFrame | Figure, path: Path | None) -> None:
    if isinstance(output, Figure):
        save(output, str(path))
    elif path is None:
        print(_printable(output.to_string(index=False, na_rep="", float_format=f"{{:.{DIGITS}g}}".format)))
    elif path.suffix[1:] in TABLES:
        write_table(output, path)
    else:
        raise AnalysisError(f"{path} must end in .{', .'.join((*TABLES, *FIGURES))}")


def _printable(text: str) -> str:
    """Text of players without characters that a terminal obeys."""
    return re.sub(r"[^\n\x20-\x7e\xa0-\u2029\u202f-\u2065\u206a-\U0010ffff]", "\ufffd", text)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="swarmseat-analysis", description="Analyses games of SwarmBench.")
    commands = parser.add_subparsers(required=True, metavar="NAME", dest="piece")
    for name, piece in PIECES.items():
        about = f"{piece.title} ({piece.paper})" if piece.paper else piece.title
        command = commands.add_parser(name, help=about, description=about)
        _add_source(command)
        ends = ", ".join(f".{kind}" for kind in (*TABLES, *FIGURES))
        command.add_argument("--out", type=Path, help=f"the file to write ({ends}); without it the table is shown")
        for option in piece.options:
            command.add_argument(f"--{option}", **_OPTIONS[option])
    about = "all of these in a folder, with a page around them"
    command = commands.add_parser("report", help=about, description=about)
    _add_source(command)
    command.add_argument("--out", required=True, help="the folder to write; it must not exist, or be empty")
    command.add_argument(
        "--quick", action="store_true", help="leave out the attribution of actions, which takes longest"
    )
    command.add_argument("--acts", **_OPTIONS["acts"])
    command.add_argument(
        "--formats", default=FORMATS, type=_formats, metavar="LIST", help="formats of figures (png,svg); also pdf"
    )
    return parser


def _add_source(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "source", nargs="+", help="a folder of `swarmbench export --format parquet` (or jsonl), or a server's address"
    )
    command.add_argument(
        "--where",
        action="append",
        default=[],
        type=_condition,
        metavar="COLUMN=VALUE,…",
        help="only games with one of these values, such as num_agents=8,12; none is a missing value; may be repeated",
    )


def _condition(text: str) -> tuple[str, list[Any]]:
    name, found, values = text.partition("=")
    if not found:
        raise argparse.ArgumentTypeError(f"{text!r} is not COLUMN=VALUE, such as task=Pursuit")
    # A value with commas stands in double quotes.
    return name, [_value(value) for value in next(csv.reader([values]), [""])]


def _value(text: str) -> Any:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return {"true": True, "false": False, "none": None}.get(text, text)


def _positive(text: str) -> int:
    if not text.isdecimal() or not int(text):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1")
    return int(text)


def _formats(text: str) -> tuple[str, ...]:
    kinds = tuple(text.split(","))
    unknown = set(kinds) - set(FIGURES)
    if unknown:
        raise argparse.ArgumentTypeError(f"{', '.join(sorted(unknown))}: formats are {', '.join(FIGURES)}")
    return kinds


_OPTIONS: dict[str, dict[str, Any]] = {
    "metrics": {
        "type": lambda text: text.split(","),
        "default": TWELVE,
        "metavar": "METRIC,…",
        "help": "columns of the table episodes (the twelve of the paper)",
    },
    "definition": {"choices": ("paper", "toolkit"), "default": "paper", "help": "the definition of metrics (paper)"},
    "across": {"default": "num_agents", "metavar": "SETTING", "help": "the horizontal axis (num_agents)"},
    "lines": {"default": "view_size", "metavar": "SETTING", "help": "what tells the lines apart (view_size)"},
    "acts": {
        "type": _positive,
        "default": ACTS_MAX,
        "metavar": "N",
        "help": f"how many acts of a model in a task the attribution uses at most ({ACTS_MAX})",
    },
}
