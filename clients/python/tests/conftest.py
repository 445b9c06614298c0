"""A server for all tests. SWARMBENCH_BINARY names the program under test. Default: that of the checkout."""

import itertools
import os
import subprocess
from collections.abc import Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest

from swarmseat import Client, Server
from swarmseat.server import find_binary

ROOT = Path(os.environ.get("SWARMBENCH_ROOT", Path(__file__).resolve().parents[3]))


@pytest.fixture(scope="session", autouse=True)
def _environment() -> None:
    """Removes the variables that the user has set for servers of their own."""
    for name in list(os.environ):
        if name.startswith("SWARMBENCH_") and name != "SWARMBENCH_BINARY":
            del os.environ[name]


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    with Server() as server:
        yield server


@pytest.fixture
def client(server: Server) -> Iterator[Client]:
    with server.client() as client:
        yield client


class Cup:
    """A competition that is open: two attempts of two small games."""

    def __init__(self, url: str, organizer: str) -> None:
        self.url = url
        self._names = (f"team {number}" for number in itertools.count())
        now = datetime.now(timezone.utc)
        asked: dict[str, Any] = {
            "name": "a cup",
            "opens_at": now.isoformat(),
            "closes_at": (now + timedelta(hours=1)).isoformat(),
            "suite": {
                "tasks": ["Synchronization", "Pursuit"],
                "seeds": 1,
                "settings": {"num_agents": 2, "max_round": 3},
            },
            "clocks": {"round_deadline_s": 600},
            "attempts": 2,
            "parallel": 2,
            "board": "hidden",
        }
        with Client(url, organizer) as client:
            self.id: str = client.request("POST", "/api/v1/competitions", body=asked)["id"]

    def enter(self) -> str:
        """Enters a new entrant, and returns its key."""
        entry = {"name": next(self._names), "model": "by hand"}
        with Client(self.url, "") as client:
            made: dict[str, str] = client.request("POST", f"/api/v1/competitions/{self.id}/entrants", body=entry)
        return made["key"]


@pytest.fixture(scope="session")
def cup(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cup]:
    db = tmp_path_factory.mktemp("cup") / "swarmbench.db"
    command = [str(find_binary()), "key", "create", "--name", "o", "--role", "organizer", "--db", str(db)]
    made = subprocess.run(command, check=True, capture_output=True, text=True)
    with Server(db=db) as server:
        yield Cup(server.url, made.stdout.strip())
