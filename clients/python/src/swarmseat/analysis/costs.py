"""Costs of games, as acts have them."""

import pandas as pd

from .problems import TooLittleDataError
from .tables import Games

BY = ["task", "model"]
"""The columns in which rows differ."""


def costs(games: Games) -> pd.DataFrame:
    """Mean score and mean cost of a game in US dollars: a row for each task and model.

    Games without a known cost are left out. The cost of a game in which some acts have none is too low, and so is the
    mean: `unpriced` is the share of such acts.

    Raises:
        TooLittleDataError: No game has a known cost.
    """
    games.one_setting(but=BY)
    episodes = games.episodes
    known = episodes[episodes["cost_usd"].notna()] if "cost_usd" in episodes else episodes.iloc[:0]
    if known.empty:
        raise TooLittleDataError(
            "no game has a known cost: endpoints report it, or `swarmbench eval --prices` computes it from tokens"
        )
    groups = known.groupby(BY)
    table = groups.agg(
        score=("score", "mean"),
        deviation=("score", lambda values: values.std(ddof=0)),
        cost_usd=("cost_usd", "mean"),
        games=("score", "size"),
    )
    table["unpriced"] = 1 - groups["priced"].sum() / groups["acts"].sum()
    return table.reset_index()
