"""Figures of matplotlib, without its global state.

Colour is never the only sign: markers, hatches and numbers say the same. The same games give the same bytes.
"""

import functools
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .correlations import correlation_matrix, correlations, top_metric
from .metrics import METRICS, TWELVE, Definition, column, title
from .problems import TooLittleDataError
from .regression import Regression
from .scores import drawn_metrics, dynamics, score_trends, scores
from .tables import Games

P = ParamSpec("P")

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#F0E442", "#000000")
"""The palette of Okabe and Ito, which colour-blind readers can tell apart."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">")
HATCHES = ("", "//", "..", "xx", "\\\\", "++", "oo", "--")
DASHES = ("-", "--", "-.", ":")
DIVERGING = "PuOr"

NAME_CHARS_MAX = 32
"""How much of a model's name is shown."""

DOTS_PER_INCH = 150

_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "hatch.linewidth": 0.5,
    # Names of models are shown as they are, dollars too.
    "text.parse_math": False,
    "text.usetex": False,
    # Otherwise ids in an SVG are random.
    "svg.hashsalt": "swarmbench",
}


def _styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Draws in the style of this module, whatever the user has set."""

    @functools.wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with mpl.rc_context():
            mpl.rcdefaults()
            mpl.rcParams.update(_STYLE)
            return draw(*args, **kwargs)

    return styled


def save(figure: Figure, path: str | Path) -> None:
    """Writes a figure in the format of the name's end (`.png`, `.svg`, `.pdf`), without a date."""
    kind = Path(path).suffix.lstrip(".")
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
    with mpl.rc_context(), warnings.catch_warnings():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        # Words in other scripts are shown as boxes where the font lacks them.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(path, dpi=DOTS_PER_INCH, metadata=metadata)


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")


def _short(name: str) -> str:
    short = name if len(name) <= NAME_CHARS_MAX else name[: NAME_CHARS_MAX - 1] + "…"
    # A label that begins with an underscore is left out of legends.
    return f" {short}" if short.startswith("_") else short


