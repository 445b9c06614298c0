"""The clients: one that blocks, one for asyncio. They only send, read and sleep; `exchange` decides what."""

import asyncio
import ipaddress
import os
import ssl
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, ParamSpec, TypeVar

import httpx

from ._compat import Self
from .connections import Connections
from .errors import ArgumentError, ConnectionFailedError, SwarmbenchError
from .exchange import TIMEOUT_S, Call, Event, EventStream, Flow, NoReply, Pause, Reply, Retry, call, converse
from .names import Page
from .operations import EPISODE, RUN, Operations
from .play import AT_ONCE, WAIT_S, AsyncDecide, Decide, Receipts, act_of
from .wire import Observation, SwarmAct

FAILURES = (httpx.HTTPError, httpx.InvalidURL)
"""Errors of httpx that mean that no answer came."""

P = ParamSpec("P")
T = TypeVar("T")

CONNECT_S_MAX = 10.0
"""The maximum time to make a connection, in seconds, if `timeout` is not shorter."""

_HEADERS = {"user-agent": f"swarmbench-python/{version('swarmseat')}"}

EVENTS_SILENT_S_MAX = 45.0
"""Three times the 15 seconds within which the server sends something on a stream of events."""


class _Base(Operations):
    """The state of both clients: the server's address, the token, and how a call becomes a request of httpx."""

    def __init__(self, server: str | None, token: str | None, retry: Retry | None, timeout: float) -> None:
        from_environment = os.environ.get("SWARMBENCH_URL") or os.environ.get("SWARMBENCH_SERVER")
        self.server = _address(server or from_environment or "http://127.0.0.1:8080")
        if token is None:
            token = os.environ.get("SWARMBENCH_TOKEN") or os.environ.get("SWARMBENCH_KEY")
        self._token = _bare(token)
        self.retry = retry or Retry()
        self.timeout = _seconds(timeout)
        self._has_answered = False
        self._owns_http = True

    def with_token(self, token: str) -> Self:
        """A client for another token over the same connections, which this client owns."""
        other = copy(self)
        vars(other).update(_token=_bare(token), _owns_http=False)
        return other

    def _options(self) -> dict[str, Any]:
        url = httpx.URL(self.server)
        return {
            "headers": _HEADERS,
            # A proxy of the environment cannot reach this machine's own addresses.
            "trust_env": not _is_loopback(url.host),
            # Without TLS there is no need to read all certificates of the host, which takes a while. This context has
            # no certificates, so it would trust no server.
            **({"verify": ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)} if url.scheme == "http" else {}),
            # Many requests may wait at the same time. The server closes connections that were idle for 75 seconds.
            "limits": httpx.Limits(max_connections=None, max_keepalive_connections=64, keepalive_expiry=60.0),
        }

    def _arguments(self, request: Call[Any], silent_s_max: float | None = None) -> dict[str, Any]:
        headers = dict(request.headers)
        if self._token:
            headers["authorization"] = f"Bearer {self._token}"
        return {
            "method": request.method,
            "url": self.server + request.path,
            "params": request.query,
            "content": request.body,
            "headers": headers,
            "timeout": httpx.Timeout(
                (silent_s_max or self.timeout) + request.wait_s, connect=min(CONNECT_S_MAX, self.timeout)
            ),
        }

    def _check_open(self, http: httpx.Client | httpx.AsyncClient) -> None:
        if http.is_closed:
            raise SwarmbenchError(f"{self!r} is closed: make another one")

    def _reply_of(self, answer: httpx.Response, body: bytes) -> Reply:
        self._has_answered = True
        return Reply(answer.status_code, answer.headers, body)

    def _no_reply(self, error: Exception) -> NoReply:
        """Reads a failure of httpx."""
        if isinstance(error, httpx.InvalidURL):
            raise ArgumentError(f"this makes no address: {error}") from error
        # A server that has answered before may be restarting. If none has answered so far, the address is wrong.
        is_there = self._has_answered or not isinstance(error, httpx.ConnectError | httpx.ConnectTimeout)
        if isinstance(error, httpx.TimeoutException):
            kind = "no connection" if isinstance(error, httpx.ConnectTimeout) else "nothing came"
            limit_s = min(CONNECT_S_MAX, self.timeout) if isinstance(error, httpx.ConnectTimeout) else self.timeout
            waited = type(error)(f"{kind} within {limit_s:g} s")
            waited.__cause__ = error
            error = waited
        return NoReply(error, is_there)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.server!r})"


