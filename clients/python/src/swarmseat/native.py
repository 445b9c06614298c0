"""Many episodes in this process, stepped in one call: training at the speed of the engine.

This module needs the native module, which is part of the wheels of `bindings/python`.
"""

import json
import secrets
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from functools import partial
from types import TracebackType
from typing import Any, Literal, NamedTuple, TypeAlias, cast, get_args

import numpy as np
from numpy.typing import NDArray

from ._compat import Self, Unpack
from .checks import one_of, task_name, whole
from .names import AnswerReader, Rewards, TaskName, actions_of
from .settings import SEED_MAX, GameSettings, complete
from .wire import Sight

try:
    from . import _native
except ImportError as error:
    raise ModuleNotFoundError(
        "this installation of swarmseat has no native module: it was installed from clients/python, or for a platform "
        "without a wheel. Build the wheel in a checkout with `bindings/python/build` and install it, or play over HTTP "
        "with parallel_env(backend='http')",
        name="swarmseat._native",
    ) from error

Arrays: TypeAlias = dict[str, Any]
Partners: TypeAlias = _native.Partners
"""Built-in players of one episode."""
Words: TypeAlias = str | tuple[str, int | None] | None
"""The message of an agent: a text, a text and the number of its only receiver (for a commander), or nothing."""


class Answer(NamedTuple):
    """A parsed answer of a language model, or the decision of a built-in player.

    Attributes:
        action: The index of the action in `VecEnv.actions`, or -1 for none.
        message: The message of the agent.
        to: The only receiver of a commander's message.
        fault: The reason why the answer does not count: `empty`, `no_marker`, or `unknown_action`.
    """

    action: int
    message: str | None
    to: int | None
    fault: str | None


