"""An episode as a PettingZoo `ParallelEnv`."""

import copy
import time
import weakref
from collections.abc import Iterable, Mapping
from types import TracebackType
from typing import Any, Literal, cast, get_args

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from . import rewards as earned
from ._compat import Self, Unpack
from .actions import Actions
from .arrays import CHANNELS, PRINTABLE, PROMPT_CHARS_MAX, Layout, encode_cells, symbols_of
from .checks import agent_name, one_of, shown, task_name, whole
from .client import Client
from .errors import ApiError, ArgumentError, SwarmbenchError, is_refused
from .names import AnswerReader, Rewards, TaskName, Visibility
from .resources import Resources, check_server
from .server import Server
from .settings import SEED_MAX, GameSettings, complete
from .wire import CreatedEpisode, EpisodeRequest, Observation, SwarmAct

FORKS_MAX = 64
WAIT_S = 30.0
"""The maximum time that one request waits for the next round. All acts are in then, so the round is open at once."""

COLORS = {
    "empty": (255, 255, 255), "outside": (0, 0, 0), "wall": (70, 70, 70), "block": (150, 90, 40),
    "prey": (200, 40, 40), "nest": (240, 200, 60), "food": (60, 160, 60), "self": (40, 90, 200),
    "agent": (40, 90, 200), "marked agent": (250, 140, 20),
}  # fmt: skip
CELL_PIXELS = 16


def parallel_env(
    task: TaskName = "Foraging",
    *,
    seed: int | None = None,
    server: str | Server | Client | None = None,
    token: str | None = None,
    rewards: Rewards = "team",
    observations: Literal["array", "flat", "text", "both"] = "array",
    messages: bool = False,
    render_mode: Literal["ansi", "human", "rgb_array"] | None = None,
    prompt_template: str | None = None,
    answer_reader: AnswerReader = "last-marker",
    model: str = "parallel_env",
    agent_meta: dict[str, Any] | None = None,
    visibility: Visibility | None = None,
    backend: Literal["http", "native"] = "http",
    **settings: Unpack[GameSettings],
) -> "SwarmEnv":
    """One episode after the other as a PettingZoo `ParallelEnv`. docs/play/python.md has all shapes.

    Close the environment, or use it in a `with` block. An environment that is not closed ends its episode, and a server
    of its own, when it is collected or the program ends, with a `ResourceWarning`.

    Args:
        task: The name of the task.
        seed: The seed of the first episode. Later episodes draw their seeds, one after the other, from a generator that
            it seeds; `reset(seed=…)` begins anew with another seed. Default: random seeds.
        server: The address of a server, a `Server` or a `Client`. Default: the environment starts a server of its own
            at the first `reset` and stops it with `close`.
        token: A key, if the server named by its address requires one.
        rewards: `team`: every agent earns the change of the score. `individual`: each agent earns its own part.
        observations: `array`: a dictionary of arrays. `flat`: one vector with the planes, position, round and flag, for
            ordinary learners. `text`: the server's prompt. `both`: the arrays with `prompt`.
        messages: Whether agents talk: an action then is `{"action": …, "message": …}`, and arrays come with `messages`.
        render_mode: The form in which `render` returns the whole map.
        prompt_template: A template for the prompts instead of the built-in one, or the name `toolkit`.
        answer_reader: The reader of answers of language models.
        model: The name of the model with which the episodes are stored.
        agent_meta: Further data about the player that is stored with the episodes.
        visibility: The visitors who may watch. Default: the server decides.
        backend: `http` plays on a server. `native` plays in this process, a hundred times as fast; it needs the native
            module, and takes neither `server` nor `token`.
        **settings: Settings of the game, as in `swarmseat.settings.GameSettings`.

    Raises:
        ArgumentError: An argument cannot be right. The first `reset` refuses what only the server can check.
    """
    check_server(server, token)
    request = cast("EpisodeRequest", {
        "task": task_name(task), **complete(settings), "prompt_template": prompt_template,
        "answer_reader": answer_reader, "model": model, "agent_meta": agent_meta, "visibility": visibility,
    })  # fmt: skip
    options: dict[str, Any] = {
        "seed": seed, "rewards": rewards, "observations": observations, "messages": messages,
        "render_mode": render_mode,
    }  # fmt: skip
    one_of("backend", backend, ("http", "native"))
    if backend == "native":
        if server is not None or token is not None:
            raise ArgumentError("backend='native' plays in this process: it takes no server and no token")
        from .native_environment import NativeSwarmEnv  # noqa: PLC0415 - only wheels have the native module

        return NativeSwarmEnv(request, **options)
    return SwarmEnv(request, server=server, token=token, **options)


