"""The adapter for OpenEnv: `openenv validate` of the package and of a running server, and sessions at the same time."""

import asyncio
import re
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from model import reply

from swarmseat import TextEpisode
from swarmseat.openenv import SwarmAction, SwarmClient

PACKAGE = Path(__file__).resolve().parents[4] / "examples" / "training" / "for_openenv"
PAGE = PACKAGE.parents[2] / "docs" / "play" / "frameworks.md"
PORT = 18_765
SESSIONS = 24


@contextmanager
def served(*command: str, folder: Path | None = None) -> Iterator[str]:
    """A server with the package or with `python -m swarmseat.openenv`."""
    process = subprocess.Popen([sys.executable, "-m", *command], cwd=folder, stderr=subprocess.DEVNULL)
    address = f"http://127.0.0.1:{PORT}"
    try:
        for _ in range(300):
            try:
                urllib.request.urlopen(f"{address}/health", timeout=1).close()
                break
            except OSError:
                assert process.poll() is None, "the server has ended"
                time.sleep(0.1)
        yield address
    finally:
        process.terminate()
        process.wait()


def validate(*options: str) -> None:
    command = [str(Path(sys.executable).with_name("openenv")), "validate", *options]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    print(ran.stdout, end="")
    assert ran.returncode == 0, ran.stderr


async def play(address: str, seed: int) -> tuple[float, float, int]:
    """Plays an episode over a session. Returns the sum of its rewards, its score, and its seed."""
    async with SwarmClient(base_url=address) as client:
        seen = await client.reset(seed=seed)
        total = 0.0
        while not seen.done:
            seen = await client.step(SwarmAction(response=reply(seen.observation.prompt)))
            assert seen.reward is not None
            total += seen.reward
        state = await client.state()
        return total, seen.observation.score, state.seed or 0


def expected(seed: int) -> float:
    episode = TextEpisode("Foraging", "one_seat", max_round=10)
    turn = episode.reset(seed)
    while not turn.done:
        turn = episode.step(reply(turn.prompt))
    return turn.score


async def play_all(address: str) -> None:
    seeds = [27, 42] * (SESSIONS // 2)
    begun = time.monotonic()
    ends = await asyncio.gather(*(play(address, seed) for seed in seeds))
    took = time.monotonic() - begun
    for seed, (total, score, told) in zip(seeds, ends, strict=True):
        assert told == seed
        assert score == expected(seed)
        assert abs(total - min(score / 4, 1)) < 1e-6, (total, score)
    print(f"{SESSIONS} sessions at the same time: {SESSIONS * 10 / took:.0f} steps a second")


def main() -> None:
    validate(str(PACKAGE), "--level", "static", "--skip-build")
    with served("uvicorn", "server.app:app", "--port", str(PORT), "--log-level", "warning", folder=PACKAGE) as address:
        validate("--url", address)
    with served("swarmseat.openenv", "--max-round", "10", "--port", str(PORT)) as address:
        asyncio.run(play_all(address))
        (block,) = re.findall(r"^```py\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
        exec(compile(block.replace(":8000", f":{PORT}"), str(PAGE), "exec"), {})
        splits = urllib.request.urlopen(f"{address}/swarmbench/splits").read()
        print(splits.decode())


if __name__ == "__main__":
    main()
