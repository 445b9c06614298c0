"""Swarms for verifiers and prime-rl: a taskset, an environment, and a harness that asks without a program of its own.

This module needs Python 3.11 and the extra `verifiers`. verifiers finds it by the package that exports it:
`vf-eval swarmseat-verifiers -n 3 --env.taskset.game Pursuit` (docs/play/frameworks.md).
"""

import asyncio
from collections.abc import Iterator
from contextlib import AsyncExitStack
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, get_type_hints

import httpx
from pydantic import BaseModel, ConfigDict, Field, create_model

from .names import TASKS, AnswerReader, Rewards, TaskName
from .settings import STANDARD, GameSettings
from .text import TextEpisode, Turn

try:
    import verifiers.v1 as vf
    from verifiers.v1.dialects.chat import message_to_wire
    from verifiers.v1.task import task_key
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "swarmseat.verifiers needs Python 3.11 or newer and this package's extra `verifiers` (docs/play/python.md): "
        f"there is no {error.name}",
        name=error.name,
    ) from error

TIMEOUT_S = 600.0
"""The maximum time that a model may take for an answer."""

TRANSPORT_FAILED = 97
"""The exit code by which verifiers distinguishes a broken connection to a model from a failed program."""

if TYPE_CHECKING:
    Settings: TypeAlias = BaseModel
else:
    Settings = create_model(
        "Settings",
        __config__=ConfigDict(frozen=True),
        __doc__=GameSettings.__doc__,
        __module__=__name__,
        **{name: (kind, STANDARD[name]) for name, kind in get_type_hints(GameSettings).items()},
    )


class SwarmData(vf.TaskData):
    """A game: a task, the seed of its layout, and its settings."""

    game: TaskName
    seed: int
    settings: Settings


class SwarmTask(vf.Task[SwarmData]):
    """A game to be played. It is scored by the environment."""

    @property
    def key(self) -> str:
        """The same game has the same key in every run."""
        return str(task_key(self.data.model_dump(mode="json", include={"game", "seed", "settings"})))


class SwarmTasksetConfig(vf.TasksetConfig):
    """The choice of games."""

    game: TaskName | Literal["all"] = "all"
    """The task, or all five in turn."""
    first_seed: int = Field(0, ge=0)
    """The seed of the first layout; 27, 42, 57, 72 and 87 are those of the paper."""
    num_seeds: int | None = Field(None, ge=1)
    """The number of seeds. Default: without end."""
    settings: Settings = Settings()


class SwarmTaskset(vf.Taskset[SwarmTask, SwarmTasksetConfig]):
    """Games of one task or of all, seed by seed."""

    INFINITE = True

    @property
    def bounded(self) -> bool:
        """Whether the number of games is finite."""
        return self.config.num_seeds is not None if self._bounded is None else self._bounded

    def load(self) -> Iterator[SwarmTask]:
        """The games."""
        config = self.config
        games = TASKS if config.game == "all" else (config.game,)
        last = config.num_seeds
        for seed in count(config.first_seed) if last is None else range(config.first_seed, config.first_seed + last):
            for game in games:
                data = SwarmData(name=f"{game}#{seed}", game=game, seed=seed, settings=config.settings)
                yield SwarmTask(data, config.task)


class SwarmHarnessConfig(vf.HarnessConfig):
    """The settings of requests to models."""

    history: int | None = Field(0, ge=0)
    """The number of earlier rounds of the conversation that are sent with a prompt; all with `None`. A prompt contains
    the memory of its agent, so 0 is enough, and is the paper's setting."""


class SwarmHarness(vf.Harness[SwarmHarnessConfig]):
    """Asks the model once per round, from this process: without tools, and without a program to install."""

    APPENDS_SYSTEM_PROMPT = True
    SUPPORTS_RESUME = True
    EXECUTES_CODE = False
    NEEDS_CONTAINER = False

    async def launch(
        self,
        ctx: vf.ModelContext,
        trace: vf.Trace,
        runtime: vf.Runtime,
        endpoint: str,
        secret: str,
        mcp_urls: dict[str, str],
        data: vf.TaskData,
    ) -> vf.ProgramResult:
        """Sends the last messages of a conversation, and leaves the answer to the trace."""
        del trace, runtime, mcp_urls
        system, prompt = self.resolve_prompt(data)
        messages = (
            [{"role": "user", "content": prompt}]
            if isinstance(prompt, str)
            else [message_to_wire(message) for message in prompt or []]
        )
        if self.config.history is not None:
            messages = messages[-1 - 2 * self.config.history :]
        if system is not None:
            messages.insert(0, {"role": "system", "content": system})
        try:
            async with httpx.AsyncClient(timeout=TIMEOUT_S) as client:
                answer = await client.post(
                    f"{endpoint.rstrip('/')}/chat/completions",
                    headers={"Authorization": f"Bearer {secret}"},
                    json={"model": ctx.model, "messages": messages},
                )
        except httpx.TransportError as error:
            return vf.ProgramResult(exit_code=TRANSPORT_FAILED, stdout="", stderr=repr(error))
        failed = answer.status_code >= 400
        return vf.ProgramResult(exit_code=int(failed), stdout="", stderr=answer.text[:2000] if failed else "")


