"""Connections to a server on this machine: their reuse, and their errors."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import httpx
import pytest

from swarmseat import ApiError, Client, ConnectionFailedError, Retry, Server
from swarmseat.connections import Connections

GOOD = b'HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: 15\r\n\r\n{"status":"ok"}'
Talk = Callable[[socket.socket], None]


@contextmanager
def host(*talks: Talk) -> Iterator[str]:
    """A host that handles its connections, one after the other, each in the given way."""

    def serve() -> None:
        for talk in talks:
            connection, _ = listener.accept()
            with connection:
                talk(connection)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        serving = threading.Thread(target=serve)
        serving.start()
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        serving.join(timeout=30)


def answers(*texts: bytes) -> Talk:
    def talk(connection: socket.socket) -> None:
        for text in texts:
            connection.recv(65536)
            connection.sendall(text)

    return talk


def test_a_connection_is_used_again_and_by_all_tokens() -> None:
    with host(answers(GOOD, GOOD, GOOD)) as address, Client(address, "a") as client:
        for token in ("b", "c", "d"):
            assert client.with_token(token).health() == {"status": "ok"}


def test_one_that_was_closed_while_it_was_idle_is_replaced() -> None:
    with (
        host(answers(GOOD), answers(GOOD), answers(GOOD)) as address,
        Client(address, retry=Retry(times=0)) as client,
    ):
        for _ in range(3):
            assert client.health() == {"status": "ok"}


def test_one_that_the_server_closes_is_not_kept() -> None:
    closing = GOOD.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n")
    with host(answers(closing), answers(closing)) as address, Client(address, retry=Retry(times=0)) as client:
        assert [client.health()["status"] for _ in range(2)] == ["ok", "ok"]


@pytest.mark.parametrize(("text", "kind", "told"), [
    (b"", httpx.RemoteProtocolError, "closed connection without response"),
    (b"hello\r\n\r\n", httpx.RemoteProtocolError, "hello"),
    (GOOD[:-5], httpx.RemoteProtocolError, "IncompleteRead"),
])  # fmt: skip
def test_answers_that_are_none(text: bytes, kind: type[Exception], told: str) -> None:
    with host(answers(text)) as address, Client(address, retry=Retry(times=0)) as client:
        with pytest.raises(ConnectionFailedError, match=told) as failed:
            client.health()
        assert type(failed.value.__cause__) is kind


def test_a_header_that_cannot_be_is_told() -> None:
    with (
        host(lambda _: None) as address,
        Client(address, retry=Retry(times=0)) as client,
        pytest.raises(ConnectionFailedError, match="Invalid header value"),
    ):
        client.create_episode(task="Foraging", idempotency_key="two\nlines")


def test_addresses_are_written_as_by_httpx(server: Server) -> None:
    with server.client() as client, pytest.raises(ApiError, match="there is no route /no%20such/%C3%BC;"):
        client.request("get", "/no such/ü?a=1", query={"b": "ä &"})
    with server.client() as client, pytest.raises(ApiError, match="unknown field `ä &`"):
        client.request("GET", "/api/v1/episodes", query={"ä &": 1})


def test_only_connections_to_this_machine_are_such() -> None:
    own = ["http://127.0.0.1:1", "http://localhost:1", "http://[::1]:1"]
    others = ["http://example.org", "https://127.0.0.1:1"]
    for address in own + others:
        with Client(address) as client:
            assert isinstance(client._connections, Connections) == (address in own)
    with httpx.Client() as http, Client(own[0], http=http) as client:
        assert client._connections is None
