"""Every call of the protocol, once. Both clients have the calls as methods."""

import uuid
from collections.abc import Callable, Coroutine, Iterable, Mapping, Sequence
from functools import update_wrapper
from types import MethodType
from typing import TYPE_CHECKING, Any, Concatenate, Generic, Literal, ParamSpec, TypeVar, cast, overload

from . import wire
from ._compat import Self, Unpack
from .errors import ArgumentError
from .exchange import Call, call

if TYPE_CHECKING:
    from .client import AsyncClient, Client

P = ParamSpec("P")
T = TypeVar("T")

EPISODE = "/api/v1/episodes/{}"
RUN = "/api/v1/runs/{}"
ATTEMPTS = "/api/v1/competitions/{}/attempts"


class Operation(Generic[P, T]):
    """A method that makes a request. On a `Client` it returns the answer, on an `AsyncClient` it is awaited."""

    def __init__(self, build: Callable[Concatenate[Any, P], Call[T]]) -> None:
        self._build = build
        update_wrapper(cast("Callable[..., Any]", self), build)

    def __call__(self, client: "Client | AsyncClient", *args: P.args, **kwargs: P.kwargs) -> Any:
        """Calls the method on the client that is its first argument, as with any function of a class."""
        return client.send(self._build(client, *args, **kwargs))

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: "Client", owner: type) -> Callable[P, T]: ...
    @overload
    def __get__(self, instance: "AsyncClient", owner: type) -> Callable[P, Coroutine[Any, Any, T]]: ...
    def __get__(self, instance: Any, owner: type) -> Any:
        if instance is None:
            return self

        return MethodType(self, instance)


