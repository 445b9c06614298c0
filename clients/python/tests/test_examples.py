"""The minimal agents of `examples/agents` play seats to the end, and well; the load balancer of `examples/cluster`."""

import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import httpx
import pytest
from conftest import ROOT

from swarmseat import Client, Server, wire
from swarmseat.errors import ApiError, error_of

AGENTS = ROOT / "examples" / "agents"
PROGRAMS = {"minimal.py": [sys.executable], "minimal.sh": ["bash"], "minimal.mjs": ["node"]}
NEEDED = {"minimal.py": [], "minimal.sh": ["bash", "curl", "jq"], "minimal.mjs": ["node"]}


@pytest.fixture(params=sorted(PROGRAMS))
def agent(request: pytest.FixtureRequest) -> Path:
    missing = [program for program in NEEDED[request.param] if shutil.which(program) is None]
    # A missing tool is a failure: an example that did not run may not work.
    assert not missing, f"install {' and '.join(missing)} for this test, on Debian: apt-get install jq nodejs curl"
    return AGENTS / str(request.param)


def play(agent: Path, server: Server, created: wire.CreatedEpisode) -> list[str]:
    """Plays a seat with each agent, and returns their output at the end."""
    running = [
        subprocess.Popen(
            [*PROGRAMS[agent.name], str(agent)],
            env={**os.environ, "SWARMBENCH_URL": server.url, "SWARMBENCH_TOKEN": seat["token"]},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for seat in created["seats"]
    ]
    said = [process.communicate(timeout=120) for process in running]
    assert [(process.returncode, errors) for process, (_, errors) in zip(running, said, strict=True)] == [
        (0, "")
    ] * len(running)
    return [output for output, _ in said]


def test_it_is_short(agent: Path) -> None:
    assert len(agent.read_text().splitlines()) < 30


def test_it_plays_to_the_end_and_well(agent: Path, server: Server, client: Client) -> None:
    created = client.create_episode(task="Synchronization", num_agents=3, max_round=12, seed=27)
    said = play(agent, server, created)
    ended = client.episode(created["id"])
    assert ended["status"] == "finished"
    # Lights that are wrong at first cost at most the first round.
    assert ended["score"] >= 11
    assert [line.split()[1] for line in said] == ["finished"] * 3


@pytest.mark.parametrize("task", ["Foraging", "Pursuit", "Transport", "Flocking"])
def test_it_knows_every_task(agent: Path, server: Server, client: Client, task: wire.TaskName) -> None:
    created = client.create_episode(task=task, num_agents=2 if task == "Flocking" else 1, max_round=15, seed=3)
    play(agent, server, created)
    assert client.episode(created["id"])["status"] == "finished"


def test_it_carries_food(agent: Path, server: Server, client: Client) -> None:
    # On this layout the agent walks past the food, and then past the nest.
    created = client.create_episode(task="Foraging", num_agents=1, max_round=30, seed=1)
    play(agent, server, created)
    assert client.episode(created["id"])["score"] == 1.0


def test_it_waits_for_holders_of_other_seats(agent: Path, server: Server, client: Client) -> None:
    created = client.create_episode(task="Synchronization", num_agents=2, max_round=3, open_seats=1, fill_after_s=0.5)
    (said,) = play(agent, server, created)
    assert said.startswith("Agent_0 finished")


class Standin(BaseHTTPRequestHandler):
    """A server behind the load balancer, which answers or dies at each request other than a health check."""

    dies = False
    seen: list[str]

    def do_GET(self) -> None:
        self.rfile.read(int(self.headers.get("content-length", 0)))
        if self.path != "/readyz":
            self.seen.append(f"{self.command} {self.path}")
            if self.dies:
                self.close_connection = True
                return
        self.send_response(200)
        self.send_header("content-length", "0")
        self.end_headers()

    do_POST = do_DELETE = do_GET  # noqa: N815

    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def standin(dies: bool) -> Iterator[tuple[str, list[str]]]:
    """The address of a stand-in, and the requests that it got."""
    handler = type("Handler", (Standin,), {"dies": dies, "seen": []})
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"127.0.0.1:{server.server_port}", handler.seen  # type: ignore[attr-defined]
        server.shutdown()


@contextmanager
def balancer(*servers: str) -> Iterator[str]:
    """The load balancer of the example, in front of these servers."""
    assert shutil.which("haproxy"), "install haproxy for this test, on Debian: apt-get install haproxy"
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        listen = f"127.0.0.1:{free.getsockname()[1]}"
    names = {f"SERVER{number}": server for number, server in enumerate(servers, 1)}
    config = ROOT / "examples" / "cluster" / "haproxy.cfg"
    process = subprocess.Popen(["haproxy", "-f", config], env={**os.environ, "LISTEN": listen, **names})
    try:
        with httpx.Client(transport=httpx.HTTPTransport(retries=8), timeout=20) as first:
            first.get(f"http://{listen}/readyz")
        yield f"http://{listen}"
    finally:
        process.terminate()
        process.wait()


@pytest.mark.parametrize(
    ("method", "path", "headers", "is_repeated"),
    [
        ("GET", "/obs?after=3&wait=1", {}, True),
        ("POST", "/act?wait=60", {}, True),
        ("POST", "/swarm/act", {}, True),
        ("POST", "/api/v1/episodes", {"idempotency-key": "one"}, True),
        ("POST", "/api/v1/episodes", {}, False),
        ("DELETE", "/api/v1/runs/run_1", {}, False),
    ],
)
def test_the_load_balancer_repeats_what_may_be_repeated(
    method: str, path: str, headers: dict[str, str], is_repeated: bool
) -> None:
    with standin(dies=True) as (dead, lost), standin(dies=False) as (alive, done), balancer(alive, dead, alive) as url:
        # Requests go to the servers in turn, until one reaches the server that dies.
        for token in range(1000):
            del lost[:], done[:]
            answer = httpx.request(method, url + path, headers={**headers, "authorization": f"Bearer {token}"})
            if lost:
                break
        assert set(lost) == {f"{method} {path}"}
        if is_repeated:
            assert (answer.status_code, done) == (200, [f"{method} {path}"])
            return
        assert (answer.status_code, len(lost), done) == (502, 1, [])
        error = error_of("it", answer.status_code, answer.headers, answer.content)
        assert isinstance(error, ApiError)
        assert error.is_temporary
        assert (error.code, error.retry_after_s) == ("unavailable", 1.0)


def test_the_load_balancer_says_that_no_server_is_ready() -> None:
    with balancer(*["127.0.0.1:1"] * 3) as url:
        until = time.monotonic() + 20
        answer = httpx.get(f"{url}/obs")
        while answer.status_code != 503 and time.monotonic() < until:
            answer = httpx.get(f"{url}/obs")
        error = error_of("it", answer.status_code, answer.headers, answer.content)
        assert isinstance(error, ApiError)
        assert (error.code, error.status) == ("unavailable", 503)