class SwarmEnv(ParallelEnv[str, Any, Any]):
    """The environment of `parallel_env`.

    Attributes:
        episode: The id of the episode that is played.
        seed: The seed of the episode.
        score: The score of the episode so far.
        actions: The names of `Discrete` actions, by their numbers.
        seen: The last observation of each agent, as it came from the server.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as PettingZoo declares it
        "name": "swarmbench",
        "render_modes": ["ansi", "human", "rgb_array"],
        "render_fps": 4,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        settings: EpisodeRequest,
        *,
        seed: int | None,
        server: str | Server | Client | None,
        token: str | None,
        rewards: str,
        observations: str,
        messages: bool,
        render_mode: str | None,
    ) -> None:
        one_of("rewards", rewards, get_args(Rewards))
        one_of("observations", observations, ("array", "flat", "text", "both"))
        one_of("render_mode", render_mode, (None, *self.metadata["render_modes"]))
        if not isinstance(messages, bool | np.bool_):
            raise ArgumentError(f"messages must be True or False, is {shown(messages)}")
        if messages and observations == "flat":
            raise ArgumentError("a flat observation is numbers only, so there are no messages in it: messages=False")
        if seed is not None:
            seed = whole("seed", seed, 0, SEED_MAX)
        self.render_mode = render_mode
        self._settings = settings
        self._server, self._token = server, token
        self._resources: Resources | None = None
        self._finalizer: weakref.finalize[Any, Any] | None = None
        self._is_closed = False
        self._rewards, self._observations, self._messages = rewards, observations, messages
        self._wants_prompt = observations in {"text", "both"} or None

        game = cast("GameSettings", settings)
        task, num_agents = settings["task"], game["num_agents"]
        self._actions = Actions(task, num_agents, bool(messages), game["control"])
        self.actions: tuple[str, ...] = self._actions.names
        self._size = (game["height"], game["width"])
        window = self._size if game["control"] == "centralized" else (game["view_size"], game["view_size"])
        self._layout = Layout(task, window, self._size, num_agents, game["max_round"], messages)
        self.possible_agents = [f"Agent_{number}" for number in range(num_agents)]
        self.agents: list[str] = []
        self.observation_spaces = {agent: self._observation_space() for agent in self.possible_agents}
        self.action_spaces = {agent: self._actions.space(agent) for agent in self.possible_agents}
        self.state_space = spaces.Box(0, 1, (len(CHANNELS), *self._size), np.uint8)

        self._generator, _ = seeding.np_random(seed)
        self._next_seed = seed
        self.seed: int | None = None
        self.episode: str | None = None
        self.score = 0.0
        self.seen: dict[str, Observation] = {}
        self._seats: dict[str, str] = {}
        self._round = 0
        self._is_over = True

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The space of the agent's observations; the same object every time."""
        return self.observation_spaces[agent_name(agent, self.possible_agents)]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The space of the agent's actions; the same object every time."""
        return self.action_spaces[agent_name(agent, self.possible_agents)]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begins a new episode, and aborts an unfinished one. There are no options."""
        del options
        self._reseed(seed)
        self._begin()
        observations, infos = self._outputs(self.agents)
        if self._is_over:
            # A layout can be solved before the first round; then no agent acts.
            self.agents = []
        return observations, infos

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Plays a round with an action for each agent in `agents`.

        Raises:
            SwarmbenchError: There is no episode, or the episode is over and there are actions.
            ArgumentError: An action is missing, not in its space, or of an agent that has left. Nothing was played.
        """
        self._check_playing()
        self._check_agents(actions)
        agents = self.agents
        if not agents:
            return {}, {}, {}, {}, {}
        gains, terminations, truncations = self._resolve(actions)
        observations, infos = self._outputs(agents)
        self.agents = [agent for agent in agents if not (terminations[agent] or truncations[agent])]
        if self.render_mode == "human":
            self.render()
        return observations, gains, terminations, truncations, infos

    def fork(self, count: int = 1) -> list[Self]:
        """Makes environments that continue from the state of this one, each with an episode of its own.

        The same actions lead to the same states in all forks, and their later episodes have the same seeds as this
        environment's. Over HTTP forks play on the server of this environment, and end with a server of its own.

        Raises:
            SwarmbenchError: There is no episode, or the episode is over.
        """
        count = whole("count", count, 1, FORKS_MAX)
        self._check_playing()
        if not self.agents:
            raise SwarmbenchError("the episode is over, so nothing is left to play: fork it earlier")
        return self._forks(count)

    def render(self) -> str | NDArray[np.uint8] | None:
        """The whole map as it is now: as text (`ansi`), printed (`human`), or as pixels (`rgb_array`)."""
        if self.render_mode is None:
            modes = ", ".join(map(repr, self.metadata["render_modes"]))
            raise SwarmbenchError(f"nothing is rendered: make the environment with a render_mode, one of {modes}")
        rows = self._map()
        if self.render_mode == "rgb_array":
            channels, _ = encode_cells(rows)
            palette = np.array([COLORS[name] for name in CHANNELS], np.uint8)
            image: NDArray[np.uint8] = palette[channels.argmax(axis=0)]
            return image.repeat(CELL_PIXELS, axis=0).repeat(CELL_PIXELS, axis=1)
        wide = max(len(symbol) for row in rows for symbol in row)
        head = f"{self._settings['task']}, seed {self.seed}, round {self._round}/{self._settings['max_round']}"
        lines = [f"{head}, score {self.score:.2f}"]
        lines += [" ".join(symbol.rjust(wide) for symbol in row) for row in rows]
        text = "\n".join(lines) + "\n"
        if self.render_mode == "human":
            print(text)
            return None
        return text

    def state(self) -> NDArray[np.uint8]:
        """The whole map in the channels of a `view`, for training that may see more than the agents."""
        channels, _ = encode_cells(self._map())
        return channels

    def close(self) -> None:
        """Aborts an unfinished episode, and stops the server if it is the environment's own.

        A later `reset` opens both again.
        """
        self.agents = []
        self._is_closed = True
        resources, self._resources = self._resources, None
        if self._finalizer is not None:
            self._finalizer.detach()
        if resources is not None:
            resources.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def __getstate__(self) -> dict[str, Any]:
        """The arguments: a copy, also one in another process, is before its first `reset`."""
        return {
            **self.__dict__, "agents": [], "seed": None, "episode": None, "score": 0.0, "seen": {}, "_seats": {},
            "_round": 0, "_is_over": True, "_is_closed": False, "_resources": None, "_finalizer": None,
        }  # fmt: skip

    # Seeds.

    def _reseed(self, seed: int | None) -> None:
        """Makes `seed`, if there is one, the next seed; later seeds follow from it."""
        if seed is not None:
            self._next_seed = whole("seed", seed, 0, SEED_MAX)
            self._generator, _ = seeding.np_random(self._next_seed)

    def _draw(self) -> int:
        """The seed of the next episode."""
        drawn, self._next_seed = self._next_seed, None
        return int(self._generator.integers(SEED_MAX, endpoint=True)) if drawn is None else drawn

    # Spaces.

    def _observation_space(self) -> spaces.Space[Any]:
        # A prompt consists of printable ASCII, except for the text of a custom template.
        characters = PRINTABLE | {"\n"} | set(self._settings["prompt_template"] or "")
        prompt = spaces.Text(PROMPT_CHARS_MAX, min_length=0, charset=frozenset(characters))
        if self._observations == "text":
            return prompt
        if self._observations == "flat":
            return self._layout.flat_space()
        parts = self._layout.space()
        if self._observations == "both":
            parts["prompt"] = prompt
        return spaces.Dict(parts)

    # Requests.

    def _open(self) -> Resources:
        if self._resources is None:
            self._resources = Resources(self._server, self._token)
            # Registered after the finalizer of a `Server`, so it is called before that one at the end of the program.
            name = f"parallel_env({self._settings['task']!r})"
            self._finalizer = weakref.finalize(self, self._resources.finalize, name)
            self._is_closed = False
        return self._resources

    def _playing(self) -> Client:
        """The client that plays the episode."""
        swarm = None if self._resources is None else self._resources.swarm
        if swarm is None:
            raise self._no_episode()
        return swarm

    def _check_playing(self) -> None:
        self._playing()

    def _no_episode(self) -> SwarmbenchError:
        return SwarmbenchError(
            "the environment is closed: reset() begins a new episode"
            if self._is_closed
            else "there is no episode yet: call reset()"
        )

    def _begin(self) -> None:
        """Begins an episode with all agents."""
        resources = self._open()
        resources.abort()
        self.agents, self._is_over = [], True
        drawn = self._draw()
        settings = self._settings.copy()
        settings["seed"] = drawn
        created = resources.client.create_episode(**settings)
        self.seed, self.score, self.seen = drawn, 0.0, {}
        self.agents = list(self.possible_agents)
        self._play_on(created)

    def _resolve(self, actions: dict[str, Any]) -> tuple[dict[str, float], dict[str, bool], dict[str, bool]]:
        """Plays a round. Returns the rewards of the agents in the game, and which are terminated or truncated."""
        agents = self.agents
        before = {agent: self.seen[agent] for agent in agents}
        self._play(self._playing(), [self._act(agent, before[agent]["round"], actions[agent]) for agent in agents])
        after = {agent: self.seen[agent] for agent in agents}
        if self._rewards == "team":
            gains = earned.team(before, after)
        else:
            gains = earned.individual(self._settings["task"], before, after)
        # The number of rounds belongs to the game and is seen by all, so the last round terminates the game, as an
        # escape does. Only an abort or a time-out, which come from outside, truncate it.
        is_cut = self._is_over and after[agents[0]]["status"] != "finished"
        terminations = {agent: not is_cut and (self._is_over or not after[agent]["alive"]) for agent in agents}
        return gains, terminations, dict.fromkeys(agents, is_cut)

    def _forks(self, count: int) -> list[Self]:
        resources, settings = self._open(), self._settings
        made = resources.client.fork(
            self.episode or "", round=self._round, count=count, model=settings.get("model"),
            agent_meta=settings.get("agent_meta"), visibility=settings.get("visibility"),
        )  # fmt: skip
        return [self._forked(resources.server, created) for created in made["episodes"]]

    def _forked(self, server: str | Server | Client | None, created: CreatedEpisode) -> Self:
        env = type(self)(
            self._settings, seed=None, server=server, token=self._token, rewards=self._rewards,
            observations=self._observations, messages=self._messages, render_mode=self.render_mode,
        )  # fmt: skip
        vars(env).update(
            seed=self.seed,
            agents=list(self.agents),
            _generator=copy.deepcopy(self._generator),
            _next_seed=self._next_seed,
        )
        env._play_on(created)  # noqa: SLF001 - it is of this class
        return env

    def _play_on(self, created: CreatedEpisode) -> None:
        """Takes an episode that has already begun."""
        self.episode, self._is_over = created["id"], False
        self._seats = {seat["agent"]: seat["token"] for seat in created["seats"]}
        self._open().begin(created)
        self._look(self._playing())

    def _check_agents(self, actions: Any) -> None:
        """Checks that all agents in the game have an action, and no other agent has one."""
        if not isinstance(actions, Mapping):
            raise ArgumentError(f"actions are a dictionary with an action for each agent, not {shown(actions)}")
        for agent, action in actions.items():
            agent_name(agent, self.possible_agents)
            # `None` is PettingZoo's name for no action, the only one of an agent that has left.
            if agent not in self.agents and action is not None:
                if not self.agents:
                    raise SwarmbenchError("the episode is over, as `env.agents` is empty: reset() begins a new one")
                raise ArgumentError(f"{agent} has left the game: only agents in `env.agents` act")
        missing = [agent for agent in self.agents if actions.get(agent) is None]
        if missing:
            raise ArgumentError(
                f"a round takes an action of every agent in `env.agents`; there is none of {', '.join(missing)}"
            )

    def _act(self, agent: str, round: int, action: Any) -> SwarmAct:
        act: SwarmAct = {"episode": self.episode or "", "agent": agent, "round": round}
        self._actions.read(agent, action, act)
        return act

    def _play(self, swarm: Client, acts: list[SwarmAct]) -> None:
        """Sends acts, and takes their agents' next observations. Usually that is one request.

        Acts for which the server had no place, and acts whose agents' next observations have not come, are sent again:
        a repeated act does not count twice, and its answer has the observation.
        """
        fresh: dict[str, Observation] = {}
        failures = 0
        while acts:
            answer = swarm.swarm_act(acts, wait=WAIT_S, prompt=self._wants_prompt)
            fresh |= {sight["agent"]: sight for sight in answer["observations"]}
            problems = [receipt for receipt in answer["receipts"] if is_refused(receipt)]
            problems += [answer["problem"]] if "problem" in answer else []
            errors = [ApiError(problem) for problem in problems]
            lasting = [error for error in errors if not error.is_temporary]
            if any(error.code == "episode_over" for error in lasting):
                # Another client ended the episode.
                self._look(swarm)
                return
            if lasting:
                raise lasting[0]
            acts = [act for act in acts if act["agent"] not in fresh]
            if errors and acts:
                if failures == swarm.retry.times:
                    raise errors[0]
                failures += 1
                time.sleep(max(error.retry_after_s or swarm.retry.first_pause_s for error in errors))
        self._take(fresh)

    def _look(self, swarm: Client) -> None:
        """Takes the observations of all agents in the open round, or at the end."""
        fresh: dict[str, Observation] = {}
        finished = False
        while not fresh and not finished:
            answer = swarm.swarm_obs(wait=WAIT_S, limit=1024, prompt=self._wants_prompt)
            finished = answer["finished"]
            fresh = {sight["agent"]: sight for sight in answer["observations"]}
        # No agent waits for an act once the episode has ended, and one answer cannot hold very long observations.
        for agent in self.agents:
            if agent not in fresh:
                fresh[agent] = swarm.with_token(self._seats[agent]).obs(prompt=self._wants_prompt)
        self._take(fresh)

    def _take(self, fresh: dict[str, Observation]) -> None:
        """Takes the newest observations of all agents that are in the game."""
        self.seen.update(fresh)
        newest = fresh[self.agents[0]]
        self.score, self._round = newest["score"], newest["round"]
        self._is_over = newest["status"] not in {"waiting", "running"}
        if self._is_over and self._resources is not None:
            self._resources.ended()

    def _map(self) -> list[list[str]]:
        return symbols_of(self._playing().state(self.episode or ""))

    # Outputs.

    def _outputs(self, agents: list[str]) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        seen = [self.seen[agent] for agent in agents]
        observations = dict(zip(agents, self._encode(seen), strict=True))
        infos = {
            agent: {
                "round": sight["round"],
                "score": sight["score"],
                "alive": sight["alive"],
                "messages": sight["messages"],
            }
            for agent, sight in zip(agents, seen, strict=True)
        }
        return observations, infos

    def _encode(self, seen: list[Observation]) -> Iterable[Any]:
        """The observations in the shape that the argument `observations` names."""
        if self._observations == "text":
            return [sight.get("prompt") for sight in seen]
        parts = self._layout.encode(seen)
        if self._observations == "flat":
            return self._layout.flatten(parts)
        if self._observations == "both":
            parts["prompt"] = [sight.get("prompt") for sight in seen]
        return [dict(zip(parts, row, strict=True)) for row in zip(*parts.values(), strict=True)]
