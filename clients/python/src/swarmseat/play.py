"""Playing all seats of a swarm token: what is shared by both clients. They ask, decide and wait."""

from collections.abc import Awaitable, Callable, Mapping
from typing import Any, cast

from . import wire
from .errors import ApiError, ArgumentError, is_problem

Decision = str | Mapping[str, Any]
"""What an agent decides: the name of an action, or fields of an act such as `action`, `message` and `response`."""

Decide = Callable[[wire.Observation], Decision]
"""Who decides for an agent, from what it sees."""

AsyncDecide = Callable[[wire.Observation], Awaitable[Decision]]
"""The same for asyncio."""

WAIT_S = 30.0
"""How long one look waits for something to decide."""

AT_ONCE = 16
"""How many agents decide at the same time, unless `play` is told otherwise."""

PAUSE_S = 1.0
"""The pause before an act is decided again that the server could not take, if the server asks for none."""

DELAYS_MAX = 12
"""How many answers in a row may take no act at all. A server that never takes one would be asked for ever."""

_TOO_LATE = {"round_over", "episode_over"}
_LATER = {"rate_limited", "overloaded", "unavailable"}


def act_of(seen: wire.Observation, decision: object) -> wire.SwarmAct:
    """The act of the agent that saw this."""
    if isinstance(decision, str):
        decision = {"action": decision}
    if not isinstance(decision, Mapping):
        raise ArgumentError(
            "an agent decides with the name of an action, or with a dictionary such as "
            f'{{"action": "UP", "message": "here"}}, and not with {decision!r}'
        )
    return cast(
        "wire.SwarmAct",
        {**decision, "episode": seen["episode"], "agent": seen["agent"], "round": seen["round"]},
    )


class Receipts:
    """What the server said to acts: which failure ends everything, and how long to wait before the next look."""

    def __init__(self) -> None:
        self._delays = 0

    def pause_s(self, receipts: list[wire.Receipt | wire.Problem]) -> float:
        """How long to wait. What was not taken waits for an act still, so it is decided again.

        Raises:
            ApiError: The server refused an act, and would refuse it again.
        """
        problems = [receipt for receipt in receipts if is_problem(receipt)]
        # A clock ran out, or somebody ended the game: nothing is wrong with the act.
        problems = [problem for problem in problems if problem["code"] not in _TOO_LATE]
        self._delays = self._delays + 1 if problems and len(problems) == len(receipts) else 0
        for problem in problems:
            if problem["code"] not in _LATER or self._delays > DELAYS_MAX:
                raise ApiError(problem)
        asked_ms = [problem.get("retry_after_ms") for problem in problems]
        return max((PAUSE_S if asked is None else asked / 1000 for asked in asked_ms), default=0.0)
