"""An episode as a PettingZoo `ParallelEnv`."""

import time
from typing import Any, Literal

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from . import rewards as earned
from .arrays import (
    CHANNELS,
    MESSAGE_CHARS_MAX,
    PRINTABLE,
    PROMPT_CHARS_MAX,
    Layout,
    encode_cells,
    symbols_of,
)
from .client import Client
from .errors import TEMPORARY_STATUS, ApiError, SwarmbenchError, is_problem
from .server import Server
from .wire import EpisodeRequest, Observation, SwarmAct, SwarmObsResponse, TaskName

SEED_MAX = 2**53 - 1
ACTIONS = ("UP", "DOWN", "LEFT", "RIGHT", "STAY")
WAIT_S = 30.0
"""How long one request waits for the next round. All acts are in then, so it is open at once."""

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
    num_agents: int = 12,
    server: str | Server | Client | None = None,
    token: str | None = None,
    rewards: Literal["team", "individual"] = "team",
    observations: Literal["array", "text", "both"] = "array",
    messages: bool = False,
    render_mode: Literal["ansi", "human", "rgb_array"] | None = None,
    rules: Literal["paper", "reference"] = "paper",
    width: int = 10,
    height: int = 10,
    view_size: int = 5,
    memory: int = 5,
    max_round: int = 100,
    control: Literal["decentralized", "centralized"] = "decentralized",
    noise: float = 0.0,
    max_delay: int = 0,
    prompt_template: str | None = None,
    answer_reader: Literal["last-marker", "first-marker"] = "last-marker",
    model: str = "parallel_env",
    agent_meta: dict[str, Any] | None = None,
    visibility: Literal["public", "owner"] | None = None,
) -> "SwarmEnv":
    """One episode after the other as a PettingZoo `ParallelEnv`. docs/play/python.md has all shapes.

    Args:
        task: What is played.
        seed: The seed of the first episode. Those after it draw theirs, one after the other, from a generator that it
            seeds; `reset(seed=…)` begins anew with another one. Without any, seeds are drawn at random.
        num_agents: How many agents play.
        server: The address of a server, a `Server` or a `Client`. Where it is left out the environment starts a
            server of its own at the first `reset` and stops it with `close`.
        token: A key, where the server named by its address asks for one.
        rewards: `team`: the change of the score for everybody. `individual`: what the agents did themselves.
        observations: `array`: a dictionary of arrays. `text`: the server's prompt. `both`: the arrays with `prompt`.
        messages: Whether agents talk: an action then is `{"action": …, "message": …}`, and arrays come with `messages`.
        render_mode: What `render` makes of the whole map.
        rules: The rule set.
        width: Columns of the map.
        height: Rows of the map.
        view_size: Side of the window that an agent sees.
        memory: How many rounds a prompt remembers.
        max_round: After how many rounds an episode ends.
        control: Under `centralized` every agent sees the whole map.
        noise: The probability that a delivered message is corrupted.
        max_delay: By how many rounds a message may be late.
        prompt_template: A template for the prompts instead of the built-in one, or the name `toolkit`.
        answer_reader: How answers of language models are read.
        model: Under which name the episodes are kept.
        agent_meta: What else is kept with them.
        visibility: Who may watch; where it is left out the server decides.
    """
    settings: EpisodeRequest = {
        "task": task, "num_agents": num_agents, "rules": rules, "width": width, "height": height,
        "view_size": view_size, "memory": memory, "max_round": max_round, "control": control,
        "noise": noise, "max_delay": max_delay, "prompt_template": prompt_template,
        "answer_reader": answer_reader,
        "model": model, "agent_meta": agent_meta, "visibility": visibility,
    }  # fmt: skip
    return SwarmEnv(
        settings,
        seed=seed,
        server=server,
        token=token,
        rewards=rewards,
        observations=observations,
        messages=messages,
        render_mode=render_mode,
    )


