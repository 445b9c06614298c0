"""The minimal agents of `examples/agents` play seats to the end, and well."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

from swarmseat import Client, Server, wire

AGENTS = ROOT / "examples" / "agents"
PROGRAMS = {"minimal.py": [sys.executable], "minimal.sh": ["bash"], "minimal.mjs": ["node"]}
NEEDED = {"minimal.py": [], "minimal.sh": ["bash", "curl", "jq"], "minimal.mjs": ["node"]}


@pytest.fixture(params=sorted(PROGRAMS))
def agent(request: pytest.FixtureRequest) -> Path:
    missing = [program for program in NEEDED[request.param] if shutil.which(program) is None]
    # Not skipped: an example that nobody ran is not known to work.
    assert not missing, f"install {' and '.join(missing)} for this test, on Debian: apt-get install jq nodejs curl"
    return AGENTS / str(request.param)


def play(agent: Path, server: Server, created: wire.CreatedEpisode) -> list[str]:
    """What the agents said at the end, each of which played a seat."""
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
    # On this layout it walks past the food, and then past the nest.
    created = client.create_episode(task="Foraging", num_agents=1, max_round=30, seed=1)
    play(agent, server, created)
    assert client.episode(created["id"])["score"] == 1.0


def test_it_waits_for_holders_of_other_seats(agent: Path, server: Server, client: Client) -> None:
    created = client.create_episode(task="Synchronization", num_agents=2, max_round=3, open_seats=1, fill_after_s=0.5)
    (said,) = play(agent, server, created)
    assert said.startswith("Agent_0 finished")
