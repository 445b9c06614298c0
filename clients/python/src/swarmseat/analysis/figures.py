"""Figures of matplotlib, without its global state.

Colour is never the only cue: markers, hatches and numbers say the same. The same games give the same bytes.
"""

import functools
import textwrap
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from .correlations import correlation_matrix, correlations, top_metric
from .metrics import METRICS, TWELVE, Definition, column, title
from .problems import TooLittleDataError
from .regression import Regression
from .series import drawn_metric, dynamics, score_trends
from .tables import Games

P = ParamSpec("P")

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#F0E442", "#000000")
"""The palette of Okabe and Ito, which colour-blind readers can tell apart."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">")
HATCHES = ("", "//", "..", "xx", "\\\\", "++", "oo", "--")
DASHES = ("-", "--", "-.", ":")
DIVERGING = "PuOr"
BLOCKS = ("others", "own", "observation")

NAME_CHARS_MAX = 32
"""The maximum length of a model's name in a figure."""

LABEL_CHARS_MAX = 48
"""The maximum length of a line of a label of teams."""

DOTS_PER_INCH = 150

CHAR_WIDTH = 0.065
"""The approximate width of a character of a legend, in inches."""
LINE_HEIGHT = 0.15
"""The approximate height of a line of text, in inches."""

_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "hatch.linewidth": 0.5,
    # Names of models are shown as they are: dollar signs begin no formula.
    "text.parse_math": False,
    "text.usetex": False,
    # Ids in an SVG would be random otherwise.
    "svg.hashsalt": "swarmbench",
}


def _styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Draws in the style of this module, regardless of the user's settings."""

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
        # Characters that the font lacks are shown as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(path, dpi=DOTS_PER_INCH, metadata=metadata)


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")


def _short(name: str) -> str:
    # Names of one provider often differ at their ends only.
    half = NAME_CHARS_MAX // 2
    short = name if len(name) <= NAME_CHARS_MAX else f"{name[: half - 1]}…{name[-half:]}"
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


def _legend(figure: Figure, *panels: Axes) -> None:
    """A legend below all panels, with as many columns as fit."""
    entries = {
        label: handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    widest = 0.6 + CHAR_WIDTH * max(map(len, entries), default=0)
    columns = max(1, min(len(entries), int(figure.get_figwidth() / widest)))
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=columns, frameon=False)


def _rounds(axes: Axes, last: int) -> None:
    """The axis of rounds: whole numbers from 0 to the last."""
    axes.set(xlabel="round", xlim=(0, max(last, 1)))
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True, steps=[1, 2, 5, 10]))


