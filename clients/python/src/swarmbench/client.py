"""The clients: one that blocks, one for asyncio. All they do themselves is to send, to read and to sleep."""

import asyncio
import ipaddress
import os
import ssl
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, ParamSpec, TypeVar

import httpx

from ._compat import Self
from .errors import ConnectionFailedError
from .exchange import ANSWER_S_MAX, Call, Event, EventStream, Flow, NoReply, Pause, Reply, Retry, call, converse
from .operations import EPISODE, RUN, Operations
from .wire import Page

P = ParamSpec("P")
T = TypeVar("T")

EVENTS_SILENT_S_MAX = 45.0
"""Three times the 15 seconds after which the server says something on a stream of events."""


class _Base(Operations):
    """What both clients know: where the server is, who asks, and how a call becomes a request of httpx."""

    def __init__(self, server: str | None, token: str | None, retry: Retry | None) -> None:
        from_environment = os.environ.get("SWARMBENCH_URL") or os.environ.get("SWARMBENCH_SERVER")
        self.server = (server or from_environment or "http://127.0.0.1:8080").rstrip("/")
        if token is None:
            token = os.environ.get("SWARMBENCH_TOKEN") or os.environ.get("SWARMBENCH_KEY")
        self._token = token
        self.retry = retry or Retry()

    def _options(self) -> dict[str, Any]:
        url = httpx.URL(self.server)
        return {
            "headers": {"user-agent": f"swarmbench-python/{version('swarmbench')}"},
            # A proxy of the environment cannot reach this machine's own addresses.
            "trust_env": not _is_loopback(url.host),
            # Without TLS there is no need to read all certificates of the host, which takes a while. This context knows
            # none, so it would trust nobody.
            **({"verify": ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)} if url.scheme == "http" else {}),
            # Many may wait at the same time. The server closes what was idle for 75 seconds.
            "limits": httpx.Limits(max_connections=None, max_keepalive_connections=64, keepalive_expiry=60.0),
        }

    def _arguments(self, request: Call[Any], silent_s_max: float = ANSWER_S_MAX) -> dict[str, Any]:
        headers = dict(request.headers)
        if self._token:
            headers["authorization"] = f"Bearer {self._token}"
        return {
            "method": request.method,
            "url": self.server + request.path,
            "params": request.query,
            "content": request.body,
            "headers": headers,
            "timeout": httpx.Timeout(silent_s_max + request.wait_s, connect=10.0),
        }

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.server!r})"