class SwarmEnvConfig(vf.EnvConfig):
    """The players of a game, and their rewards."""

    # Without a harness the environment has that of its taskset, `SwarmHarness`.
    agent: vf.AgentConfig = vf.AgentConfig(runtime=vf.SubprocessConfig())
    """The model's agent, which plays all of the model's seats."""
    max_concurrent_agents: int | None = Field(None, ge=1)
    """The maximum number of seats of a game that are asked at the same time. Default: all."""
    mode: Literal["seats", "one_seat"] = "seats"
    """`seats`: a model plays every agent, each with a conversation and a trace of its own. `one_seat`: a model plays
    one agent, and built-in players play the others."""
    seat: int = Field(0, ge=0)
    """With `one_seat`, the agent that the model plays."""
    partners: str = "default"
    """With `one_seat`, the built-in player of the others."""
    rewards: Rewards = "team"
    """`team`: every trace gets the whole swarm's score. `individual`: every trace gets its own agent's part."""
    scale: Literal["share", "score"] = "share"
    """`share`: rewards are divided by `swarmseat.rewards.full_score`. `score`: they are points."""
    answer_reader: AnswerReader = "last-marker"
    journals: Path | None = None
    """A folder for the journals of all games, which `swarmbench verify` reads."""


class SwarmEnv(vf.Env[SwarmEnvConfig]):
    """A game as an episode: all seats are asked together, and a round is resolved when all have answered."""

    async def run(self, task: SwarmTask, agents: vf.Agents) -> None:
        """Plays the game of a task to its end."""
        config, game = self.config, task.data
        episode = TextEpisode(
            game.game, config.mode, seat=config.seat, partners=config.partners if config.mode == "one_seat" else None,
            rewards=config.rewards, answer_reader=config.answer_reader, **game.settings.model_dump(),
        )  # fmt: skip
        try:
            await self._play(episode, episode.reset(game.seed), task, agents)
        finally:
            episode.close()

    async def _play(self, episode: TextEpisode, turn: Turn, task: SwarmTask, agents: vf.Agents) -> None:
        seat_task = vf.Task(vf.TaskData(idx=task.data.idx, name=task.data.name, system_prompt=task.data.system_prompt))
        async with AsyncExitStack() as stack:
            seats = {
                agent: await stack.enter_async_context(agents.agent.interaction(seat_task)) for agent in turn.asked
            }
            traces = {agent: seat.trace for agent, seat in seats.items()}
            while not turn.done:
                asked = [agent for agent in turn.asked if agent in seats]
                segments = await asyncio.gather(*(seats[agent].turn(turn.prompts[agent]) for agent in asked))
                answers: dict[int, str | None] = {}
                for agent, segment in zip(asked, segments, strict=True):
                    if segment.terminated:
                        # The seat is asked no more: its model failed, or its budget is spent. The others play on.
                        del seats[agent]
                    else:
                        answers[agent] = segment.last_reply
                turn = episode.step(answers if episode.mode == "seats" else answers.get(turn.asked[0]))
            self._record(episode, traces)

    def _record(self, episode: TextEpisode, traces: dict[int, vf.Trace]) -> None:
        config, world = self.config, episode.world
        unit = episode.full_score if config.scale == "share" else 1.0
        file: str | None = None
        if config.journals is not None:
            config.journals.mkdir(parents=True, exist_ok=True)
            path = config.journals / f"{world.task}-{episode.seed}-{next(iter(traces.values())).id}.jsonl"
            path.write_bytes(episode.journal())
            file = str(path)
        for agent, trace in traces.items():
            trace.record_reward(config.rewards, episode.earned[agent] / unit)
            trace.record_metric("score", episode.turn.score)
            trace.record_metric("invalid_answers", episode.invalid_answers[agent])
            trace.record_metric("messages_heard", episode.heard[agent])
            trace.info["swarmbench"] = {
                "task": world.task, "seed": episode.seed, "agent": f"Agent_{agent}", "rounds": episode.turn.round,
                "digest": world.world_digest(0), "journal": file,
            }  # fmt: skip