class Operations:
    """The calls. `swarmseat.wire` has their answers; docs/protocol.md says what they do."""

    # An agent: two calls and one token.

    @Operation
    def obs(
        self, *, after: int | None = None, wait: float | None = None, prompt: bool | None = None
    ) -> Call[wire.Observation]:
        """The observation of the token's agent. With `after` and `wait` (seconds) the call waits for a later round."""
        return call("GET", "/obs", query={"after": after, "wait": wait, "prompt": prompt})

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

    # A swarm: many seats in one call.

    @Operation
    def swarm_obs(
        self,
        *,
        after: str | None = None,
        wait: float | None = None,
        limit: int | None = None,
        prompt: bool | None = None,
    ) -> Call[wire.SwarmObsResponse]:
        """The observations that wait for an act; with `after` only observations of rounds opened after that cursor."""
        return call("GET", "/swarm/obs", query={"after": after, "wait": wait, "limit": limit, "prompt": prompt})

    @Operation
    def swarm_act(
        self, acts: Sequence[wire.SwarmAct], *, wait: float | None = None, prompt: bool | None = None
    ) -> Call[wire.SwarmActResponse]:
        """Acts for several seats. Each act is taken or refused for itself: see `swarmseat.is_problem`.

        With `wait` (seconds) the answer comes when the next round is open in every episode acted in, and has the next
        `observations` of these seats, except those that cannot be seen yet.
        """
        if isinstance(acts, Mapping | str) or not isinstance(acts, Iterable):
            raise ArgumentError(f"acts are a list of acts, each a dictionary, and not of {type(acts).__name__}")
        return call("POST", "/swarm/act", query={"wait": wait, "prompt": prompt}, body={"acts": list(acts)})

    # Episodes.

    @Operation
    def create_episode(
        self, *, idempotency_key: str | None = None, **settings: Unpack[wire.EpisodeRequest]
    ) -> Call[wire.CreatedEpisode]:
        """Creates an episode. Its tokens are shown only once."""
        return call("POST", "/api/v1/episodes", body=settings, headers=_once(idempotency_key))

    @Operation
    def fork(
        self, id: str, *, idempotency_key: str | None = None, **settings: Unpack[wire.ForkRequest]
    ) -> Call[wire.CreatedForks]:
        """Creates one or `count` new episodes that continue from an episode's state before `round`."""
        return call("POST", EPISODE + "/fork", id, body=settings, headers=_once(idempotency_key))

    @Operation
    def episode(self, id: str) -> Call[wire.EpisodeSummary]:
        """An episode."""
        return call("GET", EPISODE, id)

    @Operation
    def episodes(
        self,
        *,
        status: wire.StatusName | None = None,
        task: wire.TaskName | None = None,
        model: str | None = None,
        run: str | None = None,
        fork_of: str | None = None,
        limit: int | None = None,
        cursor: str | None = None,
    ) -> Call[wire.Page[wire.EpisodeSummary]]:
        """A page of episodes, newest first."""
        query = {
            "status": status, "task": task, "model": model, "run": run, "fork_of": fork_of, "limit": limit,
            "cursor": cursor,
        }  # fmt: skip
        return call("GET", "/api/v1/episodes", query=query)

    @Operation
    def start_episode(self, id: str) -> Call[wire.EpisodeSummary]:
        """Starts a waiting episode."""
        return call("POST", EPISODE + "/start", id)

    @Operation
    def abort_episode(self, id: str) -> Call[wire.EpisodeSummary]:
        """Ends an episode. Its rounds and acts stay."""
        return call("DELETE", EPISODE, id)

    @Operation
    def void_episode(self, id: str, reason: str) -> Call[wire.EpisodeSummary]:
        """Voids an episode that failed because of the host: it counts nowhere. For organizers."""
        return call("POST", EPISODE + "/void", id, body={"reason": reason})

    @Operation
    def claim_seats(
        self, id: str, *, idempotency_key: str | None = None, **claim: Unpack[wire.ClaimRequest]
    ) -> Call[wire.CreatedClaim]:
        """Claims open seats of an episode. The tokens are shown only once."""
        return call("POST", EPISODE + "/claims", id, body=claim, headers=_once(idempotency_key))

    @Operation
    def seats(self, id: str) -> Call[wire.SeatList]:
        """The holders of the seats of an episode."""
        return call("GET", EPISODE + "/claims", id)

    @Operation
    def state(self, id: str, *, round: int | None = None) -> Call[wire.State]:
        """The whole world, now or after `round` resolved rounds."""
        return call("GET", EPISODE + "/state", id, query={"round": round})

    @Operation
    def journal(self, id: str) -> Call[bytes]:
        """The journal, byte for byte, as `swarmbench verify` reads it."""
        return call("GET", EPISODE + "/journal", id, read=bytes)

    @Operation
    def metrics(
        self,
        id: str,
        *,
        definition: Literal["paper", "toolkit"] | None = None,
        series: bool | None = None,
        from_: int | None = None,
        states: int | None = None,
    ) -> Call[wire.GameMetrics]:
        """The metrics of an episode; with `series` also those of its states (at most 1,000 at once)."""
        query = {"definition": definition, "series": series, "from": from_, "states": states}
        return call("GET", EPISODE + "/metrics", id, query=query)

    @Operation
    def replay(
        self, id: str, *, from_: int | None = None, rounds: int | None = None, ground: bool | None = None
    ) -> Call[wire.Replay]:
        """A page of the states of an episode, with the agents' decisions: up to 100 rounds from state `from_` on."""
        return call("GET", EPISODE + "/replay", id, query={"from": from_, "rounds": rounds, "ground": ground})

    @Operation
    def agent_round(self, id: str, round: int, agent: str) -> Call[wire.AgentRound]:
        """The observation and the act of an agent in a round."""
        return call("GET", EPISODE + "/rounds/{}/agents/{}", id, str(round), agent)

    @Operation
    def scores(self, id: str, *, points: int | None = None) -> Call[wire.Scores]:
        """The score of an episode in equal steps of rounds."""
        return call("GET", EPISODE + "/scores", id, query={"points": points})

    @Operation
    def verification(self, id: str) -> Call[wire.Verification]:
        """The server's findings when it replayed the journal."""
        return call("GET", EPISODE + "/verification", id)

    # Runs and suites.

    @Operation
    def suites(self) -> Call[wire.Page[wire.SuiteView]]:
        """The built-in suites."""
        return call("GET", "/api/v1/suites")

    @Operation
    def create_run(
        self, *, idempotency_key: str | None = None, **run: Unpack[wire.RunRequest]
    ) -> Call[wire.CreatedRun]:
        """Starts a run. Its token is shown only once."""
        return call("POST", "/api/v1/runs", body=run, headers=_once(idempotency_key))

    @Operation
    def run(self, id: str) -> Call[wire.RunDetail]:
        """A run with its games."""
        return call("GET", RUN, id)

    @Operation
    def runs(
        self,
        *,
        status: str | None = None,
        model: str | None = None,
        suite: str | None = None,
        limit: int | None = None,
        cursor: str | None = None,
    ) -> Call[wire.Page[wire.RunSummary]]:
        """A page of runs, newest first."""
        query = {"status": status, "model": model, "suite": suite, "limit": limit, "cursor": cursor}
        return call("GET", "/api/v1/runs", query=query)

    @Operation
    def abort_run(self, id: str) -> Call[wire.RunDetail]:
        """Ends a run and its open games."""
        return call("DELETE", RUN, id)

    @Operation
    def renew_run_token(self, id: str) -> Call[wire.RunToken]:
        """Replaces a lost token of a run. The earlier token is no longer accepted."""
        return call("POST", RUN + "/token", id)

    # Competitions, with the key of an entrant.

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
        return call("POST", ATTEMPTS, competition, body=body, headers=_once(idempotency_key))

    @Operation
    def attempts(
        self, competition: str, *, limit: int | None = None, cursor: str | None = None
    ) -> Call[wire.Page[wire.AttemptSummary]]:
        """A page of one's own attempts in a competition, in the order in which they were started."""
        return call("GET", ATTEMPTS, competition, query={"limit": limit, "cursor": cursor})

    # Boards.

    @Operation
    def run_metrics(
        self,
        id: str,
        *,
        definition: Literal["paper", "toolkit"] | None = None,
        limit: int | None = None,
        cursor: str | None = None,
    ) -> Call[wire.RunMetrics]:
        """The metrics of the games of a run that have ended, and their means by task."""
        return call("GET", RUN + "/metrics", id, query={"definition": definition, "limit": limit, "cursor": cursor})

    @Operation
    def run_scores(
        self, id: str, *, points: int | None = None, limit: int | None = None, cursor: str | None = None
    ) -> Call[wire.RunScores]:
        """The scores of the games of a run, running ones too, in equal steps of rounds."""
        return call("GET", RUN + "/scores", id, query={"points": points, "limit": limit, "cursor": cursor})

    @Operation
    def leaderboard(self, **query: Unpack[wire.LeaderboardQuery]) -> Call[wire.Leaderboard]:
        """The leaderboard of a suite."""
        return call("GET", "/api/v1/leaderboard", query={**query, "format": "json"})

    @Operation
    def leaderboard_csv(self, **query: Unpack[wire.LeaderboardQuery]) -> Call[str]:
        """The same as CSV."""
        return call("GET", "/api/v1/leaderboard", query={**query, "format": "csv"}, read=bytes.decode)

    @Operation
    def cross_play(self, **query: Unpack[wire.CrossPlayQuery]) -> Call[wire.Page[wire.CrossPlayPair]]:
        """The scores of models that played together."""
        return call("GET", "/api/v1/cross-play", query={**query, "format": "json"})

    @Operation
    def cross_play_csv(self, **query: Unpack[wire.CrossPlayQuery]) -> Call[str]:
        """The same as CSV."""
        return call("GET", "/api/v1/cross-play", query={**query, "format": "csv"}, read=bytes.decode)

    # The server.

    @Operation
    def health(self) -> Call[wire.Health]:
        """Whether the server lives, and its version."""
        return call("GET", "/healthz")

    @Operation
    def ready(self) -> Call[wire.Health]:
        """The same, once the server is ready for all requests. Until then it answers 503, which is retried."""
        return call("GET", "/readyz")

    @Operation
    def request(
        self, method: str, path: str, *, query: Mapping[str, object] | None = None, body: object = None
    ) -> Call[Any]:
        """Calls any other JSON route, such as those for organizers. The request is retried like all others."""
        return call(method, path.replace("{", "{{").replace("}", "}}"), query=query, body=body)


def _given(fields: Mapping[str, object]) -> dict[str, object]:
    return {name: value for name, value in fields.items() if value is not None}


def _once(key: str | None) -> dict[str, str]:
    """The `Idempotency-Key` of a creation: a retry must not create a second one."""
    return {"idempotency-key": key or uuid.uuid4().hex}
