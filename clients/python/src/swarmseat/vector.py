"""Many episodes as a Gymnasium `VectorEnv`. Importing this module registers `swarmbench/Foraging-v0` and the like."""

from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from .arrays import Layout
from .cells import CHANNELS
from .names import TASKS, TaskName
from .native import VecEnv

_MODES = {
    "next_step": AutoresetMode.NEXT_STEP,
    "same_step": AutoresetMode.SAME_STEP,
    "disabled": AutoresetMode.DISABLED,
}


def gym_vector_env(
    task: TaskName = "Foraging",
    num_envs: int = 1,
    *,
    agents: Literal["joint", "flat"] = "joint",
    observations: Literal["planes", "symbols", "flat"] = "planes",
    **options: Any,
) -> "SwarmVectorEnv":
    """Episodes as a Gymnasium `VectorEnv`.

    Args:
        task: The name of the task.
        num_envs: The number of episodes.
        agents: `joint`: each episode is an environment whose action is one number for each agent, and whose reward is
            that of the team. `flat`: each agent is an environment, so one policy plays all; there are `num_envs` times
            `num_agents` environments, and `info["alive"]` says which may act.
        observations: A dictionary of arrays with `planes` or `symbols` for the windows; or `flat`, a `Box` of floats
            with all parts: planes, position, round and flag.
        options: Further arguments of `VecEnv`, except `messages` and `copy`.
    """
    return SwarmVectorEnv(task, num_envs, agents=agents, observations=observations, **options)


