"""`parallel_env(backend="native")`: the same environment with the episode in this process."""

from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.utils import seeding

from .environment import SEED_MAX, SwarmEnv
from .errors import SwarmbenchError
from .native import VecEnv, Words
from .wire import EpisodeRequest

if TYPE_CHECKING:
    from numpy.typing import NDArray


class NativeSwarmEnv(SwarmEnv):
    """What `parallel_env(backend="native")` returns: `SwarmEnv` without a server.

    Attributes:
        world: The environment with one episode, for its state, journal and forks.
    """

    def __init__(
        self,
        settings: EpisodeRequest,
        *,
        seed: int | None,
        rewards: str,
        observations: str,
        messages: bool,
        render_mode: str | None,
    ) -> None:
        super().__init__(
            settings, seed=seed, server=None, token=None, rewards=rewards, observations=observations,
            messages=messages, render_mode=render_mode,
        )  # fmt: skip
        options: dict[str, Any] = {
            name: settings[name]
            for name in (
                "num_agents", "rules", "width", "height", "view_size", "memory", "max_round", "control", "noise",
                "max_delay",
            )
        }  # fmt: skip
        self.world = VecEnv(
            settings["task"], 1, **options, seed=0, threads=1, rewards=rewards, messages=messages,
            observations="none" if observations == "text" else "planes", autoreset="disabled", copy=False,
            prompt_template=settings["prompt_template"],
        )  # fmt: skip
        self._closed = False

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begins a new episode. There are no options."""
        del options
        if seed is not None:
            self._generator, _ = seeding.np_random(seed)
            self._next_seed = seed
        drawn = int(self._generator.integers(SEED_MAX, endpoint=True)) if self._next_seed is None else self._next_seed
        self._next_seed = None
        self.world.reset(seed=[drawn])
        self.seed = int(drawn)
        self.agents = list(self.possible_agents)
        return self._seen_by(self.agents)

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Plays a round with an action for each agent in `agents`."""
        agents = self.agents
        if self.seed is None:
            raise SwarmbenchError("there is no episode yet: call reset()")
        if not agents:
            return {}, {}, {}, {}, {}
        missing = [agent for agent in agents if agent not in actions]
        if missing:
            raise ValueError(
                f"a round takes an action of every agent in `agents`; there is none of {', '.join(missing)}"
            )
        numbers = np.full((1, len(self.possible_agents)), -1, np.int64)
        words: list[Words] | None = [None] * len(self.possible_agents) if self._messages else None
        for agent in agents:
            place = self._places[agent]
            action = actions[agent]
            if words is not None:
                if action["message"]:
                    to = int(action.get("to") or 0)
                    words[place] = (action["message"], to) if to else action["message"]
                action = action["action"]
            number = int(action)
            if not 0 <= number < len(self.actions):
                raise ValueError(f"{agent} has the actions 0 to {len(self.actions) - 1}, and not {number}")
            numbers[0, place] = number
        told = self.world.step(numbers, None if words is None else [words])
        earned, done = told["rewards"][0].tolist(), told["agent_done"][0].tolist()
        gains = {agent: earned[self._places[agent]] for agent in agents}
        terminations = {agent: done[self._places[agent]] for agent in agents}
        observations, infos = self._seen_by(agents)
        self.agents = [agent for agent in agents if not terminations[agent]]
        if self.render_mode == "human":
            self.render()
        return observations, gains, terminations, dict.fromkeys(agents, False), infos

    def close(self) -> None:
        """Gives the memory of the episode back."""
        self.agents = []
        self.seed = None
        self.world.close()

    def _seen_by(self, agents: list[str]) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        world, buffers = self.world, self.world.buffers
        count = len(self.possible_agents)
        round_, score = int(buffers["round"][0]), float(buffers["score"][0])
        self.score = score
        heard = world.heard()[0] if self._messages else None
        parts: dict[str, NDArray[Any]] = {}
        if self._observations != "text":
            parts = {
                "view": buffers["view"][0].copy(),
                "agents": buffers["agents"][0].astype(np.int32),
                "position": buffers["position"][0].copy(),
                "round": np.full((count, 1), round_, np.int32),
                "score": np.full((count, 1), score, np.float32),
            }
            if world.flag is not None:
                parts[world.flag] = buffers[world.flag][0].reshape(count, 1).copy()
        on_map = (buffers["position"][0, :, 0] >= 0).tolist()
        observations: dict[str, Any] = {}
        infos: dict[str, dict[str, Any]] = {}
        for agent in agents:
            place = self._places[agent]
            messages = [] if heard is None else heard[place]
            if self._observations == "text":
                observations[agent] = world.prompt(0, place)
            else:
                seen: dict[str, Any] = {name: part[place] for name, part in parts.items()}
                if heard is not None:
                    seen["messages"] = tuple(messages)
                if self._observations == "both":
                    seen["prompt"] = world.prompt(0, place)
                observations[agent] = seen
            infos[agent] = {"round": round_, "score": score, "alive": on_map[place], "messages": messages}
        return observations, infos
