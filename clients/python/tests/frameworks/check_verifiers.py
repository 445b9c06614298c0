"""The adapter for verifiers, played by `vf-eval` itself against an endpoint on this machine."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from model import reply, served

from swarmseat import TextEpisode
from swarmseat.rewards import full_score
from swarmseat.server import find_binary

ROUNDS, AGENTS = 4, 5


def evaluate(folder: Path, endpoint: str, *options: str) -> list[dict[str, Any]]:
    """The episodes of an evaluation."""
    command = [
        str(Path(sys.executable).with_name("vf-eval")), "swarmseat-verifiers", "-m", "stand-in", "--no-push",
        "--client.base-url", endpoint, "--client.api-key-var", "STAND_IN_KEY", "--output-dir", str(folder),
        "--env.taskset.num-seeds", "2", "--env.taskset.first-seed", "27",
        "--env.taskset.settings.max-round", str(ROUNDS), "--env.taskset.settings.num-agents", str(AGENTS), *options,
    ]  # fmt: skip
    ran = subprocess.run(
        command, env={**os.environ, "STAND_IN_KEY": "none"}, capture_output=True, text=True, timeout=300, check=False
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    (traces,) = folder.glob("**/traces.jsonl")
    return [json.loads(line) for line in traces.read_text().splitlines()]


def expected(task: Any, seed: int, **options: Any) -> TextEpisode:
    """Plays the same game without the framework."""
    episode = TextEpisode(task, num_agents=AGENTS, max_round=ROUNDS, **options)
    turn = episode.reset(seed)
    while not turn.done:
        texts = {agent: reply(prompt) for agent, prompt in turn.prompts.items()}
        turn = episode.step(dict(texts) if episode.mode == "seats" else texts[turn.asked[0]])
    return episode


def main() -> None:
    with served() as (endpoint, requests), tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        journals = folder / "journals"
        episodes = evaluate(
            folder / "seats", endpoint, "--env.taskset.game", "Foraging", "-n", "2", "--env.journals", str(journals)
        )
        assert len(episodes) == 2, len(episodes)
        for line in episodes:
            assert len(line["traces"]) == AGENTS
            for place, trace in enumerate(sorted(line["traces"], key=lambda one: one["info"]["swarmbench"]["agent"])):
                told = trace["info"]["swarmbench"]
                game = expected("Foraging", told["seed"])
                assert told["digest"] == game.world.world_digest(0)
                assert told["agent"] == f"Agent_{place}"
                assert trace["rewards"]["team"]["score"] == game.earned[place] / full_score("Foraging", AGENTS, ROUNDS)
                assert trace["metrics"]["invalid_answers"] == game.invalid_answers[place] > 0
                # Without a history each round is a branch of its own.
                assert len([node for node in trace["nodes"] if node.get("parent") is None]) == ROUNDS
                assert trace["metrics"]["messages_heard"] == game.heard[place]
        # A prompt contains the memory of its agent, so a model is sent nothing else.
        assert {len(request["messages"]) for request in requests} == {1}
        assert len(requests) == 2 * AGENTS * ROUNDS
        files = sorted(journals.iterdir())
        assert len(files) == 2
        for file in files:
            subprocess.run([find_binary(), "verify", file], check=True, capture_output=True)
        print(f"seats: 2 episodes of {AGENTS} traces, {len(requests)} requests, journals verified")

        requests.clear()
        episodes = evaluate(
            folder / "one_seat", endpoint, "--env.taskset.game", "all", "-n", "5", "--env.mode", "one_seat",
            "--env.seat", "2", "--env.agent.harness.id", "swarmseat-verifiers", "--env.agent.harness.history", "1",
        )  # fmt: skip
        tasks = set()
        for line in episodes:
            (trace,) = line["traces"]
            told = trace["info"]["swarmbench"]
            tasks.add(told["task"])
            game = expected(told["task"], told["seed"], mode="one_seat", seat=2)
            assert told["digest"] == game.world.world_digest(0)
        assert len(tasks) == 5
        assert max(len(request["messages"]) for request in requests) == 3
        print(f"one seat: {len(episodes)} episodes in all tasks, with a history of one round")


if __name__ == "__main__":
    main()
