"""Servers of one's own start, report what is wrong, and never outlive the program that needed them."""

import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import httpx
import pytest

from swarmseat import Server, ServerError
from swarmseat.server import find_binary

BINARY = find_binary()
GONE_S_MAX = 20


def children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def is_gone(pidfd: int) -> bool:
    """Whether a process ends; the descriptor becomes readable when it does."""
    readable, _, _ = select.select([pidfd], [], [], GONE_S_MAX)
    os.close(pidfd)
    return bool(readable)


def family(parent: int) -> tuple[int, int, Path]:
    """Descriptors of the keeper and of the server that a process has started, and the directory of that server."""
    (keeper,) = children(parent)
    (server,) = children(keeper)
    directory = Path(Path(f"/proc/{keeper}/cmdline").read_bytes().split(b"\0")[5].decode())
    assert directory.is_dir()
    return os.pidfd_open(keeper), os.pidfd_open(server), directory


def test_a_server_runs_as_long_as_its_block() -> None:
    before = children(os.getpid())
    with Server() as server, server.client() as client:
        assert client.health()["status"] == "ok"
        assert server.is_running
        assert len(children(os.getpid())) == len(before) + 1
        url = server.url
        with Server() as other:
            assert other.url != url
    assert "stopped" in repr(server)
    assert children(os.getpid()) == before
    with pytest.raises(httpx.ConnectError):
        httpx.get(url)
    with pytest.raises(ServerError, match="not started"):
        _ = server.url


def test_its_temporary_database_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with Server():
        assert list(tmp_path.glob("*/swarmbench.db"))
    assert not list(tmp_path.iterdir())


def test_a_database_of_ones_own_is_kept(tmp_path: Path) -> None:
    db = tmp_path / "mine.db"
    server = Server(db=db)
    for games in range(2):
        with server, server.client() as client:
            assert len(client.episodes()["items"]) == games
            client.create_episode(task="Foraging")
    assert db.exists()


def test_settings_of_another_server_are_not_for_this_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SWARMBENCH_DB", str(tmp_path / "no" / "such" / "directory.db"))
    monkeypatch.setenv("SWARMBENCH_PRIVATE", "true")
    monkeypatch.setenv("RUST_LOG", "off")
    with Server() as server, server.client() as client:
        assert client.episodes()["items"] == []


def test_why_it_does_not_start_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(ServerError, match="--no-such-option"):
        Server(arguments=("--no-such-option",)).start()
    with pytest.raises(ServerError, match="does not start"):
        Server(db=tmp_path / "no" / "such" / "directory.db").start()
    assert not list(tmp_path.iterdir())


def test_how_to_build_it_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ServerError, match="cargo build"):
        Server(binary=tmp_path / "swarmbench").start()
    monkeypatch.setenv("SWARMBENCH_BINARY", str(tmp_path / "swarmbench"))
    with pytest.raises(ServerError, match="SWARMBENCH_BINARY"):
        Server().start()


def test_where_it_is_looked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SWARMBENCH_BINARY", raising=False)
    monkeypatch.delenv("CARGO_TARGET_DIR", raising=False)
    checkout = tmp_path / "checkout"
    (checkout / "crates" / "engine").mkdir(parents=True)
    (checkout / "docs").mkdir()
    monkeypatch.chdir(checkout / "docs")
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setattr("swarmseat.server.__file__", str(tmp_path / "site-packages" / "swarmseat" / "server.py"))
    with pytest.raises(ServerError, match="cargo build --release"):
        find_binary()
    # Places from the last to the first: each comes before the one that was found.
    places = [checkout / "target" / build / "swarmbench" for build in ("debug", "release")]
    for place in [*places, tmp_path / "bin" / "swarmbench"]:
        place.parent.mkdir(parents=True)
        shutil.copy("/bin/true", place)
        assert find_binary() == place
    monkeypatch.setenv("SWARMBENCH_BINARY", "/bin/false")
    assert find_binary() == Path("/bin/false")
    assert find_binary("/bin/true") == Path("/bin/true")


def test_a_command_of_another_package_is_not_the_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SWARMBENCH_BINARY", raising=False)
    scripts = tmp_path / "scripts"
    monkeypatch.setattr("sysconfig.get_path", lambda _: str(scripts))
    monkeypatch.setenv("PATH", f"{scripts}:{tmp_path / 'bin'}")
    own, on_path = scripts / "swarmbench", tmp_path / "bin" / "swarmbench"
    for place in (own, on_path):
        place.parent.mkdir()
        shutil.copy("/bin/true", place)
    assert find_binary() == own
    own.write_text("#!/usr/bin/env python3\nfrom swarmbench.cli import main\nmain()\n")
    assert find_binary() == on_path


PROGRAM = """
import os, sys, swarmseat
server = swarmseat.Server(sys.argv[1]).start()
print("ready", flush=True)
{end}
"""


def started(end: str) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-c", PROGRAM.format(end=end), str(BINARY)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    return process


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_it_ends_with_a_program_that_is_killed(number: signal.Signals) -> None:
    process = started("sys.stdin.read()")
    keeper, server, directory = family(process.pid)
    process.send_signal(number)
    process.communicate()
    assert is_gone(server)
    assert is_gone(keeper)
    assert not directory.exists()


@pytest.mark.parametrize("end", ["sys.exit(3)", "raise ValueError", "os._exit(0)", "del server; sys.stdin.read()"])
def test_it_ends_with_a_program_that_ends(end: str) -> None:
    process = started("sys.stdin.read(1); " + end)
    keeper, server, directory = family(process.pid)
    assert process.stdin is not None
    process.stdin.write(b"x")
    process.stdin.flush()
    # In the last case the program lives, and only closes its pipe to the server.
    assert is_gone(server)
    assert is_gone(keeper)
    process.communicate()
    assert not directory.exists()


def test_a_fork_that_ends_leaves_it_alone_and_one_that_lives_on_does_not_keep_it() -> None:
    process = started(
        "if os.fork() == 0: sys.exit()\n"
        "os.wait()\n"
        "if os.fork() == 0: sys.stdin.read(); os._exit(0)\n"
        "print(server.client().health()['status'], flush=True)\n"
        "sys.stdin.read()"
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"ok\n"
    keeper = min(children(process.pid))
    server = os.pidfd_open(children(keeper)[0])
    process.kill()
    process.wait()
    # The second fork still has a copy of the pipe to the keeper.
    assert is_gone(server)
    process.stdin.close() if process.stdin else None
    process.stdout.close()


def test_ctrl_c_in_a_terminal_does_not_reach_it() -> None:
    with Server() as server, server.client() as client:
        keeper = children(os.getpid())[-1]
        assert os.getpgid(keeper) != os.getpgid(0)
        os.kill(keeper, signal.SIGINT)
        assert client.health()["status"] == "ok"