def _grid(figure: Figure, panels: int, columns: int) -> list[Axes]:
    """A grid of `panels` axes, `columns` in each row."""
    axes = figure.subplots(-(-panels // columns), columns, squeeze=False).ravel()
    for unused in axes[panels:]:
        unused.set_axis_off()
    return list(axes[:panels])


def _means(games: Games, by: list[str]) -> pd.DataFrame:
    """Mean and population deviation of the final score, and the number of games, for each group."""
    games.one_setting(but=by)
    groups = games.episodes.groupby(by)["score"]
    return groups.agg(mean="mean", deviation=lambda values: values.std(ddof=0), n="size").reset_index()


def _counted(label: str, n: "pd.Series[int]") -> str:
    return f"{label} (n = {_range(n.min(), n.max())})"


@_styled
def plot_scores(games: Games) -> Figure:
    """Mean scores as bars with population deviations: a panel for each task, a bar for each of its models."""
    table = _means(games, ["model", "task"])
    most = int(table.groupby("task").size().max())
    columns = min(3, len(games.tasks))
    figure = _figure(3.6 * columns, (0.8 + 0.2 * most) * -(-len(games.tasks) // columns))
    for task, axes in zip(games.tasks, _grid(figure, len(games.tasks), columns), strict=True):
        own = table[table["task"] == task].sort_values("mean", kind="stable")
        style: dict[str, Any] = {
            "color": COLOURS[0],
            "edgecolor": "black",
            "linewidth": 0.4,
            "error_kw": {"linewidth": 0.6},
        }
        axes.barh(range(len(own)), own["mean"], 0.7, xerr=own["deviation"], **style)
        axes.set_yticks(range(len(own)), [_short(model) for model in own["model"]])
        # Bars are as thick in a task with fewer models.
        label = _counted("score, mean ± deviation", own["n"])
        axes.set(title=task, xlabel=label, ylim=(len(own) - 0.5 - most, len(own) - 0.5))
        axes.axvline(0, color="black", linewidth=0.6)
    return figure


@_styled
def plot_score_trends(games: Games) -> Figure:
    """The score after each round: a panel for each task, a line for each model, and its deviation as a band."""
    table = score_trends(games)
    figure = _figure(2.6 * len(games.tasks) + 0.6, 3.2)
    panels = figure.subplots(1, len(games.tasks), squeeze=False)[0]
    for task, axes in zip(games.tasks, panels, strict=True):
        for model, style in _styles(games.models):
            own = table[(table["task"] == task) & (table["model"] == model)]
            if own.empty:
                continue
            _band(axes, own, 1.0, style["color"])
            every = max(1, len(own) // 8)
            look = {**style, "markevery": every, "markersize": 3, "linewidth": 1, "label": _short(model)}
            axes.plot(own["round"], own["mean"], **look)
        axes.set_title(task)
        _rounds(axes, int(table.loc[table["task"] == task, "round"].max()))
    panels[0].set_ylabel(_counted("score", table["n"]))
    _legend(figure, *panels)
    return figure


def _band(axes: Axes, series: pd.DataFrame, divisor: float, colour: str, lowest: float = 0.0) -> None:
    low = np.maximum(series["mean"] - series["deviation"], lowest) / divisor
    axes.fill_between(
        series["round"], low, (series["mean"] + series["deviation"]) / divisor, color=colour, alpha=0.15, lw=0
    )


@_styled
def plot_dynamics(games: Games, task: str, model: str) -> Figure:
    """The four panels of the paper's dynamics figure: score, messages, choices, positions.

    The solid line is the game with the highest score, the dashed line the mean over the games, the band its deviation;
    values are divided as the legends say. A game that ended early keeps its score, and has no metrics of later rounds.
    """
    table = dynamics(games, task, model)
    figure = _figure(8.4, 6)
    panels = figure.subplots(2, 2).ravel()
    contents = {
        "score": [("score", "Score", 1.0)],
        **{
            panel: [(drawn_metric(m.name), m.title, m.divisor) for m in METRICS if m.panel == panel]
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
        axes.set_title(f"({letter}) {panel}")
        _rounds(axes, int(table["round"].max()))
        if table.loc[table["metric"].isin([name for name, _, _ in contents[panel]]), "mean"].notna().any():
            axes.legend(loc="upper left", bbox_to_anchor=(0, -0.17), ncols=2, fontsize=6, frameon=False)
        else:
            axes.text(0.5, 0.5, "undefined in all rounds", transform=axes.transAxes, ha="center")
    name = _counted(f"{task}, {_short(model)}", table.loc[table["metric"] == "score", "n"])
    figure.suptitle(f"{name}. Solid: the best game; dashed: mean ± deviation")
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
            "–" if np.isnan(r) else f"{r.round(2) + 0.0:.2f}",
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
    for place, end, marks in zip(places.tolist(), high.where(own["r"] >= 0, low), own["stars"], strict=True):
        right = end >= 0
        look: dict[str, Any] = {"textcoords": "offset points", "ha": "left" if right else "right", "va": "center"}
        axes.annotate(marks, (end, place), (3 if right else -3, -1.5), **look)
    axes.axvline(0, color="black", linewidth=0.6)
    n = own["n"]
    # Stars stand beside the bars.
    axes.set(
        xlim=(-1.2, 1.2),
        xticks=np.linspace(-1, 1, 5),
        xlabel=f"Pearson's r with the score (n = {_range(n.min(), n.max())})",
        title=task,
    )
    return figure


def _range(least: int, most: int) -> str:
    return str(least) if least == most else f"{least} to {most}"


@_styled
def plot_scatter(games: Games, task: str, metric: str | None = None, definition: Definition = "paper") -> Figure:
    """The score against a metric with the least-squares line. Default: the metric with the largest |r|."""
    table = correlations(games.where(task=task), TWELVE if metric is None else [metric], definition)
    name = top_metric(table, task)
    found = table[table["metric"] == name].iloc[0]
    episodes = games.where(task=task).episodes
    x, y = episodes[column(name, definition)], episodes["score"]
    figure = _figure(4.8, 3.8)
    axes = figure.add_subplot()
    known = x.notna()
    for model, style in _styles(sorted(episodes.loc[known, "model"].unique())):
        own = known & (episodes["model"] == model)
        look = {"color": style["color"], "marker": style["marker"], "edgecolors": "black", "linewidths": 0.3, "s": 18}
        axes.scatter(x[own], y[own], label=_short(model), **look)
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
    axes.set(xlabel="SHAP value: change of the predicted score", title=f"{found.task}: R² = {r2:.3f}, n = {n}")
    figure.colorbar(shown, ax=axes, label="metric, in deviations from its mean")
    return figure


def _spread(values: "np.ndarray[Any, np.dtype[np.float64]]") -> "np.ndarray[Any, np.dtype[np.float64]]":
    """Moves overlapping dots up and down."""
    bins = np.digitize(values, np.linspace(values.min(), values.max() + 1e-12, 40))
    offsets = np.zeros(len(values))
    for place in np.unique(bins):
        same = np.flatnonzero(bins == place)
        offsets[same] = (np.arange(len(same)) - (len(same) - 1) / 2) * min(0.08, 0.7 / len(same))
    return offsets


@_styled
def plot_blocks(table: pd.DataFrame) -> Figure:
    """The shares of physical metrics and communication in the explained variance, from a table of `blocks`."""
    known = table.dropna(subset=["block"])
    if known.empty:
        raise TooLittleDataError("no task allows the comparison: the table says why, task by task")
    tasks = list(dict.fromkeys(known["task"]))
    figure = _figure(1.6 + 1.1 * len(tasks), 3.2)
    axes = figure.add_subplot()
    below = np.zeros(len(tasks))
    for block, colour, hatch in (("physical", COLOURS[0], ""), ("communication", COLOURS[1], "//")):
        shares = known[known["block"] == block].set_index("task")["share"].reindex(tasks).to_numpy(float)
        # The share of a block that only harms is negative; then bars overlap rather than stack.
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
    most = int(known.groupby("task")["model"].nunique().max())
    columns = min(3, len(tasks))
    figure = _figure(3.6 * columns, 0.4 + (0.8 + 0.36 * most) * -(-len(tasks) // columns))
    panels = _grid(figure, len(tasks), columns)
    for task, axes in zip(tasks, panels, strict=True):
        own = known[known["task"] == task]
        models = sorted(own["model"].unique())
        for at, (block, colour, hatch) in enumerate(zip(BLOCKS, COLOURS, HATCHES, strict=False)):
            rows = own[own["block"] == block].set_index("model").reindex(models)
            axes.barh(
                np.arange(len(models)) + (at - 1) * 0.27,
                rows["importance"],
                0.27,
                xerr=rows["deviation"],
                color=colour,
                hatch=hatch,
                edgecolor="black",
                linewidth=0.4,
                error_kw={"linewidth": 0.6},
                label=block,
            )
        axes.set_yticks(range(len(models)), [_short(model) for model in models])
        axes.set(title=task, xlabel="importance: drop of macro F1", ylim=(most - 0.5, -0.5))
        axes.axvline(0, color="black", linewidth=0.6)
    _legend(figure, panels[0])
    return figure


@_styled
def plot_keywords(table: pd.DataFrame) -> Figure:
    """Keywords by count, from a table of `keywords`: a panel for each model and task in which it said something.

    If all models spoke in all tasks, rows are models and columns tasks.
    """
    groups = [(str(model), str(task), own) for (model, task), own in table.groupby(["model", "task"])]
    tasks, models = sorted(table["task"].unique()), table["model"].nunique()
    columns = len(tasks) if len(groups) == models * len(tasks) else min(len(groups), 4)
    most = max(len(own) for _, _, own in groups)
    figure = _figure(2.4 * columns, (0.7 + 0.13 * most) * -(-len(groups) // columns))
    for (model, task, own), axes in zip(groups, _grid(figure, len(groups), columns), strict=True):
        colour = COLOURS[tasks.index(task) % len(COLOURS)]
        axes.barh(own["word"].str.slice(0, NAME_CHARS_MAX), own["count"], 0.8, color=colour)
        # Bars are as thick where there are fewer words, and begin at the top.
        axes.set_ylim(most - 0.5, -0.5)
        axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
        axes.tick_params(labelsize=6)
        axes.set_title(f"{_short(model)}\n{task}", fontsize=7)
    return figure


@_styled
def plot_sensitivity(games: Games, across: str = "num_agents", lines: str = "view_size") -> Figure:
    """Mean scores over a setting, a line for each value of another one and a panel for each task."""
    if games.episodes["model"].nunique() > 1:
        raise TooLittleDataError("the sensitivity is that of one model: choose it, as in load(…, model='my-model')")
    for name in (across, lines):
        games.check_column(name)
    table = _means(games, ["task", lines, across])
    figure = _figure(2.6 * len(games.tasks) + 0.6, 3.2)
    panels = figure.subplots(1, len(games.tasks), squeeze=False)[0]
    values = sorted(table[lines].unique())
    for task, axes in zip(games.tasks, panels, strict=True):
        for value, (_, style) in zip(values, _styles(map(str, values)), strict=True):
            own = table[(table["task"] == task) & (table[lines] == value)]
            look = {**style, "capsize": 2, "markersize": 4, "label": f"{lines.replace('_', ' ')} {value}"}
            axes.errorbar(own[across], own["mean"], yerr=own["deviation"], **look)
        axes.set(title=task, xlabel=across.replace("_", " "))
    panels[0].set_ylabel(_counted("score, mean ± deviation", table["n"]))
    _legend(figure, panels[0])
    return figure


@_styled
def plot_costs(table: pd.DataFrame) -> Figure:
    """Mean scores against mean costs of games, from a table of `costs`: a panel for each task, a mark for each model.

    The line joins the models that no other beats at their cost or less.
    """
    tasks = list(dict.fromkeys(table["task"]))
    columns = min(3, len(tasks))
    figure = _figure(3.6 * columns, 3.2 * -(-len(tasks) // columns))
    panels = _grid(figure, len(tasks), columns)
    styles = dict(_styles(dict.fromkeys(table["model"])))
    for task, axes in zip(tasks, panels, strict=True):
        own = table[table["task"] == task].sort_values(["cost_usd", "score"], ascending=[True, False], kind="stable")
        for _, row in own.iterrows():
            look = {**styles[row["model"]], "linestyle": "none", "capsize": 2, "markersize": 5}
            label = _short(str(row["model"]))
            axes.errorbar([row["cost_usd"]], [row["score"]], yerr=[row["deviation"]], label=label, **look)
        best = own[own["score"] > own["score"].cummax().shift(fill_value=-np.inf)]
        axes.plot(best["cost_usd"], best["score"], color="black", linewidth=0.6, zorder=1)
        least, most = own["cost_usd"].min(), own["cost_usd"].max()
        # A logarithmic axis has no place for what costs nothing, and few ticks for costs that are close together.
        if most >= 10 * least > 0:
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if most < 100 * least else (1,)))
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_formatter(NullFormatter())
        else:
            axes.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
        axes.set(title=task, xlabel="US dollars a game")
    panels[0].set_ylabel(_counted("score, mean ± deviation", table["games"]))
    _legend(figure, *panels)
    return figure


@_styled
def plot_substitution(table: pd.DataFrame) -> Figure:
    """What replacing seats changed, from a table of `substitution`: a panel for each task, a line for each pair."""
    tasks = list(dict.fromkeys(table["task"]))
    columns = min(3, len(tasks))
    pairs = list(dict.fromkeys(zip(table["of"], table["by"], strict=True)))
    labels = [_wrapped(f"{of} by {by}") for of, by in pairs]
    # Intervals stand side by side, so that none hides another.
    besides = np.linspace(-0.15, 0.15, len(pairs)) * (len(pairs) > 1)
    legend = LINE_HEIGHT * sum(label.count("\n") + 1 for label in labels)
    figure = _figure(max(3.6 * columns, 4.8), 3.6 * -(-len(tasks) // columns) + legend)
    panels = _grid(figure, len(tasks), columns)
    for task, axes in zip(tasks, panels, strict=True):
        for (of, by), label, beside, (_, style) in zip(pairs, labels, besides, _styles(labels), strict=True):
            own = table[(table["task"] == task) & (table["of"] == of) & (table["by"] == by)]
            # Without a replaced seat there is nothing to compare.
            gain, low = own["contribution"].fillna(0), own["low"]
            ends = (gain - low).where(low.notna(), 0)
            look = {**style, "capsize": 2, "markersize": 4, "label": label}
            axes.errorbar(own["replaced"] + beside, gain, yerr=ends, **look)
        axes.axhline(0, color="black", linewidth=0.6)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(title=task, xlabel="seats replaced")
    pairs_of_seeds = table.loc[table["replaced"] > 0, "pairs"]
    panels[0].set_ylabel(_counted("change of the score, 95 % interval", pairs_of_seeds))
    _legend(figure, *panels)
    return figure


@_styled
def plot_focal(table: pd.DataFrame) -> Figure:
    """Contributions among strangers, from a table of `focal`: a panel for each task, a mark for each of them."""
    known = table.dropna(subset=["contribution"])
    if known.empty:
        raise TooLittleDataError("there is nothing to compare with: no backgrounds played all seats on the same seeds")
    tasks = list(dict.fromkeys(known["task"]))
    heads = known["focal"] + ", seats: " + known["seats"].astype(str)
    labels = (heads + ", among " + known["backgrounds"]).map(_wrapped)
    rows = list(dict.fromkeys(labels))
    lines = sum(label.count("\n") + 2 for label in rows)
    figure = _figure(3.4 + LABEL_CHARS_MAX * CHAR_WIDTH, (1 + LINE_HEIGHT * lines) * len(tasks))
    for task, axes in zip(tasks, _grid(figure, len(tasks), 1), strict=True):
        own = known[known["task"] == task]
        places = labels[own.index].map(rows.index)
        ends = (own["contribution"] - own["low"]).fillna(0)
        axes.errorbar(own["contribution"], places, xerr=ends, fmt="o", color=COLOURS[0], capsize=2, markersize=4)
        axes.axvline(0, color="black", linewidth=0.6)
        axes.set_yticks(range(len(rows)), rows)
        label = _counted("change of the score, 95 % interval", own["pairs"])
        axes.set(title=task, xlabel=label, ylim=(len(rows) - 0.5, -0.5))
    return figure


def _wrapped(label: str) -> str:
    """A label in lines: nothing is cut, as names of players may differ at their ends only."""
    # A label that begins with an underscore is left out of legends.
    return textwrap.fill(f" {label}" if label.startswith("_") else label, LABEL_CHARS_MAX, break_on_hyphens=False)
