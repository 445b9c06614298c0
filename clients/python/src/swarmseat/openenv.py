"""Swarms for OpenEnv: an environment of its server, and a client.

This module needs the extra `openenv`. `python -m swarmseat.openenv` serves the environment; a package for a hub is in
`examples/training/for_openenv` of the repository (docs/play/frameworks.md).
"""

import argparse
import functools
from typing import Any
from uuid import uuid4

from .checks import one_of, task_name, whole
from .errors import ArgumentError
from .names import TASKS, TaskName
from .settings import STANDARD
from .text import Mode, TextEpisode, Turn

try:
    from openenv.core import EnvClient
    from openenv.core.client_types import StepResult
    from openenv.core.env_server.http_server import create_app
    from openenv.core.env_server.interfaces import Environment
    from openenv.core.env_server.types import Action, EnvironmentMetadata, Observation, State
    from pydantic import Field
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"swarmseat.openenv needs {error.name}: install this package with its extra `openenv` (docs/play/python.md)",
        name=error.name,
    ) from error

MODES: tuple[Mode, ...] = ("one_seat", "turns", "joint")
"""Modes with one conversation, the only ones of a session."""

SUITES: dict[str, tuple[int, ...]] = {"standard": (27, 42, 57, 72, 87), "baselines": tuple(range(20))}
"""The seeds of the servers' suites. Each is played with all tasks."""

TRAIN_SEEDS = range(1_000_000, 1_100_000)
"""The seeds of the split `train`, none of which is in a suite."""

LISTED_MAX = 1_000
"""The maximum number of games of a split that are listed at once."""


class SwarmAction(Action):
    """An answer of a language model."""

    response: str = Field(description="The answer to the prompt, which ends with ACTION: … and/or MSG: …")


class SwarmObservation(Observation):
    """The next prompt. `reward` is the share of a full score that the last step added."""

    prompt: str = Field(default="", description="What the model is asked; empty once the episode is over")
    agent: str | None = Field(default=None, description="Whose act is asked for; null for all agents together")
    round: int = Field(default=0, description="Rounds that are resolved")
    score: float = Field(default=0.0, description="The score of the whole swarm, in points of the task")
    invalid: str | None = Field(default=None, description="Why the last answer did not count")


class SwarmState(State):
    """The state of a session's episode."""

    task: TaskName = "Foraging"
    mode: Mode = "one_seat"
    seed: int | None = None
    round: int = 0
    score: float = 0.0


