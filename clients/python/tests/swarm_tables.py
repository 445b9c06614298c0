"""Small tables like those of an export: games of agents that walk about, with made-up metrics."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from swarmseat.analysis.metrics import METRICS

TASKS = ("Foraging", "Pursuit")
MODELS = ("model-a", "model_b$1", "built-in/random")
AGENTS, ROUNDS, SIZE = 3, 12, 7
MOVES = {"UP": (-1, 0), "DOWN": (1, 0), "LEFT": (0, -1), "RIGHT": (0, 1), "STAY": (0, 0)}
MORE = (
    "direction_imbalance",
    "components",
    "separation",
    "homogeneity_increase",
    "edit_consistency_increase",
    "edit_consistency",
    "path_length",
)
NAMES = (*(metric.name for metric in METRICS), *MORE)

Tables = dict[str, pd.DataFrame]


def write(
    folder: Path,
    *,
    tasks: Iterable[str] = TASKS,
    models: Iterable[str] = MODELS,
    seeds: int = 6,
    kind: str = "parquet",
    change: Callable[[Tables], object] = lambda _: None,
) -> Path:
    """Writes the tables of a game for each task, model and seed. `change` may spoil them first."""
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in ("episodes", "rounds", "acts", "heard")}
    for task in tasks:
        for quality, model in enumerate(models):
            for seed in range(seeds):
                _play(rows, task, model, quality, seed)
    tables = {name: pd.DataFrame(own) for name, own in rows.items()}
    change(tables)
    folder.mkdir(parents=True, exist_ok=True)
    for name, table in tables.items():
        if kind == "parquet":
            table.to_parquet(folder / f"{name}.parquet", index=False)
        else:
            table.to_json(folder / f"{name}.jsonl", orient="records", lines=True)
    return folder


def _play(rows: dict[str, list[dict[str, Any]]], task: str, model: str, quality: int, seed: int) -> None:
    random = np.random.default_rng([TASKS.index(task) if task in TASKS else 9, quality, seed])
    episode = f"ep-{task}-{quality}-{seed}"
    head = {"episode": episode, "run": None, "task": task, "model": model, "seed": seed, "rules": "paper"}
    head |= {"control": "decentralized", "mixed": False}
    settings: dict[str, Any] = {
        "num_agents": AGENTS,
        "width": SIZE,
        "height": SIZE,
        "view_size": 3,
        "memory": 5,
        "max_round": ROUNDS,
    }
    settings |= {"noise": 0.0, "max_delay": 0, "prompt_template": None}
    values = {name: float(random.normal(quality, 1)) for name in NAMES}
    score, at = 0.0, [(1 + agent, 2) for agent in range(AGENTS)]
    said: list[str] = []
    for number in range(ROUNDS + 1):
        state = {**head, **settings, "round": number, "score": score, "grid": _grid(at)}
        rows["rounds"].append(state | {name: float(random.random()) if number else None for name in NAMES})
        if number == ROUNDS:
            break
        for receiver in range(AGENTS):
            for sender, text in enumerate(said):
                heard = {"round": number, "receiver": receiver, "sender": sender, "sent_round": number - 1}
                rows["heard"].append(head | heard | {"message": text, "own": sender == receiver})
        said = [f"agent {agent} of {model}, going {random.choice(list(MOVES))}?" for agent in range(AGENTS)]
        for agent, place in enumerate(list(at)):
            # Agents walk along the wall, so that the window determines the action.
            action = "RIGHT" if place[1] < SIZE - 2 else str(random.choice(["UP", "LEFT", "STAY"]))
            act = {"round": number, "agent": agent, "i": place[0], "j": place[1], "action": action}
            rows["acts"].append(head | act | {"message": said[agent], "valid": True})
            step = place[0] + MOVES[action][0], place[1] + MOVES[action][1]
            if 0 < step[0] < SIZE - 1 and 0 < step[1] < SIZE - 1 and step not in at:
                at[agent] = step
        score += float(random.integers(0, 2 + quality))
    ended: dict[str, Any] = {
        "agent_meta": json.dumps({"temperature": 0.5}),
        "status": "finished",
        "reason": "rounds_played",
    }
    ended |= {"score": score, "rounds": ROUNDS, "void_reason": None, "metrics_revision": 1, "embedder": "hash-1"}
    more = {f"{name}_rounds": ROUNDS for name in NAMES} | {f"toolkit_{metric.name}": 0.5 for metric in METRICS}
    rows["episodes"].append(head | settings | ended | values | more)


def _grid(at: list[tuple[int, int]]) -> str:
    edge = "W" * SIZE
    cells = [list(edge), *(list("W" + "." * (SIZE - 2) + "W") for _ in range(SIZE - 2)), list(edge)]
    for i, j in at:
        cells[i][j] = "a"
    return "\n".join("".join(row) for row in cells)
