"""The metrics of the paper: their names in tables, and their panels in figures."""

from typing import Literal, NamedTuple

Definition = Literal["paper", "toolkit"]
"""`paper` follows the words of the paper, `toolkit` the scripts that were published with it."""


class Metric(NamedTuple):
    """A metric of the paper.

    Attributes:
        name: The name of the metric's column.
        title: The name for readers.
        panel: The panel of the dynamics figure that shows the metric; None if that figure does not draw it.
        divisor: The number by which values are divided there.
        block: The block: what agents said, or what they did; None if the metric belongs to neither.
    """

    name: str
    title: str
    panel: Literal["messages", "choices", "positions"] | None
    divisor: float
    block: Literal["communication", "physical"] | None


METRICS = (
    Metric("question_share", "Questions (share)", "messages", 1, "communication"),
    Metric("digit_share", "Digits (share)", "messages", 1, "communication"),
    Metric("message_length", "Message length", "messages", 200, "communication"),
    Metric("message_length_std", "Message length (deviation)", None, 1, None),
    Metric("homogeneity", "Information homogeneity", "messages", 2, "communication"),
    Metric("direction_entropy", "Directional entropy", "choices", 2, "physical"),
    Metric("stillness", "Stillness", "choices", 1, "physical"),
    Metric("dominant_action", "Dominant action", "choices", 1, "physical"),
    Metric("polarization", "Polarization", "choices", 1, "physical"),
    Metric("step_length", "Moving distance", "positions", 50, "physical"),
    Metric("explored", "Explored cells", "positions", 100, "physical"),
    Metric("kept_pairs", "Kept pairs", "positions", 10, "physical"),
    Metric("pushes", "Push events", "positions", 4, "physical"),
)
"""The thirteen metrics that the paper defines."""

TWELVE = tuple(metric.name for metric in METRICS if metric.panel)
"""The metrics that the paper's figures show, and that are compared with the score."""

PHYSICAL = tuple(metric.name for metric in METRICS if metric.block == "physical")
COMMUNICATION = tuple(metric.name for metric in METRICS if metric.block == "communication")

TITLES = {metric.name: metric.title for metric in METRICS}


def title(name: str) -> str:
    """The name for readers of a column, even of one that is not a metric of the paper."""
    return TITLES.get(name) or name.replace("_", " ").capitalize()


def column(name: str, definition: Definition) -> str:
    """The column of `episodes` that has the metric in that definition."""
    return name if definition == "paper" else f"toolkit_{name}"
