"""Every table and figure by name, for the command `swarmseat-analysis` and for its report."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from .attribution import ACTS_MAX, action_attribution
from .correlations import convergence_by_model, convergence_by_task, correlation_matrix, correlations, failure_modes
from .costs import costs
from .figures import (
    plot_attribution,
    plot_blocks,
    plot_correlation_matrix,
    plot_correlations,
    plot_costs,
    plot_dynamics,
    plot_focal,
    plot_keywords,
    plot_scatter,
    plot_score_trends,
    plot_scores,
    plot_sensitivity,
    plot_shap,
    plot_substitution,
)
from .metrics import TWELVE, Definition
from .problems import AnalysisError
from .regression import blocks, regression
from .series import dynamics, score_trends
from .tables import Games
from .teams import focal, substitution
from .texts import relate_to_edits
from .words import distinctive_words, keywords

Output = pd.DataFrame | Figure | str
"""A table, a figure, or a sentence about them."""


@dataclass(frozen=True)
class Options:
    """Choices of a piece beside its games.

    Attributes:
        metrics: The metrics to compare with the score.
        definition: The definition of metrics.
        across: The setting on the horizontal axis of the sensitivity.
        lines: The setting that has a line for each value there.
        acts: The maximum number of acts of a model in a task that the attribution uses.
        progress: A function that gets a line before each part of a long computation.
    """

    metrics: Sequence[str] = TWELVE
    definition: Definition = "paper"
    across: str = "num_agents"
    lines: str = "view_size"
    acts: int = ACTS_MAX
    progress: Callable[[str], None] = lambda _: None


class Piece(NamedTuple):
    """A table, a figure, or both.

    Attributes:
        title: The title in a report.
        of: What one table or figure is about: all games, those of a task, or those of a model in a task.
        paper: The number of the figure or table in the paper, if it is there.
        make: A function that yields what there is: the table first, as it may exist where the figure does not.
        options: The fields of `Options` that it takes.
    """

    title: str
    of: Literal["all", "task", "model"]
    paper: str
    make: Callable[[Games, Options], Iterator[Output]]
    options: tuple[str, ...] = ()


_COMPARED = ("metrics", "definition")


def _only(games: Games, name: Literal["task", "model"]) -> str:
    values = games.tasks if name == "task" else games.models
    if len(values) > 1:
        raise AnalysisError(f"this is about one {name}: choose it with --where {name}=…, of {', '.join(values)}")
    return values[0]


def _scores(games: Games, _: Options) -> Iterator[Output]:
    yield plot_scores(games)


def _trends(games: Games, _: Options) -> Iterator[Output]:
    yield score_trends(games)
    yield plot_score_trends(games)


def _dynamics(games: Games, _: Options) -> Iterator[Output]:
    task, model = _only(games, "task"), _only(games, "model")
    yield dynamics(games, task, model)
    yield plot_dynamics(games, task, model)


def _sensitivity(games: Games, asked: Options) -> Iterator[Output]:
    yield plot_sensitivity(games, asked.across, asked.lines)


def _costs(games: Games, _: Options) -> Iterator[Output]:
    table = costs(games)
    yield table
    yield plot_costs(table)


def _substitution(games: Games, _: Options) -> Iterator[Output]:
    table = substitution(games)
    yield table
    yield plot_substitution(table)


def _focal(games: Games, _: Options) -> Iterator[Output]:
    table = focal(games)
    yield table
    yield plot_focal(table)


def _correlations(games: Games, asked: Options) -> Iterator[Output]:
    table = correlations(games, asked.metrics, asked.definition)
    yield table
    yield plot_correlations(table, _only(games, "task"))


def _matrix(games: Games, asked: Options) -> Iterator[Output]:
    task = _only(games, "task")
    yield correlation_matrix(games, task, asked.metrics, asked.definition).rename_axis("metric").reset_index()
    yield plot_correlation_matrix(games, task, asked.metrics, asked.definition)


def _scatter(games: Games, asked: Options) -> Iterator[Output]:
    metric = asked.metrics[0] if len(asked.metrics) == 1 else None
    yield plot_scatter(games, _only(games, "task"), metric, asked.definition)


def _regression(games: Games, asked: Options) -> Iterator[Output]:
    found = regression(games, _only(games, "task"), asked.metrics, asked.definition)
    yield found.coefficients
    known = ((name, value) for name, value in found.quality.items() if value is not None)
    yield ", ".join(f"{name} {value:.4g}" for name, value in known) + "."
    yield from found.notes
    yield plot_shap(found)


def _blocks(games: Games, asked: Options) -> Iterator[Output]:
    table = blocks(games, asked.definition)
    yield table
    yield plot_blocks(table)


def _table(make: Callable[[Games], pd.DataFrame]) -> Callable[[Games, Options], Iterator[Output]]:
    def outputs(games: Games, _: Options) -> Iterator[Output]:
        yield make(games)

    return outputs


def _keywords(games: Games, _: Options) -> Iterator[Output]:
    table = keywords(games)
    yield table
    yield plot_keywords(table)


def _attribution(games: Games, asked: Options) -> Iterator[Output]:
    table = action_attribution(games, acts=asked.acts, progress=asked.progress)
    yield table
    yield plot_attribution(table)


OF_TEAMS = frozenset({"substitution", "focal"})
"""The pieces about games of several holders, which all others leave out."""

PIECES = {
    "scores": Piece("Scores by task and model", "all", "figure 4", _scores),
    "trends": Piece("Scores round by round", "all", "figure 5", _trends),
    "sensitivity": Piece(
        "Scores by number of agents and view size", "all", "figure 8", _sensitivity, ("across", "lines")
    ),
    "costs": Piece("Score and cost", "all", "", _costs),
    "substitution": Piece("One player replaced by another, seat by seat", "all", "", _substitution),
    "focal": Piece("Players among strangers", "all", "", _focal),
    "correlations": Piece("Metrics and the score", "task", "figures S.14, S.18 …", _correlations, _COMPARED),
    "matrix": Piece("All pairs of metrics", "task", "figures S.13, S.17 …", _matrix, _COMPARED),
    "scatter": Piece("The metric with the largest correlation", "task", "figures S.15, S.19 …", _scatter, _COMPARED),
    "regression": Piece(
        "The score on all metrics, with SHAP values", "task", "figures S.16, S.20 …", _regression, _COMPARED
    ),
    "blocks": Piece("Physical metrics and communication", "all", "section 4.2", _blocks, ("definition",)),
    "failure-modes": Piece("Failure modes and the score", "all", "table S.7", _table(failure_modes)),
    "convergence-by-task": Piece("Convergence and the score, by task", "all", "table S.8", _table(convergence_by_task)),
    "convergence-by-model": Piece(
        "Convergence and the score, by model", "all", "table S.9", _table(convergence_by_model)
    ),
    "homogeneity-and-edits": Piece("Homogeneity and edit similarity", "all", "", _table(relate_to_edits)),
    "keywords": Piece("Keywords by task and model", "all", "figure S.33", _keywords),
    "distinctive-words": Piece("Words that set a model apart", "all", "", _table(distinctive_words)),
    "attribution": Piece("What actions follow from", "all", "figures 7, S.34", _attribution, ("acts",)),
    "dynamics": Piece("Dynamics", "model", "figures 3, S.35 to S.99", _dynamics),
}
"""All tables and figures by name."""