class Client(_Base):
    """A client for a server, and for the holder of one token.

    Args:
        server: The server's address. Default: `SWARMBENCH_URL` or `SWARMBENCH_SERVER` of the environment, or else
            `http://127.0.0.1:8080`.
        token: A token of a seat or a swarm, or a key. Default: `SWARMBENCH_TOKEN` or `SWARMBENCH_KEY` of the
            environment. With an empty text no token is sent.
        retry: The rules by which temporary failures are retried.
        timeout: The seconds without an answer after which an attempt fails, beyond the `wait` of the request. Making a
            connection may take as long, at most 10 s.
        http: A client of httpx to use instead of one of its own, for proxies and certificates; it is not closed.

    Raises:
        ArgumentError: The address has no scheme or host, or the token or the timeout is not valid.
    """

    def __init__(
        self,
        server: str | None = None,
        token: str | None = None,
        *,
        retry: Retry | None = None,
        timeout: float = TIMEOUT_S,
        http: httpx.Client | None = None,
    ) -> None:
        super().__init__(server, token, retry, timeout)
        self._owns_http = http is None
        self._connections = self._own_connections() if http is None else None
        self._http = http or httpx.Client(**self._options())

    def send(self, request: Call[T]) -> T:
        """Sends a request, retries it if that may help, and reads the answer."""
        return self._drive(converse(request, self.retry, self.server), self._reply)

    def paginate(self, page: Callable[P, Page[T]], /, *args: P.args, **kwargs: P.kwargs) -> Iterator[T]:
        """All items of a list, page by page: `client.paginate(client.episodes, task="Foraging")`."""
        while True:
            answer = page(*args, **kwargs)
            yield from answer["items"]
            if answer["next_cursor"] is None:
                return
            kwargs["cursor"] = answer["next_cursor"]

    def play(self, decide: Decide, *, prompt: bool = False) -> None:
        """Plays all seats of a swarm token until all its games are over: the games of an episode, a run or an attempt.

        A call after an interruption, also one in another program, continues the games.

        Args:
            decide: Gets an agent's observation, and returns an action's name or a dictionary with fields of an act.
            prompt: Whether observations have the text for a language model, as `prompt`.
        """
        receipts = Receipts()
        while not (looked := self.swarm_obs(wait=WAIT_S, prompt=prompt))["finished"]:
            acts = [act_of(seen, decide(seen)) for seen in looked["observations"]]
            if acts:
                time.sleep(receipts.pause_s(self.swarm_act(acts)["receipts"]))

    def events(self, episode: str, *, after: int | None = None) -> Iterator[Event]:
        """The rounds of an episode as they are resolved, from the first round or after round `after`, to its end."""
        return self._events(EventStream(EPISODE + "/events", episode, after))

    def run_events(self, run: str) -> Iterator[Event]:
        """The games of a run as they open and end, to the run's end. After a broken connection all games come again."""
        return self._events(EventStream(RUN + "/events", run))

    def export(self, file: str, to: str | os.PathLike[str], **filters: str | bool) -> None:
        """Downloads games as one file, such as `rounds.parquet`, without holding it in memory.

        docs/evaluate/dataset.md lists the files.

        Args:
            file: One of the files of `/api/v1/exports`.
            to: The path to write to; only a complete file gets that name.
            **filters: The games to export, such as `task` and `model`.

        Raises:
            ConnectionFailedError: The answer was interrupted.
        """
        query = {name: str(value).lower() if isinstance(value, bool) else value for name, value in filters.items()}
        partial = Path(f"{os.fspath(to)}.partial")
        try:
            with (
                self._stream(call("GET", "/api/v1/exports/{}", file, query=query)) as answer,
                partial.open("wb") as written,
            ):
                for piece in answer.iter_bytes():
                    written.write(piece)
            partial.replace(to)
        except httpx.HTTPError as error:
            raise ConnectionFailedError(f"the export {file} was interrupted ({error}): try again") from error
        finally:
            partial.unlink(missing_ok=True)

    def _events(self, stream: EventStream) -> Iterator[Event]:
        while not stream.finished:
            try:
                with self._stream(stream.request(), EVENTS_SILENT_S_MAX) as answer:
                    for line in answer.iter_lines():
                        yield from stream.feed(line)
            except httpx.TransportError:
                time.sleep(self.retry.first_pause_s)

    @contextmanager
    def _stream(self, request: Call[Any], silent_s_max: float | None = None) -> Iterator[httpx.Response]:
        """A successful answer whose body has yet to be read; any other answer is raised as an error."""
        opened: list[httpx.Response] = []

        def open_stream(request: Call[Any]) -> Reply | NoReply:
            self._check_open(self._http)
            try:
                answer = self._http.send(
                    self._http.build_request(**self._arguments(request, silent_s_max)), stream=True
                )
                opened.append(answer)
                return self._reply_of(answer, b"" if answer.is_success else answer.read())
            except FAILURES as error:
                return self._no_reply(error)

        try:
            # The caller reads the body.
            self._drive(converse(replace(request, read=bytes), self.retry, self.server), open_stream)
            yield opened[-1]
        finally:
            for answer in opened:
                answer.close()

    def _reply(self, request: Call[Any]) -> Reply | NoReply:
        self._check_open(self._http)
        try:
            if self._connections is not None:
                reply = self._connections.request(**self._arguments(request))
                self._has_answered = True
                return reply
            answer = self._http.request(**self._arguments(request))
        except FAILURES as error:
            return self._no_reply(error)
        return self._reply_of(answer, answer.content)

    def _own_connections(self) -> Connections | None:
        """Faster connections to a server on this machine, for everything except streams."""
        url = httpx.URL(self.server)
        if url.scheme != "http" or not _is_loopback(url.host):
            return None
        return Connections(url.host, url.port or 80, _HEADERS)

    @staticmethod
    def _drive(flow: Flow[T], reply_to: Callable[[Call[Any]], Reply | NoReply]) -> T:
        reply: Reply | NoReply | None = None
        while True:
            try:
                step = flow.send(reply)
            except StopIteration as end:
                value: T = end.value
                return value
            if isinstance(step, Pause):
                time.sleep(step.seconds)
                reply = None
            else:
                reply = reply_to(step)

    def close(self) -> None:
        """Closes the client's connections."""
        if self._owns_http:
            self._http.close()
            if self._connections is not None:
                self._connections.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


