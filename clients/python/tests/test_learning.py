"""`examples/training/play.py` plays policies of `ppo.py` on a server. Without PyTorch a stand-in plays the policy."""

import importlib
import sys
from pathlib import Path

import pytest
import standins
from conftest import ROOT

from swarmseat import Server

# The actions of a task with a map and no flag, and of one with a flag and no map.
ACTIONS = {"Pursuit": 5, "Synchronization": 6}


@pytest.mark.parametrize("task", ACTIONS)
def test_a_saved_policy_plays_a_suite_and_is_on_its_board(
    task: str, server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "examples" / "training"))
    standins.torch()
    torch, ppo, play = (importlib.import_module(name) for name in ("torch", "ppo", "play"))
    policy = ppo.Policy(ppo.Senses(task, ppo.AGENTS).size, ACTIONS[task])
    file = tmp_path / "policy.pt"
    torch.save({"task": task, "seed": 1, "spent": (0.0, 0.0, 0, 0), "policy": policy.state_dict()}, file)
    given = ["--seeds", "0..1", "--beside", "random", "--server", server.url]
    monkeypatch.setattr(sys, "argv", ["play.py", str(file), *given])
    play.main()
    said = capsys.readouterr().out
    for model in ("ppo", "built-in/random"):
        assert any(line.split()[0] == model and "1 games" in line for line in said.splitlines() if line.strip()), said
