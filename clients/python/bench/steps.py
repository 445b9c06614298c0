"""The steps per second of an environment on a server of its own: `python bench/steps.py [--steps 1000]`.

`TMPDIR=/dev/shm` puts the database into memory. `SWARMBENCH_BINARY` names the program, which should be a release build.
"""

import argparse
import re
import time
from typing import Any

import swarmseat
from swarmseat.exchange import call

SETTINGS: list[dict[str, Any]] = [
    {},
    {"memory": 0},
    {"observations": "text"},
    {"memory": 0, "num_agents": 1},
]


def commits(client: swarmseat.Client) -> float:
    """The total duration of the server's commits, in seconds."""
    metrics = client.send(call("GET", "/metrics", read=bytes.decode))
    found = re.search(r"^swarmbench_commit_seconds_sum (\S+)$", metrics, re.MULTILINE)
    return float(found[1]) if found else 0.0


def measure(server: swarmseat.Server, steps: int, settings: dict[str, Any]) -> None:
    """Plays random acts, and prints the duration of a step."""
    env = swarmseat.parallel_env("Foraging", seed=27, server=server, **settings)
    env.reset()
    with server.client() as client:
        rounds = [{agent: env.action_space(agent).sample() for agent in env.possible_agents} for _ in range(100)]
        on_disk_s, processor_s, begin_s = commits(client), time.process_time(), time.perf_counter()
        for step in range(steps):
            if not env.agents:
                env.reset()
            env.step(rounds[step % 100])
        wall_s, processor_s = time.perf_counter() - begin_s, time.process_time() - processor_s
        on_disk_s = commits(client) - on_disk_s
    env.close()
    parts = f"of {1000 * wall_s / steps:.2f} ms: commit {1000 * on_disk_s / steps:.2f}"
    print(f"{settings} {steps / wall_s:.0f} steps/s; {parts}, Python {1000 * processor_s / steps:.2f}")


def main() -> None:
    """Measures all settings."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--steps", type=int, default=1000)
    steps = arguments.parse_args().steps
    with swarmseat.Server() as server:
        measure(server, steps // 5, {})  # warms everything up
        for settings in SETTINGS:
            measure(server, steps, settings)


if __name__ == "__main__":
    main()
