"""Scores and metrics round by round, over several games: the numbers behind charts."""

import pandas as pd

from .metrics import METRICS
from .problems import FilesError
from .tables import Games


def score_trends(games: Games) -> pd.DataFrame:
    """Mean and population deviation of the score after each round, for each task and model.

    A game that ended early keeps its last score.

    Returns:
        `task`, `model`, `round`, `mean`, `deviation`, `n`.

    Raises:
        FilesError: Rounds are missing, or a score falls, which happens in no game.
    """
    games.one_setting()
    rounds = _rounds(games, [])
    series = []
    for (task, model), own in games.episodes.groupby(["task", "model"]):
        series.append(_spread(_whole_scores(rounds, own), task=str(task), model=str(model)))
    return pd.concat(series, ignore_index=True)


def dynamics(games: Games, task: str, model: str) -> pd.DataFrame:
    """The score and the twelve metrics round by round, over the games of a model in a task.

    A game that ended early keeps its last score, and has no metrics of later rounds.

    Returns:
        `metric`, `round`, `best` (the game with the highest final score), `mean` and `deviation` over the games in
        which the value is defined, `n`; not divided.

    Raises:
        MissingColumnsError: The table `rounds` has no metrics.
        FilesError: Rounds are missing, or a score falls, which happens in no game.
    """
    chosen = games.where(task=task, model=model)
    chosen.one_setting()
    names = [drawn_metric(metric.name) for metric in METRICS if metric.panel]
    rounds = _rounds(chosen, names)
    best = chosen.episodes.sort_values("score", kind="stable", ascending=False)["episode"].iloc[0]
    wide = {name: rounds.pivot(index="round", columns="episode", values=name).astype(float) for name in names}
    series = []
    for name, values in {"score": _whole_scores(rounds, chosen.episodes), **wide}.items():
        spread = _spread(values, metric=name)
        spread.insert(2, "best", values[best].to_numpy())
        series.append(spread)
    return pd.concat(series, ignore_index=True)


def drawn_metric(name: str) -> str:
    """The column of `rounds` that a dynamics panel draws; the paper draws the cumulated moving distance."""
    return "path_length" if name == "step_length" else name


def _spread(wide: pd.DataFrame, **about: str) -> pd.DataFrame:
    """Columns `about`, then mean, population deviation and count of each round."""
    rounds = {"round": wide.index, "mean": wide.mean(axis=1), "deviation": wide.std(axis=1, ddof=0)}
    return pd.DataFrame({**about, **rounds, "n": wide.notna().sum(axis=1)}).reset_index(drop=True)


def _rounds(games: Games, names: list[str]) -> pd.DataFrame:
    """Columns of all states of the games, whose numbers and scores are checked."""
    rounds = games.table("rounds", ["round", "score", *names]).sort_values(["episode", "round"])
    counted = rounds.groupby("episode")["round"].agg(["size", "max"])
    states = games.episodes[["episode", "rounds", "max_round"]].join(counted, on="episode").fillna(0)
    wrong = states[
        (states["size"] != states["rounds"] + 1)
        | (states["max"] != states["rounds"])
        | (states["rounds"] > states["max_round"])
    ]
    if not wrong.empty:
        first = wrong.iloc[0]
        raise FilesError(
            f"{first['episode']} has {first['size']:.0f} states in the table rounds, and played {first['rounds']} of "
            f"{first['max_round']} rounds: export the games again"
        )
    falls = rounds.groupby("episode")["score"].diff() < 0
    if falls.any():
        first = rounds[falls].iloc[0]
        raise FilesError(
            f"the score of {first['episode']} falls in round {first['round']}: the table rounds is damaged"
        )
    return rounds


def _whole_scores(rounds: pd.DataFrame, episodes: pd.DataFrame) -> pd.DataFrame:
    """The score of each game (a column) in each state (a row): a game that ended early keeps its last score."""
    own = rounds[rounds["episode"].isin(episodes["episode"])]
    wide = own.pivot(index="round", columns="episode", values="score").astype(float)
    return wide.reindex(range(int(episodes["max_round"].max()) + 1)).ffill()
