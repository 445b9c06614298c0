"""Runs a server for another program, and ends the server when that program is gone, however it ended.

This file is a program of its own (`python -I keeper.py PARENT DIRECTORY COMMAND…`) and must not import the package.
The keeper stops the server when the keeper's standard input is closed, which happens at the latest when the parent
dies, or when the keeper has another parent: a copy of the pipe may survive in some child of the parent. Then the keeper
removes DIRECTORY. If the server ends by itself the directory stays, as the log there says why.
"""

import os
import select
import shutil
import signal
import subprocess
import sys

STOP_S_MAX = 12.0
"""The maximum time to wait for the server to stop: a server stops within 10 seconds."""
LOOK_S = 0.5
"""The interval between checks of the parent's id, if only that shows that the parent died."""


def main() -> int:
    """Runs until the parent or the server is gone."""
    parent, directory, command = int(sys.argv[1]), sys.argv[2], sys.argv[3:]
    for unwanted in (signal.SIGINT, signal.SIGHUP):
        signal.signal(unwanted, signal.SIG_IGN)
    # SIGTERM ends the wait below, and with it the server.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    server = subprocess.Popen(command, stdin=subprocess.DEVNULL)
    try:
        while os.getppid() == parent:
            if server.poll() is not None:
                return server.returncode
            readable, _, _ = select.select([sys.stdin], [], [], LOOK_S)
            if readable and not os.read(sys.stdin.fileno(), 1):
                break
    finally:
        if server.poll() is None:
            server.terminate()
            try:
                server.wait(STOP_S_MAX)
            except subprocess.TimeoutExpired:
                server.kill()
                server.wait()
    shutil.rmtree(directory, ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
