"""The steps per second of environments in this process, compared with the engine alone in the same session.

    python bindings/python/bench.py [--seconds 1] [--turns 5] [--no-http]

The benchmark needs the wheel of a release build (`bindings/python/build`). All games have the standard setting with
memory 0 and random actions. Numbers are medians over the turns; everything that is measured runs once in each turn.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import numpy as np

import swarmseat
from swarmseat import _native
from swarmseat.native import VecEnv
from swarmseat.wire import TaskName

TASKS: tuple[TaskName, ...] = get_args(TaskName)
ENVIRONMENTS = 1024
AGENTS = 12

Measure = Callable[[float], tuple[float, float]]


def steps(task: TaskName, environments: int, threads: int, observations: str) -> Measure:
    env = VecEnv(task, environments, seed=1, threads=threads, copy=False, observations=observations)  # type: ignore[arg-type]
    env.reset()
    random = np.random.default_rng(1)
    turns = [random.integers(0, len(env.actions), (environments, AGENTS)) for _ in range(16)]
    for turn in turns:
        env.step(turn)

    def measure(seconds: float) -> tuple[float, float]:
        return timed(lambda place: env.step(turns[place % 16]), environments, seconds)

    return measure


def engine(task: TaskName) -> Measure:
    def measure(seconds: float) -> tuple[float, float]:
        return timed(lambda _: _native.play_engine(task, 256, 4), 4 * 256, seconds)

    return measure


def forks(task: TaskName) -> Measure:
    env = VecEnv(task, 1025, seed=1, threads=1, copy=False, observations="none")
    env.reset()
    random = np.random.default_rng(1)
    for _ in range(50):
        env.step(random.integers(0, len(env.actions), (1025, AGENTS)))
    targets = np.arange(1, 1025)

    def measure(seconds: float) -> tuple[float, float]:
        return timed(lambda _: env.fork(0, targets), 1024, seconds)

    return measure


def parallel(task: TaskName, backend: str) -> Measure:
    env = swarmseat.parallel_env(task, seed=1, memory=0, backend=backend)
    random = np.random.default_rng(1)
    turns = random.integers(0, len(env.actions), (16, AGENTS)).tolist()
    env.reset()

    def step(place: int) -> None:
        if not env.agents:
            env.reset()
        env.step(dict(zip(env.possible_agents, turns[place % 16], strict=True)))

    def measure(seconds: float) -> tuple[float, float]:
        return timed(step, 1, seconds)

    return measure


def prompts(task: TaskName) -> Measure:
    env = VecEnv(task, 1, seed=1, memory=5)
    env.reset()
    for _ in range(10):
        env.step(np.zeros((1, AGENTS), np.int64))

    def measure(seconds: float) -> tuple[float, float]:
        return timed(lambda place: env.prompt(0, place % AGENTS), 1, seconds)

    return measure


def memory(task: TaskName) -> float:
    """Bytes per environment, of 10,000 that have played an episode, with their arrays; in a process of its own."""
    program = f"import bench; bench.grown({task!r})"
    told = subprocess.run([sys.executable, "-c", program], cwd=Path(__file__).parent, check=True, capture_output=True)
    return float(told.stdout)


def grown(task: TaskName) -> None:
    before = resident()
    env = VecEnv(task, 10_000, seed=1, threads=1, copy=False)
    env.reset()
    turn = np.random.default_rng(1).integers(0, len(env.actions), (10_000, AGENTS))
    for _ in range(120):
        env.step(turn)
    print((resident() - before) / 10_000)


def resident() -> int:
    """Bytes of this process in memory."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()
    except FileNotFoundError:  # macOS, which only knows the maximum so far
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def timed(step: Callable[[int], object], each: int, seconds: float) -> tuple[float, float]:
    """Steps per second by the clock, and by processor time."""
    clock, used, count = time.perf_counter(), time.process_time(), 0
    while time.perf_counter() - clock < seconds:
        step(count)
        count += 1
    passed, used = time.perf_counter() - clock, time.process_time() - used
    return count * each / passed, count * each / max(used, 1e-9)


def main() -> None:
    parser = argparse.ArgumentParser(description="Steps a second of environments in this process.")
    parser.add_argument("--seconds", type=float, default=1.0, help="of each measurement")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--no-http", action="store_true", help="do not start a server to compare with")
    arguments = parser.parse_args()
    columns: dict[str, Callable[[TaskName], Measure]] = {
        "engine": engine,
        "1 thread": lambda task: steps(task, ENVIRONMENTS, 1, "planes"),
        "2 threads": lambda task: steps(task, ENVIRONMENTS, 2, "planes"),
        "symbols": lambda task: steps(task, ENVIRONMENTS, 1, "symbols"),
        "one environment": lambda task: steps(task, 1, 1, "planes"),
        "parallel_env": lambda task: parallel(task, "native"),
        "forks": forks,
        "prompts": prompts,
    }
    if not arguments.no_http:
        columns["over HTTP"] = lambda task: parallel(task, "http")
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; environment steps a second by the clock")
    print("| task | " + " | ".join(columns) + " | share of the engine (processor time) | memory |")
    print("| --- |" + " ---: |" * (len(columns) + 2))
    for task in TASKS:
        measures = {name: make(task) for name, make in columns.items()}
        rates: dict[str, list[tuple[float, float]]] = {name: [] for name in columns}
        for _ in range(arguments.turns):
            for name, measure in measures.items():
                rates[name].append(measure(arguments.seconds))
        clock = {name: statistics.median(rate for rate, _ in found) for name, found in rates.items()}
        used = {name: statistics.median(rate for _, rate in found) for name, found in rates.items()}
        cells = " | ".join(f"{rate:,.0f}" for rate in clock.values())
        print(
            f"| {task} | {cells} | {100 * used['1 thread'] / used['engine']:.0f} % | {memory(task) / 1000:.1f} kB |",
            flush=True,
        )


if __name__ == "__main__":
    main()
