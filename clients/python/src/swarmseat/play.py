"""Playing all seats of a swarm token: the part that both clients share. The clients ask, decide and wait."""

from collections.abc import Awaitable, Callable, Mapping
from typing import Any, cast

from . import wire
from .errors import ApiError, ArgumentError, is_refused

Decision = str | Mapping[str, Any]
"""A decision of an agent: the name of an action, or fields of an act such as `action`, `message` and `response`."""

Decide = Callable[[wire.Observation], Decision]
"""A function that decides for an agent, from its observation."""

AsyncDecide = Callable[[wire.Observation], Awaitable[Decision]]
"""The same for asyncio."""

WAIT_S = 30.0
"""The maximum time that one look waits for an observation to decide on."""

AT_ONCE = 16
"""The default number of agents that decide at the same time."""

PAUSE_S = 1.0
"""The pause before an agent decides again after the server could not take its act, if the server names none."""

DELAYS_MAX = 12
"""The maximum number of answers in a row that take no act: a server that never takes one would be asked forever."""

_TOO_LATE = {"round_over", "episode_over"}
_LATER = {"rate_limited", "overloaded", "unavailable"}


def act_of(seen: wire.Observation, decision: object) -> wire.SwarmAct:
    """The act of the agent that decided on this observation."""
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
    """The server's receipts for acts: which refusal ends the play, and the pause before the next look."""

    def __init__(self) -> None:
        self._delays = 0

    def pause_s(self, receipts: list[wire.Receipt | wire.Problem]) -> float:
        """The pause in seconds. Seats whose acts were not taken still wait for an act, so their agents decide again.

        Raises:
            ApiError: The server refused an act, and would refuse it again.
        """
        problems = [receipt for receipt in receipts if is_refused(receipt)]
        # A clock ran out, or another client ended the game: the act itself was right.
        problems = [problem for problem in problems if problem["code"] not in _TOO_LATE]
        self._delays = self._delays + 1 if problems and len(problems) == len(receipts) else 0
        for problem in problems:
            if problem["code"] not in _LATER or self._delays > DELAYS_MAX:
                raise ApiError(problem)
        asked_ms = [problem.get("retry_after_ms") for problem in problems]
        return max((PAUSE_S if asked is None else asked / 1000 for asked in asked_ms), default=0.0)
