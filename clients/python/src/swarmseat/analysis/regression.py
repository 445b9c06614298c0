"""Least squares of the score on metrics, with SHAP values, and the comparison of two blocks of metrics."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from .metrics import COMMUNICATION, PHYSICAL, TWELVE, Definition, column
from .problems import ConstantError, TooLittleDataError
from .statistics import VIF_MAX, Fit, Floats, Names, is_constant, least_squares
from .tables import Games

SHARE_DEFINED_MIN = 0.9
"""The minimum share of games that define a metric. Otherwise the metric is left out, not the games: a silent model is a
model, too.
"""


@dataclass(frozen=True)
class Regression:
    """The score of a task as a linear function of metrics.

    Attributes:
        task: The task.
        coefficients: A row for each metric, the most important first: `beta` (change of the score for one population
            deviation of the metric), `error`, `p`, `vif`, `importance` (mean |SHAP value|), and `ridge` where a `vif`
            exceeds 10.
        shap: A row for each game and metric: `episode`, `model`, `metric`, `z` and `shap`. The SHAP values of a game
            add up to its prediction less `mean`.
        quality: `n`, `metrics`, `r2`, `adjusted`, `left_out` (R² for models that were left out of the fit), `penalty`
            of the ridge regression.
        mean: The mean score.
        predicted: The predicted score of each game.
        notes: Sentences about what was left out, and about caveats.
    """

    task: str
    coefficients: pd.DataFrame
    shap: pd.DataFrame
    quality: dict[str, float | None]
    mean: float
    predicted: "pd.Series[float]"
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Sample:
    """The games in which all metrics are defined."""

    episodes: pd.DataFrame
    metrics: list[str]
    x: Floats
    y: Floats
    models: Names
    notes: list[str]


def regression(
    games: Games, task: str, metrics: Sequence[str] = TWELVE, definition: Definition = "paper"
) -> Regression:
    """Ordinary least squares of the score on standardised metrics. SHAP values take the metrics as independent.

    Raises:
        MixedSettingsError: The games have different settings.
        ConstantError: The score or every metric is the same in all games.
        TooLittleDataError: There are fewer games than metrics + 2.
    """
    sample = _sample(games, task, metrics, definition)
    fit = least_squares(sample.x, sample.y, sample.models)
    contributions = fit.beta * fit.z
    importance = np.abs(contributions).mean(axis=0)
    table = pd.DataFrame(
        {"metric": sample.metrics, "beta": fit.beta, "error": fit.error, "p": fit.p, "vif": fit.vif}
    ).assign(importance=importance, **({} if fit.ridge is None else {"ridge": fit.ridge}))
    return Regression(
        task=task,
        coefficients=table.sort_values("importance", ascending=False, kind="stable", ignore_index=True),
        shap=_long(sample, fit, contributions),
        quality={
            "n": len(sample.y),
            "metrics": len(sample.metrics),
            "r2": fit.r2,
            "adjusted": fit.adjusted,
            "left_out": fit.left_out,
            "penalty": fit.penalty,
        },
        mean=fit.intercept,
        predicted=pd.Series(fit.intercept + contributions.sum(axis=1), sample.episodes["episode"], name="predicted"),
        notes=(*sample.notes, *_cautions(sample, fit)),
    )


def _long(sample: _Sample, fit: Fit, contributions: Floats) -> pd.DataFrame:
    n, columns = contributions.shape
    return pd.DataFrame(
        {
            "episode": np.repeat(sample.episodes["episode"].to_numpy(), columns),
            "model": np.repeat(sample.models, columns),
            "metric": np.tile(np.array(sample.metrics, object), n),
            "z": fit.z.ravel(),
            "shap": contributions.ravel(),
        }
    )


def _cautions(sample: _Sample, fit: Fit) -> list[str]:
    notes = []
    entangled = [name for name, vif in zip(sample.metrics, fit.vif, strict=True) if vif > VIF_MAX]
    if entangled:
        beside = "ridge coefficients stand beside them" if fit.ridge is not None else "and one model allows no ridge"
        notes.append(
            f"The variance inflation of {', '.join(entangled)} exceeds {VIF_MAX:.0f}: single coefficients are "
            f"uncertain, {beside}."
        )
    if np.isnan(fit.left_out):
        notes.append("There is one model only, so no model can be left out.")
    return notes


def _sample(games: Games, task: str, metrics: Sequence[str], definition: Definition) -> _Sample:
    chosen = games.where(task=task)
    chosen.one_setting()
    chosen.require(metrics, definition)
    columns = {metric: chosen.episodes[column(metric, definition)].astype(float) for metric in metrics}
    values, notes = pd.DataFrame(columns), list[str]()
    rare = [name for name in metrics if values[name].notna().mean() < SHARE_DEFINED_MIN]
    complete = values.drop(columns=rare).notna().all(axis=1)
    if not complete.all():
        notes.append(f"{int((~complete).sum())} of {len(values)} games lack a metric and are left out.")
    values, episodes = values.loc[complete], chosen.episodes.loc[complete]
    constant = [name for name in metrics if name not in rare and is_constant(values[name].to_numpy())]
    for names, why in (
        (rare, f"undefined in more than {1 - SHARE_DEFINED_MIN:.0%} of the games"),
        (constant, "the same in all games"),
    ):
        if names:
            notes.append(f"Left out, as {why}: {', '.join(names)}.")
    kept = [name for name in metrics if name not in {*rare, *constant}]
    y = episodes["score"].to_numpy(float)
    if is_constant(y):
        raise ConstantError(
            f"{task}: the score is the same in all games, so nothing explains it: add games of other models"
        )
    if not kept:
        raise ConstantError(f"{task}: no metric differs between the games: add games of other models")
    return _Sample(episodes, kept, values[kept].to_numpy(), y, episodes["model"].to_numpy(object), notes)


def blocks(games: Games, definition: Definition = "paper") -> pd.DataFrame:
    """The variance of the score that physical metrics explain, and metrics of communication, for each task.

    Returns:
        A row for each task and block: `r2`, `adjusted` and `left_out` of the block alone, `share` (its Shapley share of
        the `r2_both` of both together), `f`, `f_p` (the F test of the block given the other), `adjusted_both`,
        `left_out_both`, `n`, and `note`. For a task without values `note` has the reason.
    """
    rows = []
    for task in games.tasks:
        try:
            rows += _blocks_of_task(games, task, definition)
        except (ConstantError, TooLittleDataError) as error:
            rows.append({"task": task, "block": None, "note": str(error)})
    return pd.DataFrame(rows)


def _blocks_of_task(games: Games, task: str, definition: Definition) -> list[dict[str, object]]:
    sample = _sample(games, task, (*PHYSICAL, *COMMUNICATION), definition)
    both = least_squares(sample.x, sample.y, sample.models)
    parts = {
        name: [sample.metrics.index(metric) for metric in names if metric in sample.metrics]
        for name, names in (("physical", PHYSICAL), ("communication", COMMUNICATION))
    }
    if not all(parts.values()):
        absent = " and ".join(name for name, columns in parts.items() if not columns)
        raise ConstantError(
            f"{task}: no metric of the block {absent} is defined in most games and differs between them"
        )
    fits = {name: least_squares(sample.x[:, columns], sample.y, sample.models) for name, columns in parts.items()}
    rows: list[dict[str, object]] = []
    for name, other in (("physical", "communication"), ("communication", "physical")):
        fit = fits[name]
        f, p, _ = both.result.compare_f_test(fits[other].result)
        rows.append(
            {
                "task": task,
                "block": name,
                "n": len(sample.y),
                "metrics": len(parts[name]),
                "r2": fit.r2,
                "adjusted": fit.adjusted,
                "left_out": fit.left_out,
                "share": (fit.r2 + both.r2 - fits[other].r2) / 2,
                "f": float(f),
                "f_p": float(p),
                "r2_both": both.r2,
                "adjusted_both": both.adjusted,
                "left_out_both": both.left_out,
                "note": " ".join(sample.notes),
            }
        )
    return rows
