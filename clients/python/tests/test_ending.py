"""Environments that are closed, and environments that are not."""

import gc
import os
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest

from swarmseat import Client, Server, SwarmbenchError, SwarmEnv, parallel_env


def begun(server: Server | Client | str, model: str) -> SwarmEnv:
    env = parallel_env(num_agents=2, max_round=5, server=server, model=model)
    env.reset(seed=1)
    env.step({"Agent_0": 0, "Agent_1": 1})
    return env


def states(client: Client, model: str) -> list[str]:
    return [episode["status"] for episode in client.paginate(client.episodes, model=model)]


def test_a_with_block_closes_it(server: Server, client: Client) -> None:
    with begun(server, "a block") as env:
        assert states(client, "a block") == ["running"]
    assert states(client, "a block") == ["aborted"]
    with pytest.raises(SwarmbenchError, match=r"closed: reset\(\)"):
        env.step({"Agent_0": 0, "Agent_1": 1})
    with pytest.raises(SwarmbenchError, match=r"closed: reset\(\)"):
        env.state()
    env.close()


@pytest.mark.parametrize("kind", ["address", "server", "client"])
def test_one_that_is_collected_ends_its_episode_and_warns(server: Server, client: Client, kind: str) -> None:
    kinds: dict[str, str | Server | Client] = {"address": server.url, "server": server, "client": client}
    envs = [begun(kinds[kind], f"collected {kind}")]
    gc.collect()
    with pytest.warns(ResourceWarning, match=r"unclosed environment parallel_env\('Foraging'\): call close") as told:
        envs.clear()
    # The environment's sockets were closed, and cause no warning of their own.
    assert len(told) == 1
    assert states(client, f"collected {kind}") == ["aborted"]
    assert client.health()["status"] == "ok"


def test_nothing_is_said_where_there_is_nothing_to_give_back(server: Server, client: Client) -> None:
    closed, never = begun(server, "closed"), parallel_env(server=server)
    closed.close()
    ended = begun(client, "ended")
    while ended.agents:
        ended.step({"Agent_0": 0, "Agent_1": 1})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        del closed, never, ended
        gc.collect()
    assert states(client, "ended") == ["finished"]


def test_closing_does_not_wait_for_a_server_that_is_gone() -> None:
    with Server() as server:
        env = begun(server.url, "left alone")
    began = time.monotonic()
    env.close()
    assert time.monotonic() - began < 2


PROGRAM = """
import os, sys, swarmseat
print(os.environ.get("URL"))
env = swarmseat.parallel_env(num_agents=2, max_round=5, model="a program", server=os.environ.get("URL"))
env.reset()
own = env._resources._own_server
print("server", own.url if own else None, own._finalizer.peek()[2][2] if own else None)
"""


def run(ending: str, *, url: str | None = None, options: tuple[str, ...] = ()) -> "subprocess.CompletedProcess[str]":
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONWARNINGS"}
    if url is not None:
        environment["URL"] = url
    command = [sys.executable, *options, "-c", PROGRAM + ending]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize(("ending", "status"), [
    ("", 0), ("sys.exit(3)", 3), ("other = env; other.me = other; del env, other", 0),
], ids=["at the end", "at an exit", "in a cycle"])  # fmt: skip
def test_a_program_that_does_not_close_ends_in_silence(
    client: Client, server: Server, ending: str, status: int
) -> None:
    ended = run(ending, url=server.url)
    assert (ended.returncode, ended.stderr) == (status, "")
    assert set(states(client, "a program")) == {"aborted"}


def test_with_warnings_it_is_said_once(client: Client, server: Server) -> None:
    ended = run("", url=server.url, options=("-X", "dev"))
    assert ended.returncode == 0
    assert ended.stderr.count("unclosed") == 1, ended.stderr
    assert "Traceback" not in ended.stderr
    assert set(states(client, "a program")) == {"aborted"}


def test_a_server_of_its_own_ends_with_the_program() -> None:
    ended = run("")
    assert (ended.returncode, ended.stderr) == (0, "")
    _, url, directory = ended.stdout.splitlines()[-1].split()
    assert not Path(directory).exists()
    with pytest.raises(SwarmbenchError, match="no answer"):
        Client(url, token="").health()


def test_an_error_of_the_program_is_the_only_one_that_is_shown(server: Server) -> None:
    ended = run("raise KeyError('mine')", url=server.url)
    assert ended.returncode == 1
    assert ended.stderr.count("Traceback") == 1
    assert ended.stderr.endswith("KeyError: 'mine'\n")


def test_a_server_that_is_gone_does_not_delay_the_end() -> None:
    ending = """
theirs = swarmseat.Server().start()
other = swarmseat.parallel_env(num_agents=1, server=theirs.url)
other.reset()
theirs.stop()
import time
began = time.monotonic()
import atexit
atexit._run_exitfuncs()
print(time.monotonic() - began)
"""
    ended = run(ending)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert float(ended.stdout.splitlines()[-1]) < 5


def test_a_copy_in_another_process_ends_nothing(server: Server) -> None:
    ending = """
child = os.fork()
if not child:
    del env
    import gc; gc.collect()
    os._exit(0)
os.waitpid(child, 0)
print(swarmseat.Client(os.environ["URL"], "").episode(env.episode)["status"])
env.close()
"""
    ended = run(ending, url=server.url)
    assert (ended.stderr, ended.stdout.splitlines()[-1]) == ("", "running")
