"""Errors. Everything that this package raises by itself is a `SwarmbenchError`, also when httpx failed."""

import json
import re
from collections.abc import Mapping
from datetime import datetime, timezone
from email.utils import parsedate_to_datetime
from typing import TYPE_CHECKING, cast

from .wire import FieldProblem, Limit, Problem, Receipt

if TYPE_CHECKING:
    from typing_extensions import TypeIs

TEMPORARY_STATUS = frozenset({429, 502, 503, 504})
"""Statuses after which the same request may succeed: a rate limit, or a server that is restarting."""

LATE_STATUS = 408
"""The status with which a proxy answers a request that arrives too slowly."""

PAGE_CHARS_MAX = 200
"""The maximum length of a proxy's text that an error shows."""

PAGE_MARKUP = re.compile(r"<(script|style)\b.*?(</\1\s*>|\Z)|<[^>]*>?", re.DOTALL | re.IGNORECASE)


class SwarmbenchError(Exception):
    """Any failure that this package reports: the class of all errors below."""


class ArgumentError(SwarmbenchError, ValueError):
    """An argument that cannot be right, such as an address without a scheme. Nothing was sent."""


class ConnectionFailedError(SwarmbenchError):
    """No answer came: an unknown host, a refused or broken connection, or nothing within the time.

    `__cause__` is the error of httpx.
    """


class UnexpectedAnswerError(SwarmbenchError):
    """Something answered that does not speak the protocol: a proxy, or another program at this address.

    Attributes:
        status: The HTTP status.
        retry_after_s: The seconds after which a retry is worthwhile, if the answer names them.
        is_temporary: Whether a proxy answered in place of the server, as it does if the server died during the request.
    """

    def __init__(self, message: str, status: int, retry_after_s: float | None = None) -> None:
        super().__init__(message)
        self.status = status
        self.retry_after_s = retry_after_s
        self.is_temporary = status >= 500 or status in {LATE_STATUS, *TEMPORARY_STATUS}


class ApiError(SwarmbenchError):
    """The server refused a request. `code` is for programs; docs/protocol.md lists all codes.

    Attributes:
        code: The kind of error, such as `round_over`.
        status: The HTTP status.
        title: The code in words.
        detail: The expected and the received value.
        round: The round of the episode, if that helps.
        retry_after_s: The seconds after which a retry is worthwhile, if it is.
        is_temporary: Whether the same request may succeed later.
        limit: The limit that was reached.
        fields: The problems of all fields, one each.
        request_id: The id of the request, for questions to an operator.
        problem: The whole body of the answer.
    """

    def __init__(self, problem: Problem, *, retry_after_s: float | None = None, request_id: str | None = None) -> None:
        self.problem = problem
        self.code = problem["code"]
        self.status = problem["status"]
        self.title = problem["title"]
        self.detail = problem["detail"]
        self.round = problem.get("round")
        self.limit: Limit | None = problem.get("limit")
        self.fields: list[FieldProblem] = problem.get("fields") or []
        exact_ms = problem.get("retry_after_ms")
        self.retry_after_s = retry_after_s if exact_ms is None else exact_ms / 1000
        self.request_id = request_id
        self.is_temporary = self.status in TEMPORARY_STATUS
        wrongs = [f"{field['field']} {field['problem']}" for field in self.fields]
        wrong = "; ".join(one for one in wrongs if one not in self.detail)
        super().__init__(f"{self.status} {self.code}: {self.detail}" + (f" ({wrong})" if wrong else ""))


class ServerError(SwarmbenchError):
    """A server of one's own did not start, or its program was not found."""


def is_refused(receipt: Receipt | Problem) -> "TypeIs[Problem]":
    """Whether an act of a swarm was refused. `ApiError` makes an exception of a problem."""
    return "code" in receipt


def error_of(asked: str, status: int, headers: Mapping[str, str], body: bytes) -> ApiError | UnexpectedAnswerError:
    """The error for an unsuccessful answer. `asked` is the request in words."""
    retry_after_s = _retry_after_s(headers.get("retry-after"))
    try:
        problem = json.loads(body)
    except ValueError:
        problem = None
    if isinstance(problem, dict) and {"type", "title", "status", "detail", "code"} <= problem.keys():
        return ApiError(cast("Problem", problem), retry_after_s=retry_after_s, request_id=headers.get("x-request-id"))
    message = f"{status} of a proxy came for {asked}: {_first_text(body)}"
    by_proxy = UnexpectedAnswerError(message, status, retry_after_s)
    if by_proxy.is_temporary:
        return by_proxy
    moved = f" and the location {headers['location']!r}" if "location" in headers else ""
    return unexpected(asked, f"status {status}{moved}", body, status, retry_after_s)


def unexpected(
    asked: str, came: str, body: bytes, status: int, retry_after_s: float | None = None
) -> UnexpectedAnswerError:
    """The error for an answer that no swarmbench server gives."""
    shown = f": {_first_text(body)}" if body else ""
    hint = "no swarmbench server answers so: is the address right, or is a proxy in between?"
    return UnexpectedAnswerError(f"{came} came for {asked}{shown}; {hint}", status, retry_after_s)


def _first_text(body: bytes) -> str:
    """The first printable text of a page: without markup, scripts or styles, and with single spaces."""
    text = PAGE_MARKUP.sub(" ", body.decode("utf-8", "replace"))
    words = "".join(char if char.isprintable() else " " for char in text).split()
    return " ".join(words)[:PAGE_CHARS_MAX] or "no text"


def _retry_after_s(header: str | None) -> float | None:
    """The seconds of a `Retry-After`, which is a number of seconds or a date."""
    if header is None:
        return None
    try:
        return max(0.0, float(header))
    except ValueError:
        pass
    try:
        moment = parsedate_to_datetime(header)
    except ValueError:
        return None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=timezone.utc)
    return max(0.0, (moment - datetime.now(timezone.utc)).total_seconds())
