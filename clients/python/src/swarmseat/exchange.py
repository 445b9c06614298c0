"""Requests and answers without any input and output, so that the sync and the async client share all of it."""

import json
import random
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, NamedTuple, TypeVar
from urllib.parse import quote

from .checks import shown
from .errors import ArgumentError, ConnectionFailedError, error_of, unexpected

T = TypeVar("T")

TIMEOUT_S = 30.0
"""The default `timeout`: the seconds that an answer may take beyond the `wait` of its request."""

PAUSE_S_MAX = 10.0
"""The maximum pause, in seconds, unless the server asks for a longer one."""


@dataclass(frozen=True)
class Retry:
    """The rules for retries of temporary failures: no answer, 429, 502, 503, 504, and a proxy's page with 408 or 5xx.

    The pauses double from `first_pause_s` up to 10 s, and are random so that many clients do not come back at once. A
    `Retry-After` of the server replaces the pause. Every request of this package may be repeated: the same act gets the
    same receipt again, and creations carry an `Idempotency-Key`.
    """

    times: int = 6
    """The maximum number of retries of a request; 0 for none."""
    first_pause_s: float = 0.1
    patience_s: float = 60.0
    """The maximum sum of the pauses before one answer. A request whose pauses would take longer fails at once."""


@dataclass(frozen=True)
class Call(Generic[T]):
    """One request, and the reader of its answer."""

    method: str
    path: str
    read: Callable[[bytes], T]
    query: Mapping[str, str] = field(default_factory=dict)
    body: bytes | None = None
    headers: Mapping[str, str] = field(default_factory=dict)
    wait_s: float = 0.0
    """The maximum time that the server may hold the answer back."""


class Reply(NamedTuple):
    """An answer. The names of `headers` are in lower case or case-insensitive."""

    status: int
    headers: Mapping[str, str]
    body: bytes


class NoReply(NamedTuple):
    """The reason why no answer came."""

    reason: Exception
    may_help: bool = True
    """Whether a retry may help. A retry does not help if no server has ever answered at the address."""


class Pause(NamedTuple):
    """A pause that the client has to wait for."""

    seconds: float


Step = Call[T] | Pause
Flow = Generator[Call[T] | Pause, Reply | NoReply | None, T]


def call(
    method: str,
    path: str,
    *ids: str,
    query: Mapping[str, object] | None = None,
    body: object = None,
    headers: Mapping[str, str] | None = None,
    read: Callable[[bytes], T] = json.loads,
) -> Call[T]:
    """A request. `ids` replace each `{}` of the path; parameters that are None are left out of the query."""
    kept = {name: _text(value) for name, value in (query or {}).items() if value is not None}
    return Call(
        method=method,
        path=path.format(*(quote(_id(id), safe="", errors="replace") for id in ids)),
        read=read,
        query=kept,
        body=None if body is None else _json(body),
        headers={**(headers or {}), **({} if body is None else {"content-type": "application/json"})},
        wait_s=_wait_s(kept.get("wait", "0")),
    )


def converse(request: Call[T], retry: Retry, server: str) -> Flow[T]:
    """Repeats a request until its answer is not temporary. The driver of this generator sends and sleeps."""
    asked = f"{request.method} {server}{request.path}"
    waited_s = 0.0
    for attempt in range(retry.times + 1):
        reply = yield request
        asked_s = None
        error: Exception
        if isinstance(reply, Reply) and 200 <= reply.status < 300:
            try:
                return request.read(reply.body)
            except ValueError as cause:
                raise unexpected(asked, "what is not JSON", reply.body, reply.status) from cause
        if isinstance(reply, Reply):
            error = error_of(asked, reply.status, reply.headers, reply.body)
            if not error.is_temporary:
                raise error
            asked_s = error.retry_after_s
        else:
            assert reply is not None  # noqa: S101 - a request is answered with one or the other
            reason = str(reply.reason) or type(reply.reason).__name__
            hint = "" if reply.may_help else "; is the address right, and does a server run there (`swarmbench serve`)?"
            error = ConnectionFailedError(f"no answer to {asked}: {reason}{hint}")
            error.__cause__ = reply.reason
            if not reply.may_help:
                raise error
            if attempt:
                error.args = (f"{error} ({attempt + 1} attempts)",)
        pause_s = min(retry.first_pause_s * 2**attempt, PAUSE_S_MAX) * random.uniform(0.5, 1.0)  # noqa: S311 - not a secret
        if asked_s is not None:
            pause_s = max(pause_s, asked_s)
        waited_s += pause_s
        if attempt == retry.times or waited_s > retry.patience_s:
            raise error
        yield Pause(pause_s)
    raise AssertionError("the last attempt returns or raises")


class Event(NamedTuple):
    """A Server-Sent Event."""

    event: str
    """The kind of event: `round`, `game` or `finished`."""
    id: str | None
    """The id from which the stream can be resumed."""
    data: Any
    """A `RoundEvent` or a `RunGame`; with `finished`, an `EpisodeResult` or a `RunDetail`."""


class EventStream:
    """A stream of events that is read to its end, even over broken connections."""

    def __init__(self, path: str, id: str, after: int | None = None) -> None:
        self._path = path
        self._id = id
        self._last = None if after is None else str(after)
        self._lines: list[str] = []
        self.finished = False

    def request(self) -> Call[None]:
        """The request for all events after the last one that was read."""
        self._lines = []
        resumed = {} if self._last is None else {"last-event-id": self._last}
        return call("GET", self._path, self._id, headers=resumed, read=lambda _: None)

    def feed(self, line: str) -> Iterator[Event]:
        """Takes a line without its end, and returns the event that the line completes."""
        if line:
            self._lines.append(line)
            return
        fields = {name: value.removeprefix(" ") for name, _, value in (line.partition(":") for line in self._lines)}
        self._lines = []
        if "data" not in fields:
            return
        self._last = fields.get("id", self._last)
        event = Event(fields.get("event", "message"), fields.get("id"), json.loads(fields["data"]))
        self.finished = event.event == "finished"
        yield event


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _id(value: object) -> str:
    if isinstance(value, Mapping) and isinstance(value.get("id"), str):
        raise ArgumentError(f"an id is needed, and a whole object came: its member is meant, {value['id']!r}")
    if not isinstance(value, str) or not value:
        raise ArgumentError(f"an id is a text such as 'ep_…' and not empty; it is {value!r}")
    return value


def _wait_s(value: str) -> float:
    try:
        wait_s = float(value)
    except ValueError:
        raise ArgumentError(f"wait is a number of seconds, and not {value!r}") from None
    # The server refuses numbers out of range, and names the range.
    return min(max(0.0, wait_s), 3600.0)


def _json(body: object) -> bytes:
    try:
        return json.dumps(body, ensure_ascii=False, allow_nan=False, default=_plain).encode(errors="replace")
    except (TypeError, ValueError) as error:
        # JSON has no NaN and no infinities, and no object that contains itself.
        raise ArgumentError(f"{shown(body)} cannot be sent as JSON: {error}") from error


def _plain(value: object) -> object:
    """Numbers and arrays of NumPy as Python's own."""
    to_list = getattr(value, "tolist", None)
    if to_list is not None:
        return to_list()
    raise ArgumentError(
        f"{shown(value)} cannot be sent as JSON: it is of {type(value).__name__}, and must be a text, a number, "
        "a bool, None, a list or a dictionary"
    )
