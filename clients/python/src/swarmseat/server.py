"""A server of one's own, for as long as a program needs it."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
import weakref
from pathlib import Path
from types import TracebackType

from ._compat import Self
from .client import AsyncClient, Client
from .errors import ServerError
from .exchange import Retry

START_S_MAX = 30.0
"""The maximum time until a server is ready."""
STOP_S_MAX = 15.0
"""The maximum time until the keeper has ended: longer than the keeper gives the server."""

HOW_TO_BUILD = (
    "the program `swarmbench` was not found. Install a wheel that has it (bindings/python/build makes one), or build "
    "it in a checkout of the repository with `cargo build --release`, "
    "and name it: Server(binary='target/release/swarmbench'), or SWARMBENCH_BINARY in the environment, or put it on "
    "the PATH"
)


class Server:
    """A server on a free port of this machine.

    The server runs as long as the `with` block, or from `start()` to `stop()`. It ends with this program, even if the
    program is killed. For Linux and macOS.

    Args:
        binary: The program. Default: `SWARMBENCH_BINARY`, then the program of this installation (in its wheel), then
            `swarmbench` on the `PATH`, then `target/release` and `target/debug` of the checkout in which the working
            directory or this package is (or the folders of `CARGO_TARGET_DIR` in their place).
        db: The database, which is kept. Default: a temporary one, which is removed at the end.
        arguments: Further arguments of `swarmbench serve`.
    """

    def __init__(
        self,
        binary: str | os.PathLike[str] | None = None,
        db: str | os.PathLike[str] | None = None,
        *,
        arguments: tuple[str, ...] = (),
    ) -> None:
        self._binary = binary
        self._db = db
        self._arguments = arguments
        self._url: str | None = None
        self._finalizer: weakref.finalize[[int, subprocess.Popen[bytes], Path], Server] | None = None

    @property
    def url(self) -> str:
        """The address of the server, once it is started."""
        if self._url is None:
            raise ServerError("the server is not started: use it in a `with` block, or call start()")
        return self._url

    @property
    def is_running(self) -> bool:
        """Whether the server was started and not stopped."""
        return self._url is not None

    def client(self) -> Client:
        """A client for the server, without a token."""
        return Client(self.url, token="")

    def async_client(self) -> AsyncClient:
        """A client for the server in asyncio, without a token."""
        return AsyncClient(self.url, token="")

    def start(self) -> Self:
        """Starts the server, and returns once it is ready."""
        if self.is_running:
            return self
        binary = find_binary(self._binary)
        directory = Path(tempfile.mkdtemp(prefix="swarmbench-"))
        log = directory / "server.log"
        db = directory / "swarmbench.db" if self._db is None else Path(self._db)
        command = [str(binary), "serve", "--addr", "127.0.0.1:0", "--db", str(db), "--log-format", "json"]
        keeper = [sys.executable, "-I", "-S", str(Path(__file__).with_name("keeper.py")), str(os.getpid())]
        # Only the server's address and its warnings are logged; a long training would fill the disk otherwise.
        # Variables of the environment may be settings of another server.
        environment = {name: value for name, value in os.environ.items() if not name.startswith("SWARMBENCH_")}
        environment["RUST_LOG"] = "warn,swarmbench::cli::serve=info"
        with log.open("wb") as written:
            process = subprocess.Popen(
                [*keeper, str(directory), *command, *self._arguments],
                stdin=subprocess.PIPE,
                stdout=written,
                stderr=written,
                env=environment,
                # Ctrl-C in a terminal reaches this program only, which then stops the server in order.
                start_new_session=True,
            )
        self._finalizer = weakref.finalize(self, _stop, os.getpid(), process, directory)
        try:
            self._url = _address(process, log)
            # A database with many unfinished games takes a while.
            with Client(self._url, token="", retry=Retry(times=1000, patience_s=START_S_MAX)) as client:
                client.ready()
        except BaseException:
            self.stop()
            raise
        return self

    def stop(self) -> None:
        """Stops the server, and returns once it has ended. Does nothing if no server runs."""
        self._url = None
        if self._finalizer is not None:
            self._finalizer()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.stop()

    def __repr__(self) -> str:
        return f"Server({self._url or 'stopped'!r})"


def find_binary(named: str | os.PathLike[str] | None = None) -> Path:
    """The program: the named one, or the first that is found in the places that `Server` lists."""
    named = named or os.environ.get("SWARMBENCH_BINARY")
    if named is not None:
        path = Path(named).expanduser()
        if not path.is_file():
            raise ServerError(f"there is no program at {path}: {HOW_TO_BUILD}")
        return path.absolute()
    own, searched = Path(sysconfig.get_path("scripts")) / "swarmbench", os.get_exec_path()
    if own.is_file():
        if not _is_script(own):
            return own
        searched = [folder for folder in searched if Path(folder) != own.parent]
    on_path = shutil.which("swarmbench", path=os.pathsep.join(searched))
    if on_path is not None:
        return Path(on_path)
    for start in (Path.cwd(), Path(__file__).resolve().parent):
        for directory in (start, *start.parents):
            # A checkout of this project, not just any directory called target.
            if (directory / "crates" / "engine").is_dir():
                target = directory / os.environ.get("CARGO_TARGET_DIR", "target")
                for build in ("release", "debug"):
                    path = target / build / "swarmbench"
                    if path.is_file():
                        return path
    raise ServerError(HOW_TO_BUILD)


def _is_script(path: Path) -> bool:
    """Whether pip made the file for a package: another project's package `swarmbench` has a command of this name."""
    with path.open("rb") as program:
        return program.read(2) == b"#!"


def _address(process: "subprocess.Popen[bytes]", log: Path) -> str:
    """The address at which the server listens, from its log."""
    deadline = time.monotonic() + START_S_MAX
    said = ""
    while time.monotonic() < deadline:
        is_alive = process.poll() is None
        if log.exists():
            said = log.read_text("utf-8", "replace") or said
        for line in said.splitlines(keepends=True):
            if line.endswith("\n") and line.startswith("{"):
                address = json.loads(line).get("addr")
                if address is not None:
                    return f"http://{address}"
        if not is_alive:
            raise ServerError(f"the server does not start: {said.strip() or 'it said nothing'}")
        time.sleep(0.01)
    raise ServerError(f"the server does not start within {START_S_MAX:.0f} s: {said.strip()}")


def _stop(owner: int, process: "subprocess.Popen[bytes]", directory: Path) -> None:
    # A forked process has a copy of this object, and must not end its parent's server.
    if os.getpid() != owner:
        return
    if process.stdin is not None:
        process.stdin.close()
    try:
        process.wait(STOP_S_MAX)
    except subprocess.TimeoutExpired:
        process.terminate()
        process.wait()
    # The keeper removed the folder, unless the server had ended by itself.
    shutil.rmtree(directory, ignore_errors=True)
