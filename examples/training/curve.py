"""Draws the learning curves of policies, from the files of `ppo.py`.

    python examples/training/curve.py runs/*/curve.csv --out learning.svg --data learning.csv

`--data` writes the drawn points in the same form, so that the figure can be made again from them.
"""

import argparse
import csv
from collections import defaultdict
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

POINTS_MAX = 120
"""The maximum number of points of a curve."""

BESIDE = {
    "Foraging": {"best rule": 0.95, "best model": 5.80, "humans": 20.40},
    "Pursuit": {"best rule": 9.15, "best model": 9.60},
    "Synchronization": {"best rule": 0.35, "best model": 12.60, "humans": 41.95},
    "Flocking": {"best rule": 4.68, "best model": 9.40, "humans": 11.70},
}
"""The paper's scores in the same setting (docs/evaluate/baselines.md)."""

DASHES = {"best rule": "--", "best model": "-.", "humans": ":"}

LABEL = 0.09
"""The height of a label, as a share of the axis."""

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "swarmbench",
}

Rows = list[dict[str, str]]


def read(files: list[Path]) -> dict[str, Rows]:
    """The rows of all files, by task, thinned to the drawn points."""
    tasks: defaultdict[str, Rows] = defaultdict(list)
    for file in files:
        with file.open(newline="") as lines:
            for row in csv.DictReader(lines):
                tasks[row["task"]].append(row)
    return {task: _thinned(tasks[task]) for task in BESIDE if task in tasks}


def _thinned(rows: Rows) -> Rows:
    rows = [row for row in rows if row["score"] != "nan"]
    each = -(-len(rows) // POINTS_MAX)
    return [row for place, row in enumerate(rows) if place % each == 0 or place == len(rows) - 1]


def draw(axes: Axes, task: str, rows: Rows) -> None:
    """Draws one curve, and the lines of the paper."""
    minutes = [float(row["processor_s"]) / 60 for row in rows]
    axes.plot(minutes, [float(row["score"]) for row in rows], color="#0072B2", linewidth=1.4)
    top = 1.05 * max(*BESIDE[task].values(), *(float(row["score"]) for row in rows))
    at = 0.0
    for name, score in BESIDE[task].items():
        axes.axhline(score, color="#555555", linewidth=0.8, linestyle=DASHES[name])
        at = max(score, at)
        axes.annotate(
            f"{name} {score:.2f}",
            xy=(1, score),
            xytext=(1.02, at),
            xycoords=axes.get_yaxis_transform(),
            va="center",
            fontsize=7,
            annotation_clip=False,
        )
        at += LABEL * top
    axes.set_title(task, loc="left")
    axes.set_xlim(0, max(minutes))
    axes.set_ylim(0, top)
    axes.yaxis.set_major_locator(MaxNLocator(5))
    axes.set_xlabel("minutes of one processor")
    axes.set_ylabel("score of a game")


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description="Draws how policies learned, beside the scores of the paper.")
    parser.add_argument("curves", type=Path, nargs="+", metavar="curve.csv")
    parser.add_argument("--out", type=Path, default=Path("learning.svg"), help="the figure: .svg, .png or .pdf")
    parser.add_argument("--data", type=Path, help="where the points that are drawn are kept")
    given = parser.parse_args()
    tasks = read(given.curves)
    if given.data:
        with given.data.open("w", newline="") as file:
            names = next(iter(tasks.values()))[0].keys()
            kept = csv.DictWriter(file, names, lineterminator="\n")
            kept.writeheader()
            kept.writerows(row for rows in tasks.values() for row in rows)
    columns = min(2, len(tasks))
    lines = -(-len(tasks) // columns)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(3.6 * columns, 2.3 * lines), layout="constrained")
        for place, (task, rows) in enumerate(tasks.items()):
            draw(figure.add_subplot(lines, columns, place + 1), task, rows)
        figure.savefig(given.out, dpi=150, metadata={"Date": None} if given.out.suffix == ".svg" else None)


if __name__ == "__main__":
    main()