class SwarmVectorEnv(VectorEnv[Any, Any, Any]):
    """The environments of `gym_vector_env`.

    Attributes:
        envs: The episodes, for their states, journals and forks.
    """

    def __init__(self, task: TaskName, num_envs: int, *, agents: str, observations: str, **options: Any) -> None:
        if agents not in {"joint", "flat"}:
            raise ValueError(f"agents must be 'joint' or 'flat', is {agents!r}")
        if observations not in {"planes", "symbols", "flat"}:
            raise ValueError(f"observations must be 'planes', 'symbols' or 'flat', is {observations!r}")
        refused = sorted({"messages", "copy"} & options.keys())
        if refused:
            raise TypeError(f"{refused[0]} is no option of a vector environment: use VecEnv itself")
        form: Any = "planes" if observations == "flat" else observations
        self.worlds = VecEnv(task, num_envs, observations=form, copy=False, **options)
        self._layout = Layout(
            self.worlds.task, self.worlds.window, self.worlds.size, self.worlds.num_agents, self.worlds.max_round, False
        )
        self._by_agent = agents == "flat"
        self._flat = observations == "flat"
        self.render_mode = None
        self.spec = None
        count = self.worlds.num_agents
        self.num_envs = num_envs * count if self._by_agent else num_envs
        self.metadata = {"autoreset_mode": _MODES[self.worlds.autoreset], "render_modes": []}
        actions = len(self.worlds.actions)
        self.single_action_space = (
            spaces.Discrete(actions) if self._by_agent else spaces.MultiDiscrete(np.full(count, actions))
        )
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.single_observation_space = self._space()
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins new episodes: all, or those that the booleans `options["reset_mask"]` choose."""
        mask = (options or {}).get("reset_mask")
        given: Any = seed
        if isinstance(seed, list):
            if None in seed:
                raise ValueError("seed has a number for each environment, or is none at all")
            given = seed[:: self.worlds.num_agents] if self._by_agent else seed
        if mask is not None and self._by_agent:
            mask = np.asarray(mask)[:: self.worlds.num_agents]
        outputs = self.worlds.reset(seed=given, mask=mask)
        return self._observed(outputs), self._info(outputs)

    def step(
        self, actions: NDArray[np.integer[Any]]
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Plays a round in every episode."""
        count = self.worlds.num_agents
        chosen = np.asarray(actions)
        if self._by_agent and chosen.shape == (self.num_envs,):
            chosen = chosen.reshape(-1, count)
        outputs = self.worlds.step(chosen)
        info = self._info(outputs)
        if "final_obs" in outputs:
            ended = self._each(outputs["terminated"])
            if ended.any():
                info |= {"final_obs": self._observed(outputs["final_obs"]), "_final_obs": ended}
        truncated = self._each(outputs["truncated"])
        if self._by_agent:
            rewards = outputs["rewards"].reshape(-1).astype(np.float64)
        else:
            rewards = outputs["team_reward"].astype(np.float64)
        return self._observed(outputs), rewards, self._each(outputs["terminated"]), truncated, info

    def close_extras(self, **_: Any) -> None:
        """Frees the memory of all episodes."""
        self.worlds.close()

    def _space(self) -> spaces.Space[Any]:
        worlds = self.worlds
        window, seats = worlds.window, () if self._by_agent else (worlds.num_agents,)
        if self._flat:
            row = self._layout.flat_space()
            return spaces.Box(-1.0, 1.0, (*seats, *row.shape), np.float32)
        view = worlds.buffers["view"]
        last = np.broadcast_to(np.array(worlds.size, np.int32) - 1, (*seats, 2)).copy()
        parts: dict[str, spaces.Space[Any]] = {
            "view": spaces.Box(0, 1 if view.ndim == 5 else len(CHANNELS) - 1, (*seats, *view.shape[2:]), np.uint8),
            "agents": spaces.Box(-1, worlds.num_agents - 1, (*seats, *window), np.int16),
            "position": spaces.Box(np.full((*seats, 2), -1, np.int32), last, dtype=np.int32),
            "round": spaces.Box(0, worlds.max_round, (), np.int32),
            "score": spaces.Box(0.0, np.inf, (), np.float32),
        }
        if worlds.flag is not None:
            parts[worlds.flag] = spaces.Box(0, 1, seats, np.uint8)
        return spaces.Dict(parts)

    def _observed(self, outputs: dict[str, Any]) -> Any:
        worlds = self.worlds
        seats = (worlds.num_envs, worlds.num_agents)
        if self._flat:
            rounds = np.broadcast_to(outputs["round"][:, None, None], (*seats, 1))
            parts = {"view": outputs["view"], "position": outputs["position"], "round": rounds}
            if worlds.flag is not None:
                parts[worlds.flag] = outputs[worlds.flag][..., None]
            flat = self._layout.flatten(parts)
            return flat.reshape(self.num_envs, -1) if self._by_agent else flat
        names = ["view", "agents", "position", *([worlds.flag] if worlds.flag is not None else [])]
        observed = {name: outputs[name].copy() for name in names}
        if self._by_agent:
            observed = {name: part.reshape(self.num_envs, *part.shape[2:]) for name, part in observed.items()}
        observed["round"], observed["score"] = self._each(outputs["round"]), self._each(outputs["score"])
        return observed

    def _each(self, by_episode: NDArray[Any]) -> NDArray[Any]:
        """The values of episodes, one for each environment."""
        return np.repeat(by_episode, self.worlds.num_agents) if self._by_agent else by_episode.copy()

    def _info(self, outputs: dict[str, Any]) -> dict[str, Any]:
        every = np.ones(self.num_envs, np.bool_)
        info: dict[str, Any] = {}
        for name in ("alive", "action_mask"):
            part = outputs[name]
            info[name] = (part.reshape(self.num_envs, *part.shape[2:]) if self._by_agent else part).copy()
        info["seed"], info["score"] = self._each(outputs["seed"]), self._each(outputs["score"])
        return info | {f"_{name}": every for name in list(info)}


def _refuse_single(task: TaskName, **_: Any) -> gymnasium.Env[Any, Any]:
    raise gymnasium.error.Error(
        f"swarmbench/{task}-v0 plays many episodes at once: make it with gymnasium.make_vec, or one alone with "
        f"swarmseat.parallel_env({task!r}, backend='native')"
    )


for _task in TASKS:
    gymnasium.register(
        f"swarmbench/{_task}-v0",
        entry_point=f"{__name__}:_refuse_single",
        vector_entry_point=f"{__name__}:gym_vector_env",
        kwargs={"task": _task},
    )
