"""Names that the server knows, as types, and the type of its pages. The rest of the wire is in `wire`."""

from typing import Generic, Literal, TypeVar, get_args

from ._compat import TypedDict

T = TypeVar("T")

TaskName = Literal["Transport", "Pursuit", "Synchronization", "Foraging", "Flocking"]
"""The five tasks."""

ActionName = Literal["UP", "DOWN", "LEFT", "RIGHT", "STAY", "SWITCH"]
"""All actions. An observation's `actions` are those of its task."""

RuleSet = Literal["paper", "reference"]
"""The rule set of a game."""

Control = Literal["decentralized", "centralized"]
"""The control of a swarm. Under `centralized` every agent sees the whole map."""

AnswerReader = Literal["last-marker", "first-marker", "json"]
"""The reader of language models' answers: the marker that counts."""

Start = Literal["now", "manual"]
"""The start of an episode."""

Visibility = Literal["public", "owner"]
"""The readers of a game before its end."""

Pick = Literal["best", "last", "mean"]
"""The run that makes a player's row on a leaderboard."""

Definition = Literal["paper", "toolkit"]
"""The definition of metrics."""

Rewards = Literal["team", "individual"]
"""The rewards of agents: the change of the score for everybody, or each agent's own part of it."""

TASKS: tuple[TaskName, ...] = get_args(TaskName)


def actions_of(task: str) -> tuple[str, ...]:
    """The actions of a task, by their numbers."""
    actions: tuple[str, ...] = get_args(ActionName)
    return actions if task == "Synchronization" else actions[:-1]


class Page(TypedDict, Generic[T]):
    """A page of a list."""

    items: list[T]
    next_cursor: str | None
    """The `cursor` for the next page; null on the last page."""