class VecEnv:
    """Environments of the same settings, stepped together without the interpreter's lock.

    An environment with the seed of a hosted episode plays exactly that episode. `reset` and `step` return a dictionary
    of arrays, all with the environments as their first axis (E environments, A agents, windows of H by W cells):

    | key | shape, type | |
    | --- | --- | --- |
    | `view` | (E, A, 10, H, W) uint8 | one-hot over `swarmseat.arrays.CHANNELS`; (E, A, H, W) with `symbols` |
    | `agents` | (E, A, H, W) int16 | the number of the agent in that cell, -1 for none and for the agent itself |
    | `position` | (E, A, 2) int32 | row and column; -1, -1 once it has escaped |
    | `round`, `score` | (E,) int32, float32 | rounds resolved; the score of the whole swarm |
    | `light_on`, `carrying_food` | (E, A) uint8 | in Synchronization, and in Foraging |
    | `alive` | (E, A) bool | which agents may act; all actions of these are allowed |
    | `action_mask` | (E, A, n) bool | the same for each action, or a hint: see `mask` |
    | `seed` | (E,) int64 | the seed of the layout that is played |
    | `rewards`, `team_reward` | (E, A), (E,) float32 | from `step` |
    | `terminated`, `truncated` | (E,) bool | from `step`; nothing is ever truncated in process |
    | `agent_done` | (E, A) bool | from `step`: it has escaped, or the episode has ended |
    | `final_obs` | a dictionary | from `step` with `same_step`: the last observations, where `terminated` is set |
    | `messages` | E lists of A lists of texts | with `messages=True` |

    Args:
        task: The name of the task.
        num_envs: The number of environments.
        seed: The seed from which environments draw the seeds of their layouts. Default: a random one.
        threads: The number of threads that step. Default: the number of processors. Results do not depend on it.
        observations: `planes` or `symbols` for `view`; `none` writes no windows.
        rewards: `team`: every agent earns the change of the score. `individual`: each agent earns its own part.
        messages: Whether agents talk.
        autoreset: The behaviour after an episode, as in Gymnasium's `AutoresetMode`: `next_step`, `same_step` or
            `disabled`.
        mask: `alive`: all actions of an agent on the map. `moves`: without pushes against a wall, a nest or food that
            the agent sees beside itself; this is a hint, as such pushes are allowed, and change nothing.
        copy: Whether `reset` and `step` return copies. Without, they return the arrays into which the next call writes.
        record: Whether acts are recorded, so that there are states and journals: a byte for each act.
        prompt_template: A template for `prompt` instead of the built-in one: its text, or the name `toolkit`.
        answer_reader: The reader of answers, for `read_answer`.
        **settings: Settings of the game, as in `swarmseat.settings.GameSettings`. Arrays show the present only, so
            `memory` is 0 by default.

    Attributes:
        buffers: The arrays into which every call writes.
        actions: The names of actions, by their numbers.
    """

    def __init__(
        self,
        task: TaskName = "Foraging",
        num_envs: int = 1,
        *,
        seed: int | None = None,
        threads: int | None = None,
        observations: Literal["planes", "symbols", "none"] = "planes",
        rewards: Rewards = "team",
        messages: bool = False,
        autoreset: Literal["next_step", "same_step", "disabled"] = "next_step",
        mask: Literal["alive", "moves"] = "alive",
        copy: bool = True,
        record: bool = True,
        prompt_template: str | None = None,
        answer_reader: AnswerReader = "last-marker",
        **settings: Unpack[GameSettings],
    ) -> None:
        own = {name: value for name, value in locals().items() if name not in {"self", "settings"}}
        self._arguments = {**own, **settings}
        one_of("observations", observations, ("planes", "symbols", "none"))
        one_of("rewards", rewards, get_args(Rewards))
        one_of("autoreset", autoreset, ("next_step", "same_step", "disabled"))
        one_of("mask", mask, ("alive", "moves"))
        one_of("answer_reader", answer_reader, get_args(AnswerReader))
        if mask == "moves" and observations == "none":
            raise ValueError("mask='moves' reads windows, so it needs observations='planes' or 'symbols'")
        num_envs = whole("num_envs", num_envs, 1, 2**20)
        own_seed = secrets.randbelow(SEED_MAX + 1) if seed is None else whole("seed", seed, 0, SEED_MAX)
        game = complete({"memory": 0, **settings})
        self._native = _native.Batch(
            task=task_name(task), **game, num_envs=num_envs, seed=own_seed,
            threads=whole("threads", threads or 0, 0, 1024), observations=observations, rewards=rewards,
            autoreset=autoreset, mask=mask, record=bool(record), answer_reader=answer_reader,
        )  # fmt: skip
        self.task = task_name(task)
        self.autoreset = autoreset
        self.copy = copy
        self.actions: tuple[str, ...] = actions_of(self.task)
        self._talks = messages
        self._template = prompt_template
        self._journals = 0
        shape = self._native.shape()
        self.num_envs: int = shape["envs"]
        self.num_agents: int = shape["agents"]
        self.window: tuple[int, int] = shape["window"]
        self.max_round, self.size = game["max_round"], (game["height"], game["width"])
        self.flag: str | None = shape["flag"]
        self._now = self._frame(shape)
        self._last = self._frame(shape) if autoreset == "same_step" else None
        seats = (self.num_envs, self.num_agents)
        self._earned: Arrays = {
            "rewards": np.zeros(seats, np.float32),
            "team_reward": np.zeros(self.num_envs, np.float32),
            "terminated": np.zeros(self.num_envs, np.bool_),
            "agent_done": np.zeros(seats, np.bool_),
        }
        self._native.bind(self._now, self._last, self._earned)
        self._truncated = np.zeros(self.num_envs, np.bool_)
        self.buffers: Arrays = {**self._named(self._now), **self._earned, "truncated": self._truncated}
        if self._last is not None:
            self.buffers["final_obs"] = self._named(self._last)
        self._seen = tuple(self._named(self._now))

    def reset(
        self,
        seed: int | Sequence[int] | NDArray[np.integer[Any]] | None = None,
        mask: Sequence[bool] | NDArray[np.bool_] | None = None,
    ) -> Arrays:
        """Begins new episodes.

        Args:
            seed: With a number, environment `i` plays the layout of `seed + i`; with one number for each environment,
                these layouts. Later seeds of an environment follow from its own. Default: seeds are drawn as before.
            mask: A boolean for each environment: whether it begins a new episode. Default: all environments do.
        """
        seeds: list[int] | None = None
        if seed is not None:
            if np.ndim(seed) == 0:
                first = whole("seed", seed, 0, SEED_MAX)
                seeds = [whole("seed", first + index, 0, SEED_MAX) for index in range(self.num_envs)]
            else:
                given = list(cast("Sequence[int]", seed))
                if len(given) != self.num_envs:
                    raise ValueError(
                        f"seed must have one number for each of {self.num_envs} environments, has {len(given)}"
                    )
                seeds = [whole(f"seed[{index}]", one, 0, SEED_MAX) for index, one in enumerate(given)]
        only: list[bool] | None = None
        if mask is not None:
            chosen = np.asarray(mask)
            if chosen.dtype != np.bool_ or chosen.shape != (self.num_envs,):
                raise ValueError(f"mask must be {self.num_envs} booleans, is {chosen.dtype} of shape {chosen.shape}")
            only = chosen.tolist()
        self._native.reset(seeds, only)
        return self._outputs(self._seen)

    def step(
        self, actions: NDArray[np.integer[Any]] | Sequence[Any], messages: Sequence[Sequence[Words]] | None = None
    ) -> Arrays:
        """Plays a round in every environment.

        Args:
            actions: (E, A) whole numbers: indices in `actions`, or -1 for none. Actions of agents that may not act have
                no effect.
            messages: The message of each agent of each environment, with `messages=True` only.
        """
        chosen = np.asarray(actions)
        seats = (self.num_envs, self.num_agents)
        if chosen.dtype.kind not in "iu" or chosen.shape != seats:
            raise ValueError(
                f"actions must be whole numbers of shape {seats}, are {chosen.dtype} of shape {chosen.shape}"
            )
        self._native.step(np.ascontiguousarray(chosen, np.int64), self._words(messages))
        return self._outputs(None)

    def fork(self, source: int, targets: int | Sequence[int] | NDArray[np.integer[Any]]) -> Arrays:
        """Copies an environment into others, in the middle of its episode. The same acts lead to the same states."""
        places = np.atleast_1d(np.asarray(targets))
        if places.dtype.kind not in "iu" or places.ndim != 1:
            raise ValueError("targets must be numbers of environments")
        self._native.fork(self._index(source), np.ascontiguousarray(places, np.int64))
        return self._outputs(self._seen)

    def state(self, index: int) -> bytes:
        """The state of an environment: its settings, and all acts that led to it. Other programs can load it."""
        return self._native.state(self._index(index))

    def load(self, index: int, state: bytes) -> Arrays:
        """Puts an environment into a state, whose acts are played again."""
        self._native.load(self._index(index), state)
        return self._outputs(self._seen)

    def world_digest(self, index: int) -> str:
        """The SHA-256 of an environment's state, as journals have it."""
        return self._native.digest(self._index(index))

    def journal(self, index: int) -> bytes:
        """The journal of an environment's episode so far, which `swarmbench verify` reads."""
        self._journals += 1
        now = datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        episode = f"ep_{secrets.token_hex(16)}"
        return self._native.journal(self._index(index), episode, now)

    def prompt(self, index: int, agent: int, template: str | None = None) -> str:
        """An agent's observation as text for a language model: the prompt of the server, or of another template."""
        return self._native.prompt(self._index(index), whole("agent", agent, 0, 2**16), template or self._template)

    def read_answer(self, agent: int, text: str) -> Answer:
        """Reads a language model's answer for an agent, by the rules of the server."""
        return Answer(*self._native.read_answer(whole("agent", agent, 0, 2**16), text))

    def partners(self, index: int, players: Mapping[int, str]) -> Partners:
        """Makes built-in players, by name, for agents of an environment whose episode has just begun.

        They decide as the players that the server hosts. `default` is the best player of the task.
        """
        names = [(whole("agent", agent, 0, 2**16), name) for agent, name in players.items()]
        return self._native.partners(self._index(index), names)

    def decide(self, index: int, partners: Partners) -> dict[int, Answer]:
        """The partners' decisions in this round, by agent. Partners are asked once in each round of the episode."""
        decided = self._native.decide(self._index(index), partners)
        return {agent: Answer(action, message, to, None) for agent, action, message, to in decided}

    def sight(self, index: int, agent: int) -> Sight:
        """The observation of an agent, as the server writes it. The id of the episode is empty."""
        text = self._native.sight(self._index(index), whole("agent", agent, 0, 2**16))
        return cast("Sight", json.loads(text))

    def map(self, index: int) -> list[list[str]]:
        """The whole map of an environment, in the symbols that agents see. An agent is a number with a mark."""
        return self._native.map(self._index(index))

    def heard(self) -> list[list[list[str]]]:
        """The messages that were received with the current observations, by environment and agent."""
        lists: list[list[list[str]]] = [[[] for _ in range(self.num_agents)] for _ in range(self.num_envs)]
        for index, agent, text in self._native.heard():
            lists[index][agent].append(text)
        return lists

    def close(self) -> None:
        """Frees the memory of all episodes. No other method can be called afterwards."""
        self._native.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        """The arguments: a copy, also one in another process, is before its first `reset`."""
        return partial(type(self), **self._arguments), ()

    def __repr__(self) -> str:
        return f"VecEnv({self.task!r}, num_envs={self.num_envs}, num_agents={self.num_agents})"

    def _frame(self, shape: Mapping[str, Any]) -> Arrays:
        envs, seats = self.num_envs, (self.num_envs, self.num_agents)
        planes, window = shape["planes"], self.window
        return {
            "view": np.zeros((*seats, planes, *window) if planes != 1 else (*seats, *window), np.uint8),
            "agents": np.zeros((*seats, *window) if planes else (0,), np.int16),
            "position": np.zeros((*seats, 2), np.int32),
            "round": np.zeros(envs, np.int32),
            "score": np.zeros(envs, np.float32),
            "flag": np.zeros(seats if self.flag else (0,), np.uint8),
            "alive": np.zeros(seats, np.bool_),
            "action_mask": np.zeros((*seats, shape["actions"]), np.bool_),
            "seed": np.zeros(envs, np.int64),
        }

    def _named(self, frame: Arrays) -> Arrays:
        """The names of all arrays, with that of the flag."""
        named = {name: array for name, array in frame.items() if name != "flag" and array.size}
        if self.flag:
            named[self.flag] = frame["flag"]
        return named

    def _outputs(self, names: tuple[str, ...] | None) -> Arrays:
        outputs = self.buffers if names is None else {name: self.buffers[name] for name in names}
        if self.copy:
            outputs = {name: _copied(part) for name, part in outputs.items()}
        if self._talks:
            outputs = {**outputs, "messages": self.heard()}
        return outputs

    def _words(self, messages: Sequence[Sequence[Words]] | None) -> list[tuple[int, int, str, int | None]]:
        if messages is None:
            return []
        if not self._talks:
            raise ValueError("nobody talks in these environments: make them with messages=True")
        if len(messages) != self.num_envs or any(len(row) != self.num_agents for row in messages):
            raise ValueError(f"messages must have {self.num_envs} lists of {self.num_agents} texts")
        words: list[tuple[int, int, str, int | None]] = []
        for index, row in enumerate(messages):
            for agent, said in enumerate(row):
                text, to = said if isinstance(said, tuple) else (said, None)
                if text is None or text == "":
                    continue
                if not isinstance(text, str):
                    raise TypeError(f"environment {index}, agent {agent}: a message is a text, not {text!r}")
                words.append((index, agent, text, None if to is None else whole("the receiver", to, 0, 2**16)))
        return words

    def _index(self, index: int) -> int:
        return whole("the environment", index, 0, self.num_envs - 1)


def _copied(part: Any) -> Any:
    if isinstance(part, dict):
        return {name: array.copy() for name, array in part.items()}
    return part.copy()