class AsyncClient(_Base):
    """`Client` for asyncio: every method that asks the server is awaited."""

    def __init__(
        self,
        server: str | None = None,
        token: str | None = None,
        *,
        retry: Retry | None = None,
        timeout: float = TIMEOUT_S,
        http: httpx.AsyncClient | None = None,
    ) -> None:
        super().__init__(server, token, retry, timeout)
        self._owns_http = http is None
        self._http = http or httpx.AsyncClient(**self._options())

    async def send(self, request: Call[T]) -> T:
        """Sends a request, retries it if that may help, and reads the answer."""
        return await self._drive(converse(request, self.retry, self.server), self._reply)

    async def paginate(
        self, page: Callable[P, Awaitable[Page[T]]], /, *args: P.args, **kwargs: P.kwargs
    ) -> AsyncIterator[T]:
        """All items of a list, page by page: `async for episode in client.paginate(client.episodes)`."""
        while True:
            answer = await page(*args, **kwargs)
            for item in answer["items"]:
                yield item
            if answer["next_cursor"] is None:
                return
            kwargs["cursor"] = answer["next_cursor"]

    async def play(self, decide: AsyncDecide, *, prompt: bool = False, at_once: int = AT_ONCE) -> None:
        """`Client.play` with a coroutine that decides, for at most `at_once` agents at the same time."""
        receipts, free = Receipts(), asyncio.Semaphore(at_once)

        async def act(seen: Observation) -> SwarmAct:
            async with free:
                return act_of(seen, await decide(seen))

        while not (looked := await self.swarm_obs(wait=WAIT_S, prompt=prompt))["finished"]:
            deciding = [asyncio.ensure_future(act(seen)) for seen in looked["observations"]]
            try:
                acts = await asyncio.gather(*deciding)
            finally:
                # If one decision fails, the others are not left running.
                for task in deciding:
                    task.cancel()
            if acts:
                await asyncio.sleep(receipts.pause_s((await self.swarm_act(acts))["receipts"]))

    def events(self, episode: str, *, after: int | None = None) -> AsyncIterator[Event]:
        """The rounds of an episode as they are resolved, from the first round or after round `after`, to its end."""
        return self._events(EventStream(EPISODE + "/events", episode, after))

    def run_events(self, run: str) -> AsyncIterator[Event]:
        """The games of a run as they open and end, to the run's end. After a broken connection all games come again."""
        return self._events(EventStream(RUN + "/events", run))

    async def _events(self, stream: EventStream) -> AsyncIterator[Event]:
        opened: list[httpx.Response] = []

        async def open_stream(request: Call[Any]) -> Reply | NoReply:
            self._check_open(self._http)
            try:
                built = self._http.build_request(**self._arguments(request, EVENTS_SILENT_S_MAX))
                answer = await self._http.send(built, stream=True)
                opened.append(answer)
                return self._reply_of(answer, b"" if answer.is_success else await answer.aread())
            except FAILURES as error:
                return self._no_reply(error)

        while not stream.finished:
            try:
                await self._drive(converse(stream.request(), self.retry, self.server), open_stream)
                async for line in opened[-1].aiter_lines():
                    for event in stream.feed(line):
                        yield event
            except httpx.TransportError:
                await asyncio.sleep(self.retry.first_pause_s)
            finally:
                for answer in opened:
                    await answer.aclose()
                opened.clear()

    async def _reply(self, request: Call[Any]) -> Reply | NoReply:
        self._check_open(self._http)
        try:
            answer = await self._http.request(**self._arguments(request))
        except FAILURES as error:
            return self._no_reply(error)
        return self._reply_of(answer, answer.content)

    @staticmethod
    async def _drive(flow: Flow[T], reply_to: Callable[[Call[Any]], Awaitable[Reply | NoReply]]) -> T:
        reply: Reply | NoReply | None = None
        while True:
            try:
                step = flow.send(reply)
            except StopIteration as end:
                value: T = end.value
                return value
            if isinstance(step, Pause):
                await asyncio.sleep(step.seconds)
                reply = None
            else:
                reply = await reply_to(step)

    async def aclose(self) -> None:
        """Closes the client's connections."""
        if self._owns_http:
            await self._http.aclose()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        await self.aclose()


