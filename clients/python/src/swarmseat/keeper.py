"""Keeps a server for another program, and ends it when that program is gone, however it went.

This file is run by itself (`python -I keeper.py PARENT DIRECTORY COMMAND…`) and must not import the package. It stops
the server when its standard input is closed, which happens at the latest when the parent dies, or when its parent is
another one: a copy of the pipe may live on in some child of the parent. Then it removes DIRECTORY. Where the server
ends by itself the directory stays, as the log in it says why.
"""

import os
import select
import shutil
import signal
import subprocess
import sys

STOP_S_MAX = 12.0
"""A server stops within 10 seconds."""
LOOK_S = 0.5
"""How long a server lives on where only its parent's id shows that the parent died."""


def main() -> int:
    """Runs until the parent is gone, or the server."""
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
