"""Checks `ppo.py` and `play.py` of examples/training with PyTorch; see `.ci/learner`."""

import csv
import re
import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[1] / "examples" / "training"


def run(script: str, *given: str) -> str:
    """What a script of the examples prints."""
    command = [sys.executable, str(EXAMPLES / script), *given]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def learned(steps: int, out: str) -> list[dict[str, str]]:
    """The curve of a training, without the times."""
    run("ppo.py", "--task", "Synchronization", "--seed", "1", "--steps", str(steps), "--out", out)
    with Path(out, "curve.csv").open(newline="") as file:
        return [{name: cell for name, cell in row.items() if not name.endswith("_s")} for row in csv.DictReader(file)]


first, again = (learned(200_000, out) for out in ("first", "again"))
assert first == again, (first, again)  # noqa: S101

# Measured with this seed: 87 at the end of the training and 92 on the board, where random acts score 0.
scores = [float(row["score"]) for row in learned(2_000_000, "learned")]
print("score while it learns:", *(f"{score:.1f}" for score in scores[::5]))
assert scores[-1] > 50, scores  # noqa: S101
board = run("play.py", "learned/policy.pt", "--seeds", "0..4", "--beside", "random", "--db", "learned.db")
print(board)
means = {model: float(mean) for model, mean in re.findall(r"^  (\S+) +([\d.]+) ", board, re.MULTILINE)}
assert means["ppo"] > means["built-in/random"] + 50, means  # noqa: S101
