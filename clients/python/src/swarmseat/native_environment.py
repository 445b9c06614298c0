"""`parallel_env(backend="native")`: the same environment with the episode in this process."""

import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from ._compat import Self
from .environment import SwarmEnv
from .native import VecEnv, Words
from .settings import STANDARD
from .wire import EpisodeRequest, Observation

if TYPE_CHECKING:
    from numpy.typing import NDArray


class _Seen(dict[str, Observation]):
    """The observations of all agents, each made when it is first read."""

    def __init__(self, world: VecEnv) -> None:
        super().__init__()
        self._world = world

    def __missing__(self, agent: str) -> Any:
        return self._world.sight(0, int(agent.removeprefix("Agent_")))


class NativeSwarmEnv(SwarmEnv):
    """The environment of `parallel_env(backend="native")`: `SwarmEnv` without a server.

    Attributes:
        world: The episode as the only one of a `VecEnv`, for its state, its journal and its digest.
    """

    def __init__(self, settings: EpisodeRequest, **options: Any) -> None:
        super().__init__(settings, server=None, token=None, **options)
        self.world = self._make()
        self.seen = _Seen(self.world)
        self._places = {agent: place for place, agent in enumerate(self.possible_agents)}

    def close(self) -> None:
        """Frees the memory of the episode. A later `reset` begins a new one."""
        self.agents = []
        self.seed = None
        self._is_closed = True
        self.world.close()

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.seen = _Seen(self.world)

    def _make(self) -> VecEnv:
        settings: dict[str, Any] = dict(self._settings)
        return VecEnv(
            settings["task"], 1, **{name: settings[name] for name in STANDARD}, seed=0, threads=1,
            rewards="individual" if self._rewards == "individual" else "team", messages=self._messages,
            observations="none" if self._observations == "text" else "planes", autoreset="disabled", copy=False,
            prompt_template=settings["prompt_template"],
        )  # fmt: skip

    def _check_playing(self) -> None:
        if self.seed is None:
            raise self._no_episode()

    def _begin(self) -> None:
        if self._is_closed:
            self.world, self._is_closed = self._make(), False
            self.seen = _Seen(self.world)
        drawn = self._draw()
        outputs = self.world.reset(seed=[drawn])
        self.seed, self._is_over = drawn, not outputs["alive"].any()
        self.agents = list(self.possible_agents)

    def _resolve(self, actions: dict[str, Any]) -> tuple[dict[str, float], dict[str, bool], dict[str, bool]]:
        agents = self.agents
        numbers = [-1] * len(self.possible_agents)
        words: list[Words] = [None] * len(self.possible_agents)
        for agent in agents:
            place, action = self._places[agent], actions[agent]
            # Most policies return such numbers; any other action is read with all checks.
            if type(action) is int and not self._messages and 0 <= action < len(self.actions):
                numbers[place] = action
                continue
            act = self._act(agent, 0, action)
            numbers[place] = self.actions.index(act["action"] or "")
            if "message" in act:
                to = act.get("to")
                words[place] = (act["message"] or "", None if to is None else self._places[to])
        outputs = self.world.step(np.array([numbers]), [words] if self._messages else None)
        rewards, done = outputs["rewards"][0].tolist(), outputs["agent_done"][0].tolist()
        gains = {agent: rewards[self._places[agent]] for agent in agents}
        terminations = {agent: done[self._places[agent]] for agent in agents}
        return gains, terminations, dict.fromkeys(agents, False)

    def _forks(self, count: int) -> list[Self]:
        state = self.world.state(0)
        forks = [copy.deepcopy(self) for _ in range(count)]
        for env in forks:
            # A copy is before its first reset.
            env.world.load(0, state)
            vars(env).update(seed=self.seed, agents=list(self.agents), score=self.score, _round=self._round)
        return forks

    def _map(self) -> list[list[str]]:
        self._check_playing()
        return self.world.map(0)

    def _outputs(self, agents: list[str]) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """The observations of these agents, as copies."""
        world, buffers = self.world, self.world.buffers
        count = len(self.possible_agents)
        self._round, self.score = int(buffers["round"][0]), float(buffers["score"][0])
        heard = world.heard()[0] if self._messages else None
        parts: dict[str, NDArray[Any]] = {}
        if self._observations != "text":
            parts = {
                "view": buffers["view"][0].copy(),
                "agents": buffers["agents"][0].astype(np.int32),
                "position": buffers["position"][0].copy(),
                "round": np.full((count, 1), self._round, np.int32),
                "score": np.full((count, 1), self.score, np.float32),
            }
            if world.flag is not None:
                parts[world.flag] = buffers[world.flag][0].reshape(count, 1).copy()
        rows = self._layout.flatten(parts) if self._observations == "flat" else None
        on_map = (buffers["position"][0, :, 0] >= 0).tolist()
        observations: dict[str, Any] = {}
        infos: dict[str, dict[str, Any]] = {}
        for agent in agents:
            place = self._places[agent]
            messages = [] if heard is None else heard[place]
            if self._observations == "text":
                observations[agent] = world.prompt(0, place)
            elif rows is not None:
                observations[agent] = rows[place]
            else:
                seen: dict[str, Any] = {name: part[place] for name, part in parts.items()}
                if heard is not None:
                    seen["messages"] = tuple(messages)
                if self._observations == "both":
                    seen["prompt"] = world.prompt(0, place)
                observations[agent] = seen
            infos[agent] = {"round": self._round, "score": self.score, "alive": on_map[place], "messages": messages}
        return observations, infos