class SwarmEnv(ParallelEnv[str, Any, Any]):
    """What `parallel_env` returns.

    Attributes:
        episode: The id of the episode that is played.
        seed: Its seed.
        score: Its score so far.
        actions: What the numbers of `Discrete` actions mean.
        seen: Of each agent the last observation as it came from the server.
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
        _one_of("rewards", rewards, ("team", "individual"))
        _one_of("observations", observations, ("array", "text", "both"))
        _one_of("render_mode", render_mode, (None, *self.metadata["render_modes"]))
        self.render_mode = render_mode
        self._settings = settings
        self._server, self._token = server, token
        self._own_server: Server | None = None
        self._client: Client | None = None
        self._rewards, self._observations, self._messages = rewards, observations, messages

        task, num_agents = settings["task"], int(settings["num_agents"] or 0)
        self.actions: tuple[str, ...] = (*ACTIONS, "SWITCH") if task == "Synchronization" else ACTIONS
        self._size = (int(settings["height"] or 0), int(settings["width"] or 0))
        side = int(settings["view_size"] or 0)
        window = self._size if settings["control"] == "centralized" else (side, side)
        max_round = int(settings["max_round"] or 0)
        self._layout = Layout(task, window, self._size, num_agents, max_round, messages)
        self.possible_agents = [f"Agent_{number}" for number in range(num_agents)]
        self.agents: list[str] = []
        self.observation_spaces = {agent: self._observation_space() for agent in self.possible_agents}
        self.action_spaces = {agent: self._action_space(agent) for agent in self.possible_agents}
        self.state_space = spaces.Box(0, 1, (len(CHANNELS), *self._size), np.uint8)

        self._generator, _ = seeding.np_random(seed)
        self._next_seed = seed
        self.seed: int | None = None
        self.episode: str | None = None
        self.score = 0.0
        self.seen: dict[str, Observation] = {}
        self._swarm: Client | None = None
        self._seats: dict[str, str] = {}
        self._cursor: str | None = None
        self._is_over = True

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """What the agent's observations are in; the same object every time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """What the agent's actions are in; the same object every time."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begins a new episode, and aborts the one that is not at its end. There are no options."""
        del options
        if seed is not None:
            self._generator, _ = seeding.np_random(seed)
            self._next_seed = seed
        self._abort()
        client = self._connect()
        drawn = int(self._generator.integers(SEED_MAX, endpoint=True)) if self._next_seed is None else self._next_seed
        self._next_seed = None
        settings = self._settings.copy()
        settings["seed"] = int(drawn)
        created = client.create_episode(**settings)
        self.seed, self.episode, self.score = int(drawn), created["id"], 0.0
        self._seats = {seat["agent"]: seat["token"] for seat in created["seats"]}
        self._swarm = client.with_token(created["swarm_token"])
        self._cursor, self._is_over = None, created["status"] != "running"
        self.agents = list(self.possible_agents)
        self.seen = {}
        self._look()
        observations, infos = self._told(self.agents)
        if self._is_over:
            # A layout can be done before the first round; then there is nothing to do in it.
            self.agents = []
        return observations, infos

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Plays a round with an action for each agent in `agents`."""
        agents, swarm = self.agents, self._swarm
        if swarm is None or self.episode is None:
            raise SwarmbenchError("there is no episode yet: call reset()")
        if not agents:
            return {}, {}, {}, {}, {}
        missing = [agent for agent in agents if agent not in actions]
        if missing:
            raise ValueError(
                f"a round takes an action of every agent in `agents`; there is none of {', '.join(missing)}"
            )
        before = {agent: self.seen[agent] for agent in agents}
        self._send(swarm, [self._act(agent, before[agent]["round"], actions[agent]) for agent in agents])
        self._look()
        after = {agent: self.seen[agent] for agent in agents}

        if self._rewards == "team":
            gains = earned.team(before, after)
        else:
            gains = earned.individual(self._settings["task"], before, after)
        # The number of rounds belongs to the game and is seen by all, so its end is an end of the game, as is an
        # escape. Only what comes from outside, an abort or a time-out, cuts it off.
        is_cut = self._is_over and after[agents[0]]["status"] != "finished"
        terminations = {agent: not is_cut and (self._is_over or not after[agent]["alive"]) for agent in agents}
        truncations = dict.fromkeys(agents, is_cut)
        observations, infos = self._told(agents)
        self.agents = [agent for agent in agents if not (terminations[agent] or truncations[agent])]
        if self.render_mode == "human":
            self.render()
        return observations, gains, terminations, truncations, infos

    def render(self) -> str | NDArray[np.uint8] | None:
        """The whole map as it is now: as text (`ansi`), printed (`human`), or as pixels (`rgb_array`)."""
        if self.render_mode is None:
            raise SwarmbenchError("nothing is rendered: name a render_mode when the environment is made")
        rows = self._map()
        if self.render_mode == "rgb_array":
            channels, _ = encode_cells(rows)
            palette = np.array([COLORS[name] for name in CHANNELS], np.uint8)
            image: NDArray[np.uint8] = palette[channels.argmax(axis=0)]
            return image.repeat(CELL_PIXELS, axis=0).repeat(CELL_PIXELS, axis=1)
        wide = max(len(symbol) for row in rows for symbol in row)
        shown = next(iter(self.seen.values()))
        head = f"{self._settings['task']}, seed {self.seed}, round {shown['round']}/{shown['max_round']}"
        lines = [f"{head}, score {self.score:.2f}"]
        lines += [" ".join(symbol.rjust(wide) for symbol in row) for row in rows]
        text = "\n".join(lines) + "\n"
        if self.render_mode == "human":
            print(text)
            return None
        return text

    def state(self) -> NDArray[np.uint8]:
        """The whole map in the channels of a `view`, for training that may see more than agents do."""
        channels, _ = encode_cells(self._map())
        return channels

    def close(self) -> None:
        """Aborts the episode that is not at its end, and stops the server if it is the environment's own."""
        self.agents = []
        if isinstance(self._server, Server) and not self._server.is_running:
            # It is gone, and with it whatever was played there.
            self._swarm = None
        try:
            self._abort()
        finally:
            if self._client is not None and not isinstance(self._server, Client):
                self._client.close()
            self._client = None
            if self._own_server is not None:
                self._own_server.stop()
                self._own_server = None

    # Spaces.

    def _observation_space(self) -> spaces.Space[Any]:
        # A prompt consists of printable ASCII but for what a template of one's own puts in.
        characters = PRINTABLE | {"\n"} | set(self._settings["prompt_template"] or "")
        prompt = spaces.Text(PROMPT_CHARS_MAX, min_length=0, charset=frozenset(characters))
        if self._observations == "text":
            return prompt
        parts = self._layout.space()
        if self._observations == "both":
            parts["prompt"] = prompt
        return spaces.Dict(parts)

    def _action_space(self, agent: str) -> spaces.Space[Any]:
        action: spaces.Space[Any] = spaces.Discrete(len(self.actions))
        if not self._messages:
            return action
        parts = {
            "action": action,
            "message": spaces.Text(MESSAGE_CHARS_MAX, min_length=0, charset=PRINTABLE),
        }
        if self._settings["control"] == "centralized" and agent == "Agent_0":
            # Whom alone the commander tells it; 0, which is the commander itself, stands for everybody.
            parts["to"] = spaces.Discrete(len(self.possible_agents))
        return spaces.Dict(parts)

    # What goes over the wire.

    def _connect(self) -> Client:
        if self._client is None:
            if isinstance(self._server, Client):
                self._client = self._server
            elif isinstance(self._server, Server):
                self._client = self._server.client()
            elif self._server is None:
                self._own_server = Server().start()
                self._client = self._own_server.client()
            else:
                self._client = Client(self._server, self._token)
        return self._client

    def _abort(self) -> None:
        swarm, self._swarm = self._swarm, None
        if swarm is None or self.episode is None or self._is_over:
            return
        self._is_over = True
        try:
            swarm.abort_episode(self.episode)
        except ApiError as error:
            # Somebody else ended it.
            if error.code != "episode_over":
                raise

    def _act(self, agent: str, round: int, action: Any) -> SwarmAct:
        act: SwarmAct = {"episode": self.episode or "", "agent": agent, "round": round}
        number = int(action["action"] if self._messages else action)
        if not 0 <= number < len(self.actions):
            raise ValueError(f"{agent} has the actions 0 to {len(self.actions) - 1}, and not {number}")
        act["action"] = self.actions[number]
        if not self._messages:
            return act
        if action["message"]:
            act["message"] = action["message"]
            if action.get("to"):
                act["to"] = f"Agent_{int(action['to'])}"
        return act

    def _send(self, swarm: Client, acts: list[SwarmAct]) -> None:
        """Sends acts until all are taken. Those that the server had no place for are sent again."""
        for attempt in range(swarm.retry.times + 1):
            receipts = swarm.swarm_act(acts)["receipts"]
            answered = zip(acts, receipts, strict=True)
            refused = [(act, ApiError(receipt)) for act, receipt in answered if is_problem(receipt)]
            lasting = [error for _, error in refused if error.status not in TEMPORARY_STATUS]
            if any(error.code == "episode_over" for error in lasting):
                # Somebody ended the episode; the next look says how.
                return
            if lasting:
                raise lasting[0]
            if not refused:
                return
            if attempt == swarm.retry.times:
                raise refused[0][1]
            acts = [act for act, _ in refused]
            time.sleep(max(error.retry_after_s or swarm.retry.first_pause_s for _, error in refused))

    def _look(self) -> None:
        """Takes what every agent sees in the next round, or at the end."""
        swarm = self._swarm
        if swarm is None:
            raise SwarmbenchError("there is no episode yet: call reset()")
        wants_prompt = self._observations != "array" or None
        fresh: dict[str, Observation] = {}
        while not fresh and not self._is_over:
            answer: SwarmObsResponse = swarm.swarm_obs(after=self._cursor, wait=WAIT_S, limit=1024, prompt=wants_prompt)
            self._cursor = answer["cursor"]
            self._is_over = answer["finished"]
            fresh = {sight["agent"]: sight for sight in answer["observations"]}
        # An agent that has escaped waits for nothing any more, and nobody does once the episode has ended.
        for agent in self.agents:
            if agent not in fresh:
                fresh[agent] = swarm.with_token(self._seats[agent]).obs(prompt=wants_prompt)
        self.seen.update(fresh)
        self.score = fresh[self.agents[0]]["score"]

    def _map(self) -> list[list[str]]:
        if self._swarm is None or self.episode is None:
            raise SwarmbenchError("there is no episode yet: call reset()")
        return symbols_of(self._swarm.state(self.episode))

    # What is told of it.

    def _told(self, agents: list[str]) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        observations = {agent: self._encode(self.seen[agent]) for agent in agents}
        infos = {
            agent: {
                "round": self.seen[agent]["round"],
                "score": self.seen[agent]["score"],
                "alive": self.seen[agent]["alive"],
                "messages": self.seen[agent]["messages"],
            }
            for agent in agents
        }
        return observations, infos

    def _encode(self, sight: Observation) -> Any:
        if self._observations == "text":
            return sight.get("prompt")
        parts = self._layout.encode(sight)
        if self._observations == "both":
            parts["prompt"] = sight.get("prompt")
        return parts


def _one_of(name: str, value: object, allowed: tuple[object, ...]) -> None:
    if value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, allowed))}, is {value!r}")
