"""A server for all tests. Which program is tested says SWARMBENCH_BINARY, or else it is that of the checkout."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmbench import Client, Server

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="session", autouse=True)
def _environment() -> None:
    """What whoever runs the tests has set for servers of their own is not for these."""
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
