"""Scores by model, task and setting, and scores and metrics round by round."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from .metrics import METRICS
from .problems import FilesError, TooLittleDataError
from .statistics import Floats
from .tables import Games


def scores(games: Games, by: Sequence[str] = ("model", "task")) -> pd.DataFrame:
    """Mean and population deviation of the score for each group of games.

    Args:
        games: The games.
        by: Columns of `episodes`; games of a group must agree in all other settings.

    Returns:
        A row for each group: the columns of `by`, `mean`, `deviation`, `n`.

    Raises:
        MixedSettingsError: Games differ in a setting that is not in `by`.
    """
    games.one_setting(but=by)
    grouped = games.episodes.groupby(list(by), dropna=False)["score"]
    return grouped.agg(mean="mean", deviation=lambda values: values.std(ddof=0), n="size").reset_index()


def score_table(games: Games) -> pd.DataFrame:
    """A row for each model, a column `mean ± deviation (n)` for each task, and the sum of the means.

    The best total is first. A model that did not play all tasks has no total.
    """
    table = scores(games)
    columns = (table[name] for name in ("mean", "deviation", "n"))
    table["cell"] = [f"{mean:.2f} ± {deviation:.2f} ({n})" for mean, deviation, n in zip(*columns, strict=True)]
    cells = table.pivot_table(index="model", columns="task", values="cell", aggfunc="first")
    total = table.groupby("model")["mean"].sum()
    cells = cells.assign(total=total).sort_values(["total"], ascending=False, kind="stable")
    # Totals over different numbers of tasks cannot be ranked.
    cells["total"] = cells["total"].where(cells.notna().all(axis=1))
    cells.columns.name = None
    return cells.reset_index()


def score_trends(games: Games) -> pd.DataFrame:
    """Mean and population deviation of the score after each round, for each task and model.

    A game that ended early keeps its last score.

    Returns:
        `task`, `model`, `round`, `mean`, `deviation`, `n`.

    Raises:
        FilesError: A score falls, which happens in no game.
    """
    games.one_setting()
    series = []
    for (task, model), by_game in _series(games, "score"):
        if (np.diff(by_game, axis=1) < 0).any():
            raise FilesError(
                f"{task}, {model}: a score falls during a game, so the table rounds is damaged: export it again"
            )
        rounds = np.arange(by_game.shape[1])
        spread = {"mean": by_game.mean(axis=0), "deviation": by_game.std(axis=0), "n": len(by_game)}
        series.append(pd.DataFrame({"task": task, "model": model, "round": rounds, **spread}))
    return pd.concat(series, ignore_index=True)


def _series(games: Games, name: str) -> list[tuple[tuple[str, str], Floats]]:
    """An array for each task and model, with a row per game and a column per round, filled to `max_round`."""
    rounds = games.table("rounds", ["round", name])
    found: list[tuple[tuple[str, str], Floats]] = []
    for (task, model), own in games.episodes.groupby(["task", "model"]):
        length = int(own["max_round"].max()) + 1
        wide = rounds[rounds["episode"].isin(own["episode"])].pivot_table(index="episode", columns="round", values=name)
        if wide.empty:
            raise FilesError(f"{task}, {model}: the table rounds has no rows of these games: export it again")
        found.append(((str(task), str(model)), wide.reindex(columns=range(length)).ffill(axis=1).to_numpy(float)))
    return found


def drawn_metrics(name: str) -> str:
    """The column of `rounds` that a dynamics panel draws; the paper draws the cumulated moving distance."""
    return "path_length" if name == "step_length" else name


def dynamics(games: Games, task: str, model: str) -> pd.DataFrame:
    """The score and the twelve metrics round by round, over the games of a model in a task.

    Returns:
        `metric`, `round`, `best` (the game with the highest final score), `mean` and `deviation` over the games in
        which the value is defined, `n`; not divided.

    Raises:
        MissingColumnsError: The table `rounds` has no metrics.
    """
    chosen = games.where(task=task, model=model)
    chosen.one_setting()
    names = ["score", *(drawn_metrics(metric.name) for metric in METRICS if metric.panel)]
    rounds = chosen.table("rounds", ["round", *names])
    if rounds.empty:
        raise TooLittleDataError(f"{task}, {model}: the table rounds has no rows of these games: export it again")
    best = chosen.episodes.sort_values("score", kind="stable", ascending=False)["episode"].iloc[0]
    series = []
    for name in names:
        wide = rounds.pivot(index="round", columns="episode", values=name).astype(float)
        spread = {"mean": wide.mean(axis=1), "deviation": wide.std(axis=1, ddof=0), "n": wide.notna().sum(axis=1)}
        series.append(pd.DataFrame({"metric": name, "best": wide[best], **spread}).rename_axis("round").reset_index())
    return pd.concat(series, ignore_index=True)
