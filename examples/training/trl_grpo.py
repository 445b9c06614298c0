"""GRPO with TRL: a model learns to play one seat, and built-in players play the others.

    pip install "$(ls bindings/python/dist/*.whl)[trl]" torch
    python examples/training/trl_grpo.py --model Qwen/Qwen3-0.6B --task Synchronization

The model calls tools: `look`, `move` and `say`. A group of rollouts plays the same layout, as GRPO compares them. A
useful model needs a graphics card; `SwarmSeat` alone needs only swarmseat.
"""

import argparse
from typing import Any

from swarmseat import TextEpisode, Turn

MAX_ROUND = 20
"""The maximum number of rounds of an episode. The whole conversation has to fit into `max_completion_length`."""


class SwarmSeat:
    """What a rollout plays: TRL makes one for each, resets it, and offers its other methods to the model as tools."""

    def __init__(self) -> None:
        self._episode: TextEpisode | None = None
        self._message = ""
        self._gain = 0.0

    def reset(self, task: str = "Synchronization", seed: int = 0, seat: int = 0, **row: Any) -> str:
        """Begins the episode of a row of the data. What it returns is added to the prompt."""
        del row  # The prompt, and the other columns of a data set.
        if self._episode is not None:
            self._episode.close()
        self._episode = TextEpisode(task, "one_seat", seat=seat, max_round=MAX_ROUND)
        self._message, self._gain = "", 0.0
        return self._shown(self._episode.reset(seed))

    def look(self) -> str:
        """Shows again what you see now. It takes no time.

        Returns:
            What you see, the round, and the messages that you heard.
        """
        return self._shown(self._playing().turn)

    def move(self, direction: str) -> str:
        """Acts in this round, and shows what you see in the next one.

        Args:
            direction: UP, DOWN, LEFT, RIGHT or STAY; in Synchronization also SWITCH, which flips your light.

        Returns:
            What you see in the next round.
        """
        episode = self._playing()
        if episode.turn.done:
            return self._shown(episode.turn)
        message = f"\nMSG: {self._message}" if self._message else ""
        turn = episode.step(f"ACTION: {direction}{message}")
        self._gain += turn.gain
        self._message = ""
        refused = f"{direction!r} is no action: you did nothing.\n\n" if turn.invalid else ""
        return refused + self._shown(turn)

    def say(self, text: str) -> str:
        """Sends a message to the agents that you see, together with your next move.

        Args:
            text: What you say, in one line of at most 120 characters.

        Returns:
            A confirmation.
        """
        self._message = " ".join(text.split())
        return "It is sent with your next move."

    def get_reward(self) -> float:
        """The score of the swarm, as a share of a full score."""
        return self._gain

    def _playing(self) -> TextEpisode:
        if self._episode is None:
            raise RuntimeError("reset comes first")
        return self._episode

    def _shown(self, turn: Turn) -> str:
        if turn.done:
            return f"The episode is over after {turn.round} rounds. The team's score is {turn.score:g}."
        return f"\n{turn.prompt}\n\nUse the tools say and move for your message and your action."


def rows(task: str, count: int, first_seed: int) -> list[dict[str, Any]]:
    """The data: a row for each layout."""
    asked = [
        {"role": "user", "content": "You play one agent of a swarm. Act with the tool move until the episode is over."}
    ]
    return [
        {"prompt": asked, "task": task, "seed": first_seed + number, "seat": number % 12} for number in range(count)
    ]


def main() -> None:
    """Trains."""
    parser = argparse.ArgumentParser(description="GRPO on one seat of a swarm, with TRL.")
    parser.add_argument("--model", default="Qwen/Qwen3-0.6B")
    parser.add_argument("--task", default="Synchronization")
    parser.add_argument("--rows", type=int, default=256, help="layouts to train on")
    told = parser.parse_args()

    from datasets import Dataset  # noqa: PLC0415 - SwarmSeat needs none of this
    from trl import GRPOConfig, GRPOTrainer  # noqa: PLC0415

    trainer = GRPOTrainer(
        model=told.model,
        train_dataset=Dataset.from_list(rows(told.task, told.rows, first_seed=1_000_000)),
        environment_factory=SwarmSeat,
        args=GRPOConfig(
            output_dir="swarm-grpo",
            num_generations=8,
            max_completion_length=16_384,
            max_tool_calling_iterations=MAX_ROUND + 5,
            log_completions=True,
        ),
    )
    trainer.train()


if __name__ == "__main__":
    main()
