"""Connections to a server on this machine, over the standard library.

A request takes a quarter of the processor time that it takes over httpx, which is most of the cost of a step of an
environment in Python. Between a program and its own machine there is neither a proxy nor TLS, so what httpx does about
both is not missing here. Errors are those of httpx.
"""

from collections.abc import Mapping
from functools import lru_cache
from http.client import HTTPConnection, HTTPException

import httpx

from .exchange import Reply

KEPT_MAX = 64
"""The maximum number of idle connections that are kept. The server closes connections that were idle for 75 seconds."""


class Connections:
    """Connections to one server; threads may share them.

    Args:
        host: The name or address of the server.
        port: The port of the host.
        headers: The headers of every request.
    """

    def __init__(self, host: str, port: int, headers: Mapping[str, str]) -> None:
        self._host, self._port, self._headers = host, port, headers
        self._idle: list[HTTPConnection] = []

    def request(
        self,
        method: str,
        url: str,
        *,
        params: Mapping[str, str],
        content: bytes | None,
        headers: Mapping[str, str],
        timeout: httpx.Timeout,
    ) -> Reply:
        """Sends a request, and reads the answer.

        Raises:
            httpx.HTTPError: No answer came.
            httpx.InvalidURL: There is no such address.
        """
        target = _target(url, tuple(params.items()))
        headers = {**self._headers, **headers}
        while True:
            connection, is_new = self._take(timeout.connect)
            try:
                connection.sock.settimeout(timeout.read)
                return self._ask(connection, method, target, content, headers)
            except BaseException as error:
                connection.close()
                # An idle connection may have been closed meanwhile. Every request may be repeated.
                if is_new or not isinstance(error, ConnectionError):
                    raise _as_httpx(error) from error

    def _take(self, connect_s: float | None) -> tuple[HTTPConnection, bool]:
        """An idle connection, or a new one."""
        try:
            return self._idle.pop(), False
        except IndexError:
            connection = HTTPConnection(self._host, self._port, timeout=connect_s)
        try:
            connection.connect()
        except OSError as error:
            connection.close()
            kind = httpx.ConnectTimeout if isinstance(error, TimeoutError) else httpx.ConnectError
            raise kind(str(error)) from error
        return connection, True

    def _ask(
        self, connection: HTTPConnection, method: str, target: str, content: bytes | None, headers: Mapping[str, str]
    ) -> Reply:
        connection.request(method.upper(), target, content, headers)
        answer = connection.getresponse()
        reply = Reply(answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read())
        if connection.sock is not None and len(self._idle) < KEPT_MAX:
            self._idle.append(connection)
        else:
            connection.close()
        return reply

    def close(self) -> None:
        """Closes the idle connections."""
        while self._idle:
            self._idle.pop().close()


def _as_httpx(error: BaseException) -> BaseException:
    """The error that httpx would have raised."""
    message = str(error) or type(error).__name__
    if isinstance(error, TimeoutError):
        return httpx.ReadTimeout(message)
    if isinstance(error, HTTPException):
        return httpx.RemoteProtocolError(message)
    if isinstance(error, OSError):
        return httpx.ReadError(message)
    # The value cannot be a header.
    return httpx.LocalProtocolError(message) if isinstance(error, ValueError) else error


@lru_cache(maxsize=256)
def _target(url: str, params: tuple[tuple[str, str], ...]) -> str:
    """The path and the query of an address, as httpx writes them."""
    return httpx.Request("GET", url, params=dict(params)).url.raw_path.decode("ascii")