def _styles(names: Iterable[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """A colour, a marker and a dash for each name: the combination does not repeat among the first forty."""
    for at, name in enumerate(names):
        yield (
            name,
            {
                "color": COLOURS[at % len(COLOURS)],
                "marker": MARKERS[at % len(MARKERS)],
                "linestyle": DASHES[at // len(COLOURS) % len(DASHES)],
            },
        )


def _legend(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(4, max(1, len(labels))), frameon=False)


@_styled
def plot_scores(games: Games) -> Figure:
    """Mean scores as bars with population deviations: a group for each task, a bar for each model."""
    table = scores(games)
    tasks, models = games.tasks, games.models
    figure = _figure(2 + 0.25 * len(tasks) * len(models), 3.5)
    axes = figure.add_subplot()
    width = 0.8 / len(models)
    for at, (model, colour, hatch) in enumerate(zip(models, cycle(COLOURS), cycle(HATCHES), strict=False)):
        own = table[table["model"] == model]
        places = [tasks.index(task) + (at - (len(models) - 1) / 2) * width for task in own["task"]]
        axes.bar(
            places,
            own["mean"],
            width,
            yerr=own["deviation"],
            color=colour,
            hatch=hatch,
            edgecolor="black",
            linewidth=0.4,
            error_kw={"linewidth": 0.6},
            label=_short(model),
        )
    axes.set_xticks(range(len(tasks)), tasks)
    axes.set_ylabel("score (mean ± deviation)")
    _legend(figure, axes)
    return figure


@_styled
def plot_score_trends(games: Games) -> Figure:
    """The score after each round: a panel for each task, a line for each model, and its deviation as a band."""
    table = score_trends(games)
    figure = _figure(2.6 * len(games.tasks) + 0.6, 3.2)
    panels = figure.subplots(1, len(games.tasks), squeeze=False)[0]
    shown: dict[str, Any] = {}
    for task, axes in zip(games.tasks, panels, strict=True):
        for model, style in _styles(games.models):
            own = table[(table["task"] == task) & (table["model"] == model)]
            if own.empty:
                continue
            _band(axes, own, 1.0, style["color"])
            every = max(1, len(own) // 8)
            (line,) = axes.plot(own["round"], own["mean"], markevery=every, markersize=3, linewidth=1, **style)
            shown.setdefault(_short(model), line)
        axes.set(title=task, xlabel="round")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    panels[0].set_ylabel("score")
    figure.legend(list(shown.values()), list(shown), loc="outside lower center", ncols=4, frameon=False)
    return figure


def _band(axes: Axes, series: pd.DataFrame, divisor: float, colour: str, lowest: float = 0.0) -> None:
    low = np.maximum(series["mean"] - series["deviation"], lowest) / divisor
    axes.fill_between(
        series["round"], low, (series["mean"] + series["deviation"]) / divisor, color=colour, alpha=0.15, lw=0
    )


@_styled
def plot_dynamics(games: Games, task: str, model: str) -> Figure:
    """The four panels of the paper's dynamics figure: score, messages, choices, positions.

    Solid is the game with the highest score, dashed the mean over games, the band its deviation; values are divided as
    the legends say.
    """
    table = dynamics(games, task, model)
    figure = _figure(8.4, 6)
    panels = figure.subplots(2, 2).ravel()
    contents = {
        "score": [("score", "Score", 1.0)],
        **{
            panel: [(drawn_metrics(m.name), m.title, m.divisor) for m in METRICS if m.panel == panel]
            for panel in ("messages", "choices", "positions")
        },
    }
    for axes, (panel, letter) in zip(panels, zip(contents, "abcd", strict=True), strict=True):
        for (name, label, divisor), (_, style) in zip(contents[panel], _styles("12345"), strict=False):
            own = table[table["metric"] == name]
            lowest = -np.inf if name == "homogeneity" else 0.0
            _band(axes, own, divisor, style["color"], lowest)
            every = max(1, len(own) // 8)
            shown = label if divisor == 1 else f"{label} / {divisor:g}"
            solid = {**style, "linestyle": "-", "markevery": every, "markersize": 3, "linewidth": 1.2}
            axes.plot(own["round"], own["best"] / divisor, label=shown, **solid)
            axes.plot(own["round"], own["mean"] / divisor, color=style["color"], linestyle="--", linewidth=0.8)
        axes.set(title=f"({letter}) {panel}", xlabel="round")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend(fontsize=6, frameon=False)
    figure.suptitle(f"{task}, {_short(model)} (solid: the best game; dashed: mean ± deviation)")
    return figure


@_styled
def plot_correlation_matrix(
    games: Games, task: str, metrics: Sequence[str] = TWELVE, definition: Definition = "paper"
) -> Figure:
    """Pearson's r of all pairs of metrics and of each with the score (the last row), with the numbers in the cells."""
    matrix = correlation_matrix(games, task, metrics, definition)
    names = [title(name) for name in matrix.columns]
    figure = _figure(6.4, 5.4)
    axes = figure.add_subplot()
    colours = mpl.colormaps[DIVERGING].with_extremes(bad="#DDDDDD")
    image = axes.imshow(matrix.to_numpy(), cmap=colours, vmin=-1, vmax=1)
    axes.set_xticks(range(len(names)), names, rotation=90)
    axes.set_yticks(range(len(names)), names)
    for (row, place), r in np.ndenumerate(matrix.to_numpy()):
        dark = abs(r) > 0.6
        axes.text(
            place,
            row,
            "–" if np.isnan(r) else f"{r:.2f}",
            ha="center",
            va="center",
            fontsize=5,
            color="white" if dark else "black",
        )
    axes.set_title(task)
    figure.colorbar(image, ax=axes, label="Pearson's r")
    return figure


@_styled
def plot_correlations(table: pd.DataFrame, task: str) -> Figure:
    """Bars of r with stars and 95 % intervals, from a table of `correlations`; hatched bars are negative."""
    own = table[(table["task"] == task) & table["r"].notna()].iloc[::-1]
    if own.empty:
        raise TooLittleDataError(f"{task}: there is no correlation to draw")
    figure = _figure(5.2, 0.8 + 0.25 * len(own))
    axes = figure.add_subplot()
    bars = axes.barh([title(name) for name in own["metric"]], own["r"], edgecolor="black", linewidth=0.4)
    for bar, r in zip(bars, own["r"], strict=True):
        bar.set(facecolor=COLOURS[0] if r >= 0 else COLOURS[1], hatch="" if r >= 0 else "//")
    low, high = own["low"].fillna(own["r"]), own["high"].fillna(own["r"])
    places = np.arange(len(own))
    axes.errorbar(own["r"], places, xerr=[own["r"] - low, high - own["r"]], fmt="none", ecolor="black", linewidth=0.6)
    for place, r, marks in zip(places.tolist(), own["r"], own["stars"], strict=True):
        axes.annotate(
            marks, (r, place), (3 if r >= 0 else -3, 2), textcoords="offset points", ha="left" if r >= 0 else "right"
        )
    axes.axvline(0, color="black", linewidth=0.6)
    n = own["n"]
    axes.set(xlim=(-1.05, 1.05), xlabel=f"Pearson's r with the score (n = {_range(n.min(), n.max())})", title=task)
    return figure


def _range(least: int, most: int) -> str:
    return str(least) if least == most else f"{least} to {most}"


@_styled
def plot_scatter(games: Games, task: str, metric: str | None = None, definition: Definition = "paper") -> Figure:
    """The score against a metric with the least-squares line; where none is named, the one with the largest |r|."""
    table = correlations(games.where(task=task), TWELVE if metric is None else [metric], definition)
    name = top_metric(table, task)
    found = table[table["metric"] == name].iloc[0]
    episodes = games.where(task=task).episodes
    x, y = episodes[column(name, definition)], episodes["score"]
    figure = _figure(4.8, 3.8)
    axes = figure.add_subplot()
    for model, style in _styles(games.models):
        own = episodes["model"] == model
        look = {"color": style["color"], "marker": style["marker"], "edgecolors": "black", "linewidths": 0.3, "s": 18}
        axes.scatter(x[own], y[own], label=_short(model), **look)
    known = x.notna()
    slope, intercept = np.polyfit(x[known], y[known], 1)
    ends = np.array([x.min(), x.max()])
    axes.plot(ends, intercept + slope * ends, color="black", linewidth=1)
    axes.set(
        xlabel=title(name),
        ylabel="score",
        title=f"{task}: r = {found['r']:.3f}, p = {found['p']:.3g}, n = {found['n']}",
    )
    _legend(figure, axes)
    return figure


@_styled
def plot_shap(found: Regression) -> Figure:
    """SHAP values: a row for each metric by importance, a dot for each game, coloured by the value of the metric."""
    names = found.coefficients["metric"].tolist()[::-1]
    figure = _figure(5.6, 1 + 0.3 * len(names))
    axes = figure.add_subplot()
    for row, name in enumerate(names):
        own = found.shap[found.shap["metric"] == name]
        shown = axes.scatter(
            own["shap"], row + _spread(own["shap"].to_numpy()), c=own["z"], cmap="cividis", vmin=-2, vmax=2, s=9
        )
    axes.axvline(0, color="black", linewidth=0.6)
    axes.set_yticks(range(len(names)), [title(name) for name in names])
    r2, n = found.quality["r2"], found.quality["n"]
    axes.set(xlabel="SHAP value: change of the predicted score", title=f"{found.task}: R² = {r2:.2f}, n = {n}")
    figure.colorbar(shown, ax=axes, label="metric, in deviations from its mean")
    return figure


def _spread(values: "np.ndarray[Any, np.dtype[np.float64]]") -> "np.ndarray[Any, np.dtype[np.float64]]":
    """Moves dots that would lie on each other up and down."""
    bins = np.digitize(values, np.linspace(values.min(), values.max() + 1e-12, 40))
    offsets = np.zeros(len(values))
    for place in np.unique(bins):
        same = np.flatnonzero(bins == place)
        offsets[same] = (np.arange(len(same)) - (len(same) - 1) / 2) * min(0.08, 0.7 / len(same))
    return offsets


@_styled
def plot_blocks(table: pd.DataFrame) -> Figure:
    """How the explained variance is shared by physical metrics and communication, from a table of `blocks`."""
    known = table.dropna(subset=["block"])
    if known.empty:
        raise TooLittleDataError("no task allows the comparison: the table says why, task by task")
    tasks = list(dict.fromkeys(known["task"]))
    figure = _figure(1.6 + 1.1 * len(tasks), 3.2)
    axes = figure.add_subplot()
    below = np.zeros(len(tasks))
    for block, colour, hatch in (("physical", COLOURS[0], ""), ("communication", COLOURS[1], "//")):
        shares = known[known["block"] == block].set_index("task")["share"].reindex(tasks).to_numpy(float)
        # A share is negative where a block only stands in the way; then bars overlap rather than stack.
        axes.bar(
            tasks,
            shares,
            0.6,
            np.where(shares < 0, 0, below),
            color=colour,
            hatch=hatch,
            edgecolor="black",
            label=block,
        )
        below += np.maximum(shares, 0)
    axes.set_ylabel("share of R²")
    axes.axhline(0, color="black", linewidth=0.6)
    _legend(figure, axes)
    return figure


@_styled
def plot_attribution(table: pd.DataFrame) -> Figure:
    """Importance of each block for the next action, from a table of `action_attribution`: a panel for each task."""
    known = table[table["importance"].notna()] if "importance" in table else table.iloc[:0]
    if known.empty:
        raise TooLittleDataError("no forest predicts actions better than guessing, so there is no importance to draw")
    tasks = sorted(known["task"].unique())
    figure = _figure(2.8 * len(tasks) + 1, 3.6)
    panels = figure.subplots(1, len(tasks), squeeze=False, sharey=True)[0]
    names = ("others", "own", "observation")
    for task, axes in zip(tasks, panels, strict=True):
        own = known[known["task"] == task]
        models = sorted(own["model"].unique())
        for at, (block, colour, hatch) in enumerate(zip(names, COLOURS, HATCHES, strict=False)):
            rows = own[own["block"] == block].set_index("model").reindex(models)
            axes.bar(
                np.arange(len(models)) + (at - 1) * 0.27,
                rows["importance"],
                0.27,
                yerr=rows["deviation"],
                color=colour,
                hatch=hatch,
                edgecolor="black",
                linewidth=0.4,
                label=block,
            )
        axes.set_xticks(range(len(models)), [_short(model) for model in models], rotation=90)
        axes.set_title(task)
    panels[0].set_ylabel("importance: drop of macro F1")
    _legend(figure, panels[0])
    return figure


@_styled
def plot_keywords(table: pd.DataFrame) -> Figure:
    """Keywords by count, from a table of `keywords`: a column for each task, a row for each model."""
    tasks, models = sorted(table["task"].unique()), sorted(table["model"].unique())
    figure = _figure(2.4 * len(tasks), 0.4 + 1.7 * len(models))
    panels = figure.subplots(len(models), len(tasks), squeeze=False)
    for (row, place), axes in np.ndenumerate(panels):
        own = table[(table["task"] == tasks[place]) & (table["model"] == models[row])].iloc[::-1]
        axes.barh(own["word"].str.slice(0, NAME_CHARS_MAX), own["count"], color=COLOURS[place % len(COLOURS)])
        axes.tick_params(labelsize=6)
        if own.empty:
            axes.set_axis_off()
        if row == 0 or own.empty:
            axes.set_title(tasks[place] if row == 0 else "")
        if place == 0:
            axes.set_ylabel(_short(models[row]), fontsize=6)
    return figure


@_styled
def plot_sensitivity(games: Games) -> Figure:
    """Mean scores over the number of agents, a line for each view size and a panel for each task."""
    if games.episodes["model"].nunique() > 1:
        raise TooLittleDataError("the sensitivity is that of one model: choose it, as in load(…, model='my-model')")
    table = scores(games, ["task", "num_agents", "view_size"])
    figure = _figure(2.6 * len(games.tasks) + 0.6, 3.2)
    panels = figure.subplots(1, len(games.tasks), squeeze=False)[0]
    sizes = sorted(table["view_size"].unique())
    for task, axes in zip(games.tasks, panels, strict=True):
        for size, style in _styles([f"{size}" for size in sizes]):
            own = table[(table["task"] == task) & (table["view_size"] == int(size))]
            axes.errorbar(
                own["num_agents"],
                own["mean"],
                yerr=own["deviation"],
                capsize=2,
                markersize=4,
                label=f"view size {size}",
                **style,
            )
        axes.set(title=task, xlabel="agents")
    panels[0].set_ylabel("score (mean ± deviation)")
    _legend(figure, panels[0])
    return figure