class Client(_Base):
    """A client for a server, and for the holder of one token.

    Args:
        server: Its address; where it is left out that in `SWARMBENCH_URL` or `SWARMBENCH_SERVER`, or else
            `http://127.0.0.1:8080`.
        token: A token of a seat or a swarm, or a key; where it is left out that in `SWARMBENCH_TOKEN` or
            `SWARMBENCH_KEY`. An empty text shows none.
        retry: How temporary failures are tried again.
        http: A client of httpx to use instead of one of its own, for proxies and certificates; it is not closed.
    """

    def __init__(
        self,
        server: str | None = None,
        token: str | None = None,
        *,
        retry: Retry | None = None,
        http: httpx.Client | None = None,
    ) -> None:
        super().__init__(server, token, retry)
        self._owns_http = http is None
        self._http = http or httpx.Client(**self._options())

    def with_token(self, token: str) -> "Client":
        """A client for another token over the same connections, which stay with this one."""
        return Client(self.server, token, retry=self.retry, http=self._http)

    def send(self, request: Call[T]) -> T:
        """Sends a request, again where that may help, and reads the answer."""
        return self._drive(converse(request, self.retry), self._reply)

    def every(self, page: Callable[P, Page[T]], /, *args: P.args, **kwargs: P.kwargs) -> Iterator[T]:
        """All items of a list, page by page: `client.every(client.episodes, task="Foraging")`."""
        while True:
            answer = page(*args, **kwargs)
            yield from answer["items"]
            if answer["next_cursor"] is None:
                return
            kwargs["cursor"] = answer["next_cursor"]

    def events(self, episode: str, *, after: int | None = None) -> Iterator[Event]:
        """The rounds of an episode as they are resolved, from the first one or after round `after`, to its end."""
        return self._events(EventStream(EPISODE + "/events", episode, after))

    def run_events(self, run: str) -> Iterator[Event]:
        """The games of a run as they are opened and end, to its end. Where the connection broke, all come again."""
        return self._events(EventStream(RUN + "/events", run))

    def export(self, file: str, to: str | os.PathLike[str], **filters: str | bool) -> None:
        """Downloads games as one file, such as `rounds.parquet`, without holding it in memory.

        docs/evaluate/dataset.md says which there are.

        Args:
            file: One of the files of `/api/v1/exports`.
            to: Where it is written; only a complete file gets that name.
            **filters: Which games, such as `task` and `model`.

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
        except httpx.TransportError as error:
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
    def _stream(self, request: Call[Any], silent_s_max: float = ANSWER_S_MAX) -> Iterator[httpx.Response]:
        """An answer whose body has yet to be read, or else is no success and an error."""
        opened: list[httpx.Response] = []

        def open_stream(request: Call[Any]) -> Reply | NoReply:
            arguments = self._arguments(request, silent_s_max)
            timeout = arguments.pop("timeout")
            try:
                answer = self._http.send(self._http.build_request(timeout=timeout, **arguments), stream=True)
                opened.append(answer)
                return Reply(answer.status_code, answer.headers, b"" if answer.is_success else answer.read())
            except httpx.TransportError as error:
                return NoReply(error)

        try:
            # The body is for the caller.
            self._drive(converse(replace(request, read=bytes), self.retry), open_stream)
            yield opened[-1]
        finally:
            for answer in opened:
                answer.close()

    def _reply(self, request: Call[Any]) -> Reply | NoReply:
        try:
            answer = self._http.request(**self._arguments(request))
        except httpx.UnsupportedProtocol:
            raise
        except httpx.TransportError as error:
            return NoReply(error)
        return Reply(answer.status_code, answer.headers, answer.content)

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
        """Closes its connections."""
        if self._owns_http:
            self._http.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


class AsyncClient(_Base):
    """The same as `Client` for asyncio: every method that asks the server is awaited."""

    def __init__(
        self,
        server: str | None = None,
        token: str | None = None,
        *,
        retry: Retry | None = None,
        http: httpx.AsyncClient | None = None,
    ) -> None:
        super().__init__(server, token, retry)
        self._owns_http = http is None
        self._http = http or httpx.AsyncClient(**self._options())

    def with_token(self, token: str) -> "AsyncClient":
        """A client for another token over the same connections, which stay with this one."""
        return AsyncClient(self.server, token, retry=self.retry, http=self._http)

    async def send(self, request: Call[T]) -> T:
        """Sends a request, again where that may help, and reads the answer."""
        return await self._drive(converse(request, self.retry), self._reply)

    async def every(
        self, page: Callable[P, Awaitable[Page[T]]], /, *args: P.args, **kwargs: P.kwargs
    ) -> AsyncIterator[T]:
        """All items of a list, page by page: `async for episode in client.every(client.episodes)`."""
        while True:
            answer = await page(*args, **kwargs)
            for item in answer["items"]:
                yield item
            if answer["next_cursor"] is None:
                return
            kwargs["cursor"] = answer["next_cursor"]

    def events(self, episode: str, *, after: int | None = None) -> AsyncIterator[Event]:
        """The rounds of an episode as they are resolved, from the first one or after round `after`, to its end."""
        return self._events(EventStream(EPISODE + "/events", episode, after))

    def run_events(self, run: str) -> AsyncIterator[Event]:
        """The games of a run as they are opened and end, to its end. Where the connection broke, all come again."""
        return self._events(EventStream(RUN + "/events", run))

    async def _events(self, stream: EventStream) -> AsyncIterator[Event]:
        opened: list[httpx.Response] = []

        async def open_stream(request: Call[Any]) -> Reply | NoReply:
            arguments = self._arguments(request, EVENTS_SILENT_S_MAX)
            timeout = arguments.pop("timeout")
            try:
                answer = await self._http.send(self._http.build_request(timeout=timeout, **arguments), stream=True)
                opened.append(answer)
                return Reply(answer.status_code, answer.headers, b"" if answer.is_success else await answer.aread())
            except httpx.TransportError as error:
                return NoReply(error)

        while not stream.finished:
            try:
                await self._drive(converse(stream.request(), self.retry), open_stream)
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
        try:
            answer = await self._http.request(**self._arguments(request))
        except httpx.UnsupportedProtocol:
            raise
        except httpx.TransportError as error:
            return NoReply(error)
        return Reply(answer.status_code, answer.headers, answer.content)

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
        """Closes its connections."""
        if self._owns_http:
            await self._http.aclose()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        await self.aclose()


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost" or host.endswith(".localhost")