def _address(server: object) -> str:
    """The address of a server without a slash at its end."""
    example = "such as http://127.0.0.1:8080"
    if not isinstance(server, str):
        raise ArgumentError(f"the address of a server is a text, {example}; it is {server!r}")
    address = server.strip().rstrip("/")
    try:
        url = httpx.URL(address)
    except httpx.InvalidURL as error:
        raise ArgumentError(f"{server!r} is no address of a server, {example}: {error}") from error
    if url.scheme not in {"http", "https"}:
        raise ArgumentError(f"the address of a server begins with http:// or https://, {example}; it is {server!r}")
    if not url.host or url.query or url.fragment:
        raise ArgumentError(
            f"the address of a server has a host, and neither query nor fragment, {example}; it is {server!r}"
        )
    return address


def _bare(token: object) -> str | None:
    """A token without the characters that surround it in a file or a header. Errors never show the token."""
    if token is None:
        return None
    if not isinstance(token, str):
        raise ArgumentError(f"a token is a text such as seat_…, and not of {type(token).__name__}")
    bare = token.strip().removeprefix("Bearer ").strip()
    if not bare.isascii() or not bare.isprintable() or " " in bare:
        raise ArgumentError("the token has characters that no token has: it is one word of letters, digits and _")
    return bare


def _seconds(timeout: object) -> float:
    is_number = isinstance(timeout, int | float) and not isinstance(timeout, bool)
    if not is_number or not 0 < timeout < float("inf"):  # type: ignore[operator] # a number
        raise ArgumentError(f"timeout is a number of seconds above 0, and not {timeout!r}")
    return float(timeout)  # type: ignore[arg-type] # a number


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost" or host.endswith(".localhost")
