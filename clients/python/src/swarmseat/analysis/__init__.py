"""Analysis of exported games: tables and figures of the SwarmBench paper.

`load` reads games; all other functions take these. Metrics are read from the export, never computed again. This package
needs the extra `analysis`; docs/evaluate/analysis.md in the repository shows how to use it.
"""

from . import _extra  # noqa: F401 - it is imported first to say what is missing
from .attribution import action_attribution
from .correlations import (
    convergence_by_model,
    convergence_by_task,
    correlation_matrix,
    correlations,
    failure_modes,
)
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
    save,
)
from .problems import (
    AnalysisError,
    ConstantError,
    FilesError,
    MissingColumnsError,
    MixedMeasuresError,
    MixedSettingsError,
    TooLittleDataError,
)
from .regression import Regression, blocks, regression
from .reporting import Report, report
from .series import dynamics, score_trends
from .tables import Games, load
from .teams import focal, substitution
from .texts import (
    Hash1,
    SentenceTransformers,
    compare_embedders,
    hash_1,
    homogeneity,
    homogeneity_of_games,
    relate_to_edits,
)
from .words import distinctive_words, keywords

__all__ = [
    "AnalysisError",
    "ConstantError",
    "FilesError",
    "Games",
    "Hash1",
    "MissingColumnsError",
    "MixedMeasuresError",
    "MixedSettingsError",
    "Regression",
    "Report",
    "SentenceTransformers",
    "TooLittleDataError",
    "action_attribution",
    "blocks",
    "compare_embedders",
    "convergence_by_model",
    "convergence_by_task",
    "correlation_matrix",
    "correlations",
    "costs",
    "distinctive_words",
    "dynamics",
    "failure_modes",
    "focal",
    "hash_1",
    "homogeneity",
    "homogeneity_of_games",
    "keywords",
    "load",
    "plot_attribution",
    "plot_blocks",
    "plot_correlation_matrix",
    "plot_correlations",
    "plot_costs",
    "plot_dynamics",
    "plot_focal",
    "plot_keywords",
    "plot_scatter",
    "plot_score_trends",
    "plot_scores",
    "plot_sensitivity",
    "plot_shap",
    "plot_substitution",
    "regression",
    "relate_to_edits",
    "report",
    "save",
    "score_trends",
    "substitution",
]
