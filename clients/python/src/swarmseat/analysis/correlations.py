"""Correlations of metrics with the score over games: all metrics, failure modes, convergence."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from .metrics import TWELVE, Definition, column
from .problems import ConstantError, TooLittleDataError
from .statistics import Correlation, Floats, Names, benjamini_hochberg, correlate, is_constant, stars
from .tables import Games

GAMES_MIN = 3

FAILURES = {"Pursuit": "direction_imbalance", "Synchronization": "components", "Foraging": "separation"}
"""The tasks whose failures the paper explains, and the metric of each explanation."""

INCREASES = ("homogeneity_increase", "edit_consistency_increase")
"""The metrics of how much more alike messages are at the end of a game than at its beginning."""


def correlations(games: Games, metrics: Sequence[str] = TWELVE, definition: Definition = "paper") -> pd.DataFrame:
    """Correlates each metric with the final score, for each task over its games.

    Returns:
        A row for each task and metric, the largest |r| of a task first: `task`, `metric`, the fields of `Correlation`,
        `q` (Benjamini–Hochberg over the metrics of the task), `stars` (of p) and `note` (why r is missing).

    Raises:
        MixedSettingsError: Games of a task have different settings.
        MissingColumnsError: The export has no such metric.
        ConstantError: In every task the score or each metric is constant.
        TooLittleDataError: Each task has fewer than three games.
    """
    games.one_setting()
    games.require(metrics, definition)
    found = [_of_task(games.where(task=task), task, metrics, definition) for task in games.tasks]
    table = pd.concat(found, ignore_index=True)
    if table["r"].isna().all():
        if games.episodes.groupby("task").size().max() < GAMES_MIN:
            raise TooLittleDataError(
                f"a correlation needs {GAMES_MIN} games of a task, and there are at most "
                f"{games.episodes.groupby('task').size().max()}: play more seeds or models"
            )
        raise ConstantError(
            "the score or every metric is the same in all games of a task, so nothing can be correlated: add games of "
            "other models"
        )
    return table


def _of_task(games: Games, task: str, metrics: Sequence[str], definition: Definition) -> pd.DataFrame:
    rows = []
    for metric in metrics:
        x, y, models = _pairs(games.episodes, column(metric, definition))
        rows.append({"task": task, "metric": metric, **correlate(x, y, models)._asdict(), "note": _note(x, y)})
    table = pd.DataFrame(rows)
    table.insert(5, "q", pd.Series(benjamini_hochberg(table["p"].to_numpy(float))))
    table["stars"] = [stars(p) for p in table["p"]]
    return table.sort_values("r", key=lambda r: -r.abs(), kind="stable", na_position="last", ignore_index=True)


def _pairs(episodes: pd.DataFrame, name: str) -> tuple[Floats, Floats, Names]:
    """Values, scores and models of the games in which the metric is defined."""
    known = episodes[episodes[name].notna()]
    return known[name].to_numpy(float), known["score"].to_numpy(float), known["model"].to_numpy(object)


def _note(x: Floats, y: Floats) -> str:
    if len(x) < GAMES_MIN:
        return "defined in fewer than 3 games"
    if is_constant(x):
        return "the metric is the same in all games"
    return "the score is the same in all games" if is_constant(y) else ""


def correlation_matrix(
    games: Games, task: str, metrics: Sequence[str] = TWELVE, definition: Definition = "paper"
) -> pd.DataFrame:
    """Pearson's r of all pairs of metrics, with the score as the last row and column.

    r is NaN if a metric is constant, or two metrics have fewer than three games in common.
    """
    chosen = games.where(task=task)
    chosen.one_setting()
    chosen.require(metrics, definition)
    columns = {metric: chosen.episodes[column(metric, definition)] for metric in metrics}
    values = pd.DataFrame({**columns, "score": chosen.episodes["score"]}).astype(float)
    names = list(map(str, values))
    matrix = np.full((len(names),) * 2, np.nan)
    for a, first in enumerate(names):
        for b, second in enumerate(names):
            both = values[[first, second]].dropna().to_numpy()
            if len(both) >= GAMES_MIN and not (is_constant(both[:, 0]) or is_constant(both[:, -1])):
                matrix[a, b] = np.corrcoef(both[:, 0], both[:, -1])[0, 1]
    return pd.DataFrame(matrix, names, names)


def top_metric(table: pd.DataFrame, task: str) -> str:
    """The metric with the largest |r| of a task in a table of `correlations`.

    Raises:
        ConstantError: No metric of the task has an r.
    """
    known = table[(table["task"] == task) & table["r"].notna()]
    if known.empty:
        raise ConstantError(f"{task}: no metric can be correlated with the score: {_reasons(table, task)}")
    return str(known["metric"].iloc[int(known["r"].abs().argmax())])


def _reasons(table: pd.DataFrame, task: str) -> str:
    return "; ".join(sorted(set(table.loc[table["task"] == task, "note"]) - {""})) or "it was not played"


def failure_modes(games: Games) -> pd.DataFrame:
    """Correlates the metric of each of the paper's failure modes with the score of its task; `q` is over all rows."""
    played = {task: metric for task, metric in FAILURES.items() if task in games.tasks}
    if not played:
        raise TooLittleDataError(f"failure modes are those of {', '.join(FAILURES)}, and none of them was played")
    games.one_setting()
    games.require(list(played.values()))
    rows = [_of_task(games.where(task=task), task, [metric], "paper") for task, metric in played.items()]
    table = pd.concat(rows, ignore_index=True)
    table["q"] = benjamini_hochberg(table["p"].to_numpy(float))
    return table


def convergence_by_task(games: Games) -> pd.DataFrame:
    """Correlates the convergence of messages during a game with its score, for each task."""
    return correlations(games, INCREASES)


def convergence_by_model(games: Games) -> pd.DataFrame:
    """Correlates the convergence of messages with the score, for each model over all its games.

    `r`, `p` … pool the raw values of all tasks, as the paper does, though tasks have different scales; `q` is over all
    rows. For `within_r` and `within_p` values are standardised within their task first.
    """
    games.one_setting()
    games.require(INCREASES)
    rows = []
    for metric in INCREASES:
        known = games.episodes[games.episodes[metric].notna()]
        for model, own in known.groupby("model"):
            raw = correlate(*_pairs(own, metric))
            by_task = own.groupby("task")
            within = _correlate(_standardised(by_task[metric]), _standardised(by_task["score"]))
            rows.append(
                {
                    "model": model,
                    "metric": metric,
                    **_without_bootstrap(raw),
                    "within_r": within.r,
                    "within_p": within.p,
                }
            )
    if not rows:
        raise TooLittleDataError(
            "no game has enough rounds with two or more messages to say whether they become alike: play with models "
            "that talk"
        )
    table = pd.DataFrame(rows)
    table["q"] = benjamini_hochberg(table["p"].to_numpy(float))
    return table


def _correlate(x: Floats, y: Floats) -> Correlation:
    both = ~np.isnan(x) & ~np.isnan(y)
    return correlate(x[both], y[both], np.full(int(both.sum()), "", object))


def _standardised(values: "pd.api.typing.SeriesGroupBy[Any, Any]") -> Floats:
    """Values standardised by mean and population deviation of their group; NaN if a group is constant."""
    result: Floats = values.transform(
        lambda group: np.nan if is_constant(group.to_numpy(float)) else (group - group.mean()) / group.std(ddof=0)
    ).to_numpy(float)
    return result


def _without_bootstrap(found: Correlation) -> dict[str, float]:
    return {
        name: value for name, value in found._asdict().items() if name in {"n", "r", "p", "low", "high", "spearman"}
    }
