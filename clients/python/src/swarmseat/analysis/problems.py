"""Errors about the games to analyse. Each message says what to do."""

from ..errors import SwarmbenchError


class AnalysisError(SwarmbenchError):
    """Something cannot be computed or drawn from these games."""


class FilesError(AnalysisError):
    """A file of an export is missing or damaged."""


class MissingColumnsError(AnalysisError):
    """A table has no column of that name, as in exports of earlier versions."""


class TooLittleDataError(AnalysisError):
    """There are too few games, models or messages."""


class ConstantError(AnalysisError):
    """A metric or the score is the same in all games."""


class MixedSettingsError(AnalysisError):
    """Games of different settings would be averaged."""


class MixedMeasuresError(AnalysisError):
    """Values of two embedders, or of two revisions of the metrics, would be compared."""