class SwarmEnvironment(Environment[SwarmAction, SwarmObservation, SwarmState]):
    """One episode after the other, for one session.

    Args:
        task: The task if `reset` names none.
        mode: `one_seat`, `turns` or `joint`, as in `swarmseat.TextEpisode`.
        **settings: Further arguments of `swarmseat.TextEpisode`: the seat, its partners, and settings of the game.
    """

    SUPPORTS_CONCURRENT_SESSIONS = True

    def __init__(self, task: TaskName = "Foraging", mode: Mode = "one_seat", **settings: Any) -> None:
        super().__init__()
        one_of("mode", mode, MODES)
        self._task = task_name(task)
        self._mode: Mode = mode
        self._settings = settings
        self._episode: TextEpisode | None = None
        self._state = SwarmState(task=self._task, mode=mode)

    def reset(
        self,
        seed: int | None = None,
        episode_id: str | None = None,
        task: str | None = None,
        split: str | None = None,
        index: int | None = None,
    ) -> SwarmObservation:
        """Begins an episode and shows the first prompt.

        Args:
            seed: The seed of the layout, which the state and `metadata` name. Default: a random one.
            episode_id: A name for the episode.
            task: Another task than the environment's.
            split: With `index`, a game of a split instead of `task` and `seed`.
            index: The index of the game in the split.
        """
        played = self._task if task is None else task_name(task)
        if split is not None or index is not None:
            if split is None or index is None or seed is not None or task is not None:
                raise ArgumentError("a game is named by split and index, or by task and seed")
            game = self.get_task(split, index)
            played, seed = game["task"], game["seed"]
        if self._episode is None or self._episode.world.task != played:
            self.close()
            self._episode = TextEpisode(played, self._mode, **self._settings)
        turn = self._episode.reset(seed)
        self._state = SwarmState(episode_id=episode_id or str(uuid4()), task=played, mode=self._mode)
        return self._shown(self._episode, turn, reward=None)

    def step(self, action: SwarmAction, timeout_s: float | None = None) -> SwarmObservation:
        """Takes an answer. An invalid answer costs the act, and the episode continues."""
        del timeout_s  # A step never waits.
        if self._episode is None:
            raise ArgumentError("there is no episode yet: reset first")
        turn = self._episode.step(action.response)
        self._state.step_count += 1
        return self._shown(self._episode, turn, turn.gain)

    @property
    def state(self) -> SwarmState:
        """The game and its progress."""
        return self._state

    def close(self) -> None:
        """Frees the memory of the episode."""
        if self._episode is not None:
            self._episode.close()
            self._episode = None

    def get_metadata(self) -> EnvironmentMetadata:
        """The description of this environment."""
        return EnvironmentMetadata(
            name="swarmbench",
            description="Swarms of language models in a grid world with real pushing physics: five tasks of SwarmBench",
            version="0.1.0",
        )

    def list_splits(self) -> list[str]:
        """The splits: suites of servers, and `train` with other seeds."""
        return [*SUITES, "train"]

    def num_tasks(self, split: str) -> int:
        """The number of games of a split."""
        return len(_seeds(split)) * len(TASKS)

    def get_task(self, split: str, index: int) -> dict[str, Any]:
        """A game of a split."""
        seeds = _seeds(split)
        if not 0 <= index < len(seeds) * len(TASKS):
            raise IndexError(f"the split {split!r} has the games 0 to {len(seeds) * len(TASKS) - 1}, not {index}")
        seed, task = seeds[index // len(TASKS)], TASKS[index % len(TASKS)]
        return {"id": f"{task}#{seed}", "index": index, "task": task, "seed": seed}

    def get_task_range(self, split: str, start: int | None = None, stop: int | None = None) -> list[dict[str, Any]]:
        """A slice of the games of a split."""
        places = range(self.num_tasks(split))[start:stop]
        return [self.get_task(split, index) for index in places[:LISTED_MAX]]

    def list_tasks(self, split: str) -> list[dict[str, Any]]:
        """The games of a split; of a long split the first ones."""
        return self.get_task_range(split)

    def _shown(self, episode: TextEpisode, turn: Turn, reward: float | None) -> SwarmObservation:
        state = self._state
        state.seed, state.round, state.score = episode.seed, turn.round, turn.score
        agent = None if episode.mode == "joint" or not turn.asked else f"Agent_{turn.asked[0]}"
        return SwarmObservation(
            prompt=turn.prompt, agent=agent, round=turn.round, score=turn.score, done=turn.done, reward=reward,
            invalid=next(iter(turn.invalid.values()), None),
            metadata={
                "task": episode.world.task, "seed": episode.seed, "raw_reward": turn.reward, "raw_score": turn.score,
                "full_score": episode.full_score, "max_round": episode.world.max_round,
            },
        )  # fmt: skip


class SwarmClient(EnvClient[SwarmAction, SwarmObservation, SwarmState]):
    """A session with a served environment."""

    def _step_payload(self, action: SwarmAction) -> dict[str, Any]:
        return {"response": action.response}

    def _parse_result(self, payload: dict[str, Any]) -> StepResult[SwarmObservation]:
        reward, done = payload.get("reward"), payload.get("done", False)
        metadata = payload.get("metadata") or payload["observation"].get("metadata") or {}
        observation = SwarmObservation(
            **{**payload["observation"], "reward": reward, "done": done, "metadata": metadata}
        )
        return StepResult(observation=observation, reward=reward, done=done, metadata=metadata)

    def _parse_state(self, payload: dict[str, Any]) -> SwarmState:
        return SwarmState(**payload)


def app(max_concurrent_envs: int = 256, **settings: Any) -> Any:
    """The application for a server such as uvicorn. `settings` are those of `SwarmEnvironment`."""
    factory = functools.partial(SwarmEnvironment, **settings)
    # A mistake in the settings is reported now, not in the first session.
    first = factory()
    first.reset()
    first.close()
    return create_app(
        factory, SwarmAction, SwarmObservation, env_name="swarmbench", state_cls=SwarmState,
        max_concurrent_envs=whole("max_concurrent_envs", max_concurrent_envs, 1),
    )  # fmt: skip


def _seeds(split: str) -> range | tuple[int, ...]:
    if split == "train":
        return TRAIN_SEEDS
    one_of("split", split, [*SUITES, "train"])
    return SUITES[split]


def main() -> None:
    """Serves environments."""
    import uvicorn  # noqa: PLC0415 - it comes with openenv

    parser = argparse.ArgumentParser(
        prog="python -m swarmseat.openenv",
        description="Serves swarms as OpenEnv environments, one for each session.",
        epilog="example: python -m swarmseat.openenv --task Pursuit --mode turns --port 8000",
    )
    parser.add_argument("--task", default="Foraging", choices=TASKS, help="what is played where reset names nothing")
    parser.add_argument("--mode", default="one_seat", choices=MODES, help="what a conversation is")
    parser.add_argument(
        "--max-round", type=int, default=STANDARD["max_round"], help="after how many rounds an episode ends"
    )
    parser.add_argument("--host", default="127.0.0.1", help="the address to listen on")
    parser.add_argument("--port", type=int, default=8000, help="the port to listen on")
    parser.add_argument("--sessions", type=int, default=256, help="how many sessions there may be at the same time")
    options = parser.parse_args()
    served = app(options.sessions, task=options.task, mode=options.mode, max_round=options.max_round)
    uvicorn.run(served, host=options.host, port=options.port)


if __name__ == "__main__":
    main()
