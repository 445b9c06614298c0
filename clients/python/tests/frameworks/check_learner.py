"""Learns for half a minute with PyTorch, and plays the policy on a server: it scores far more than random acts."""

import re
import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[4] / "examples" / "training"


def run(script: str, *given: str) -> str:
    command = [sys.executable, str(EXAMPLES / script), *given]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


run("ppo.py", "--task", "Synchronization", "--minutes", "0.5", "--time", "processor", "--out", "learned")
board = run("play.py", "learned/policy.pt", "--seeds", "0..4", "--beside", "random", "--db", "learned.db")
print(board)
scores = {model: float(score) for model, score in re.findall(r"^  (\S+) +([\d.]+) ", board, re.MULTILINE)}
assert scores["ppo"] > 20 > scores["built-in/random"], scores
