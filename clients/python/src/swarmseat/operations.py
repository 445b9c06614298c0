"""Every call of the protocol. Both clients have the calls as methods."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from . import wire
from .calls import Calls
from .errors import ArgumentError
from .exchange import Call, call
from .operation import Operation, once

EPISODE = "/api/v1/episodes/{}"
RUN = "/api/v1/runs/{}"
ATTEMPTS = "/api/v1/competitions/{}/attempts"


class Operations(Calls):
    """The calls. `swarmseat.wire` has their answers; docs/protocol.md says what they do."""

    @Operation
    def act(
        self,
        round: int,
        action: str | None = None,
        *,
        message: str | None = None,
        to: str | None = None,
        response: str | None = None,
        usage: wire.Usage | None = None,
        reasoning: str | None = None,
        failure: wire.Failure | None = None,
        wait: float | None = None,
    ) -> Call[wire.ActResponse]:
        """Answers a round with an action, or with the whole `response` of a language model.

        `failure` says why the model gave no answer, if only its client knows: the model refused, for example.

        With `wait` (seconds) the answer has the next observation in `obs`, or None if the time was up.
        """
        act: wire.ActRequest = {"round": round, "action": action, "message": message, "to": to}
        act |= {"response": response, "usage": usage, "reasoning": reasoning, "failure": failure}
        return call("POST", "/act", query={"wait": wait}, body=_given(act))

    @Operation
    def swarm_act(
        self, acts: Sequence[wire.SwarmAct], *, wait: float | None = None, prompt: bool | None = None
    ) -> Call[wire.SwarmActResponse]:
        """Acts for several seats. Each act is taken or refused for itself: see `swarmseat.is_refused`.

        With `wait` (seconds) the answer comes when the next round is open in every episode acted in, and has the next
        `observations` of these seats, except those that cannot be seen yet.
        """
        if isinstance(acts, Mapping | str) or not isinstance(acts, Iterable):
            raise ArgumentError(f"acts are a list of acts, each a dictionary, and not of {type(acts).__name__}")
        return call("POST", "/swarm/act", query={"wait": wait, "prompt": prompt}, body={"acts": list(acts)})

    @Operation
    def void_episode(self, id: str, reason: str) -> Call[wire.EpisodeSummary]:
        """Voids an episode that failed because of the host: it counts nowhere. For organizers."""
        return call("POST", EPISODE + "/void", id, body={"reason": reason})

    @Operation
    def repeat_episode(self, id: str, reason: str) -> Call[wire.EpisodeSummary]:
        """Plays an ended game of an own run again. The earlier one stays, shown with the reason, and counts nowhere."""
        return call("POST", EPISODE + "/repeat", id, body={"reason": reason})

    @Operation
    def start_attempt(
        self,
        competition: str,
        *,
        attempt: int | None = None,
        entrant: str | None = None,
        idempotency_key: str | None = None,
    ) -> Call[wire.StartedAttempt]:
        """Starts the next open attempt, or the attempt with this number; `entrant` is needed if the key has several.

        The attempt's swarm token is shown only once; `renew_run_token` replaces a lost one. Its clocks start now.
        """
        body = _given({"attempt": attempt, "entrant": entrant})
        return call("POST", ATTEMPTS, competition, body=body, headers=once(idempotency_key))

    @Operation
    def attempts(
        self, competition: str, *, limit: int | None = None, cursor: str | None = None
    ) -> Call[wire.AttemptList]:
        """A page of one's own attempts in a competition, in the order in which they were started."""
        return call("GET", ATTEMPTS, competition, query={"limit": limit, "cursor": cursor})

    @Operation
    def request(
        self, method: str, path: str, *, query: Mapping[str, object] | None = None, body: object = None
    ) -> Call[Any]:
        """Calls any other JSON route, such as those for organizers. The request is retried like all others."""
        return call(method, path.replace("{", "{{").replace("}", "}}"), query=query, body=body)


def _given(fields: Mapping[str, object]) -> dict[str, object]:
    return {name: value for name, value in fields.items() if value is not None}
