"""Episodes as PettingZoo environments: PettingZoo's own tests, and further ones."""

import json
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from pettingzoo.test.api_test import api_test
from pettingzoo.test.parallel_test import parallel_api_test
from pettingzoo.test.render_test import render_test
from pettingzoo.test.seed_test import parallel_seed_test, seed_test
from pettingzoo.test.state_test import state_test
from pettingzoo.utils.conversions import parallel_to_aec

from swarmseat import ArgumentError, Client, Server, ServerError, SwarmbenchError, SwarmEnv, parallel_env
from swarmseat.arrays import CHANNELS
from swarmseat.names import TASKS, TaskName

Make = Callable[..., SwarmEnv]


@pytest.fixture
def make(server: Server) -> Iterator[Make]:
    """Makes environments on the server of all tests, and closes them."""
    made: list[SwarmEnv] = []

    def make(task: TaskName = "Foraging", **settings: Any) -> SwarmEnv:
        made.append(parallel_env(task, **{"server": server, "max_round": 10, **settings}))
        return made[-1]

    yield make
    for env in made:
        env.close()


# PettingZoo advises arrays, and names in lower case. Ours are dictionaries, and the names are those of the server.
advice = pytest.mark.filterwarnings(
    "ignore:Observation is not a NumPy array",
    "ignore:Observation space for each agent probably",
    "ignore:We recommend agents to be named",
    "ignore:Action space for each agent probably",
)


@pytest.mark.parametrize("settings", [
    {}, {"observations": "text"}, {"observations": "both", "messages": True, "noise": 0.5, "max_delay": 2},
    {"control": "centralized", "messages": True, "height": 8, "width": 12}, {"rules": "reference", "view_size": 3},
    {"rewards": "individual", "num_agents": 1},
], ids=str)  # fmt: skip
@pytest.mark.parametrize("task", TASKS)
def test_it_is_a_parallel_environment(make: Make, task: TaskName, settings: dict[str, Any]) -> None:
    parallel_api_test(make(task, num_agents=settings.pop("num_agents", 4), **settings))


def test_forks_play_on_from_the_same_state(make: Make) -> None:
    env = make("Synchronization", seed=27, num_agents=3)
    with pytest.raises(SwarmbenchError, match="reset"):
        env.fork()
    env.reset()
    env.step(dict.fromkeys(env.agents, 5))
    one, two = env.fork(2)
    with one, two:
        assert len({env.episode, one.episode, two.episode}) == 3
        assert data_equivalence(env.step(dict.fromkeys(env.agents, 5)), one.step(dict.fromkeys(one.agents, 5)))
        two.step(dict.fromkeys(two.agents, 0))
        assert data_equivalence(env.state(), one.state())
        assert not data_equivalence(env.state(), two.state())
        assert two.reset()[1].keys() == env.reset()[1].keys()
        assert two.seed == env.seed
    with pytest.raises(ArgumentError, match="count"):
        env.fork(65)


@advice
@pytest.mark.parametrize("settings", [{}, {"messages": True}], ids=str)  # It knows no text observations.
def test_it_is_a_turn_based_environment(make: Make, settings: dict[str, Any]) -> None:
    api_test(parallel_to_aec(make("Pursuit", num_agents=3, **settings)), num_cycles=30)


def test_it_follows_from_its_seed(make: Make) -> None:
    parallel_seed_test(lambda: make("Pursuit", messages=True))
    seed_test(lambda: parallel_to_aec(make("Synchronization", num_agents=3)), num_cycles=20)


def test_it_is_drawn(make: Make) -> None:
    def turns(render_mode: str) -> Any:
        return parallel_to_aec(make("Transport", num_agents=3, render_mode=render_mode))

    render_test(turns)  # type: ignore[arg-type] # its own annotation leaves out the argument that it passes
    env = make("Foraging", seed=27, render_mode="ansi", num_agents=3)
    env.reset()
    text = env.render()
    assert isinstance(text, str)
    assert text.startswith("Foraging, seed 27, round 0/10, score 0.00\nW W W W W W W W W W\n")
    with pytest.raises(SwarmbenchError, match="render_mode"):
        make().render()


def test_it_has_a_state_for_central_training(make: Make) -> None:
    env = make("Pursuit", num_agents=3)
    state_test(parallel_to_aec(env), env)
    env.reset(seed=5)
    state = env.state()
    assert env.state_space.contains(state)
    assert (state.sum(axis=0) == 1).all()
    for agent, sight in env.seen.items():
        place = sight["position"]
        assert place is not None
        assert state[CHANNELS.index("agent"), place["i"], place["j"]] == 1, agent


def random_game(env: SwarmEnv, seed: int) -> list[Any]:
    told: list[Any] = [env.reset(seed=seed)]
    for space in env.action_spaces.values():
        space.seed(seed)
    while env.agents:
        told.append(env.step({agent: env.action_space(agent).sample() for agent in env.agents}))
    return told


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("settings", [
    {"observations": "both", "messages": True, "noise": 0.3}, {"control": "centralized", "messages": True},
    {"rules": "reference", "rewards": "individual"},
], ids=str)  # fmt: skip
def test_whole_games_are_the_same_and_in_their_spaces(make: Make, task: TaskName, settings: dict[str, Any]) -> None:
    env = make(task, num_agents=5, **settings)
    game, other = random_game(env, 7), random_game(make(task, num_agents=5, **settings), 7)
    assert data_equivalence(game, other)
    for observations, *_ in game:
        for agent, observation in observations.items():
            assert env.observation_space(agent).contains(observation)


def test_episodes_differ_and_are_the_same_again_in_their_order(make: Make) -> None:
    seeds = []
    for _ in range(2):
        env = make(seed=27)
        first = [(env.reset(), env.seed)[1] for _ in range(3)]
        env.reset(seed=5)
        seeds.append([*first, env.seed, (env.reset(), env.seed)[1]])
    assert seeds[0] == seeds[1]
    assert seeds[0][0] == 27
    assert seeds[0][3] == 5
    assert len(set(seeds[0])) == 5
    without = make()
    assert len({(without.reset(), without.seed)[1] for _ in range(2)}) == 2


def test_arrays_say_what_the_agent_sees(make: Make) -> None:
    env = make("Synchronization", num_agents=12, seed=42, messages=True)
    observations, _ = env.reset()
    observations, *_ = env.step({agent: {"action": 5, "message": f"I am {agent}"} for agent in env.agents})
    letters = {"empty": ".", "outside": "*", "wall": "W", "self": "Y"}
    for agent, observation in observations.items():
        sight = env.seen[agent]
        assert sight["view"] is not None
        for a, row in enumerate(sight["view"]["cells"]):
            for b, symbol in enumerate(row):
                (channel,) = np.flatnonzero(observation["view"][:, a, b])
                name, number = CHANNELS[channel], observation["agents"][a, b]
                shown = letters.get(name, f"${number}" if name == "marked agent" else str(number))
                assert shown == symbol
                assert (number >= 0) == (name in {"agent", "marked agent"})
        assert observation["position"].tolist() == list((sight["position"] or {}).values())
        assert observation["round"] == [1]
        assert observation["light_on"] == [sight["light_on"]]
        assert observation["messages"] == tuple(sight["messages"])
    assert any(observation["messages"] for observation in observations.values())
    assert any(observation["light_on"] == [1] for observation in observations.values())
    foraging, _ = make("Foraging", num_agents=2).reset()
    assert foraging["Agent_0"]["carrying_food"] == [0]
    assert "light_on" not in foraging["Agent_0"]


def test_text_is_the_prompt_of_the_server(make: Make) -> None:
    env = make("Foraging", observations="text", prompt_template="Grüße an {{ agent }} in Runde {{ round }}")
    observations, _ = env.reset()
    assert observations["Agent_3"] == "Grüße an Agent_3 in Runde 0"
    assert env.observation_space("Agent_3").contains(observations["Agent_3"])


def test_the_commander_speaks_to_one_or_to_all(make: Make) -> None:
    env = make("Foraging", control="centralized", messages=True, num_agents=3)
    env.reset()
    act: dict[str, dict[str, Any]] = {agent: {"action": 4, "message": ""} for agent in env.agents}
    act["Agent_0"] = {"action": 4, "message": "go", "to": 2}
    act["Agent_1"]["message"] = "hello"
    *_, infos = env.step(act)
    assert {agent: info["messages"] for agent, info in infos.items()} == {
        "Agent_0": ["hello"], "Agent_1": [], "Agent_2": ["go"],
    }  # fmt: skip
    act["Agent_0"]["to"] = 0
    *_, infos = env.step(act)
    assert infos["Agent_1"]["messages"] == infos["Agent_2"]["messages"] == ["go"]


# Games of the server's own players, played again through the environment: only these score in every task.


def recorded(client: Client, **settings: Any) -> tuple[float, list[dict[str, str | None]]]:
    """The score of a game, and the acts of all agents in all rounds."""
    created = client.create_episode(**settings)
    result = list(client.events(created["id"]))[-1].data
    records = [json.loads(line)["record"] for line in client.journal(created["id"]).splitlines()]
    rounds = [record for record in records if record["kind"] == "round"]
    return result["score"], [{act["agent"]: act.get("action") for act in record["acts"]} for record in rounds]


def beside_prey(client: Client, env: SwarmEnv) -> set[str]:
    """The agents beside the cell where the prey was before this round, as spectators see it."""
    round = next(iter(env.seen.values()))["round"]
    before, after = (client.state(env.episode or "", round=number) for number in (round - 1, round))
    prey = before["prey"]
    assert prey is not None
    distances = {agent["agent"]: abs(agent["i"] - prey["i"]) + abs(agent["j"] - prey["j"]) for agent in after["agents"]}
    return {agent for agent, distance in distances.items() if distance == 1}


@pytest.mark.parametrize(("task", "player", "rules"), [
    ("Transport", "push-and-leave", "paper"), ("Pursuit", "close-in", "paper"), ("Pursuit", "close-in", "reference"),
    ("Foraging", "map-and-carry", "paper"), ("Synchronization", "round-clock", "paper"),
    ("Flocking", "meet-in-the-middle", "paper"),
])  # fmt: skip
def test_rewards_are_what_was_scored(client: Client, make: Make, task: TaskName, player: str, rules: str) -> None:
    score, rounds = recorded(client, task=task, seed=27, player=player, rules=rules, max_round=60)
    assert score > 0
    # An agent that has escaped has a prompt, too.
    shown = "both" if task == "Transport" else "array"
    own = make(task, max_round=60, rules=rules, rewards="individual", observations=shown)
    own.reset(seed=27)
    sums, left = dict.fromkeys(own.agents, 0.0), set()
    for acts in rounds:
        actions = {agent: own.actions.index(acts.get(agent) or "STAY") for agent in own.agents}
        before = own.score
        observations, gains, ended, cut, _ = own.step(actions)
        for agent, gain in gains.items():
            sums[agent] += gain
        assert not any(cut.values())
        is_over = any(sight["status"] == "finished" for sight in own.seen.values())
        for agent in gains:
            assert ended[agent] == (is_over or not own.seen[agent]["alive"])
            assert (agent in own.agents) == (not ended[agent])
            if not own.seen[agent]["alive"]:
                left.add(agent)
                assert own.observation_space(agent).contains(observations[agent])
                assert observations[agent]["position"].tolist() == [-1, -1]
                assert observations[agent]["view"][CHANNELS.index("outside")].all()
        if task == "Pursuit" and own.score > before and (rules == "paper" or before > 0):
            # The first prey of `reference` may have been pushed before it was caught.
            assert {agent for agent, gain in gains.items() if gain > 0} == beside_prey(client, own)
    assert own.agents == []
    assert own.score == score
    if task in {"Transport", "Pursuit", "Foraging"}:
        assert sum(sums.values()) == pytest.approx(score)
        assert len(set(sums.values())) > 1
    else:
        assert list(sums.values()) == pytest.approx([score] * 12)
    assert (len(left) == 12) == (task == "Transport")


def test_what_somebody_else_ends_is_truncated(client: Client, make: Make) -> None:
    env = make(num_agents=3)
    env.reset()
    assert env.episode is not None
    client.abort_episode(env.episode)
    *_, ended, cut, _ = env.step(dict.fromkeys(env.agents, 4))
    assert not any(ended.values())
    assert all(cut.values())
    assert env.agents == []
    assert env.step({}) == ({}, {}, {}, {}, {})


def test_an_unfinished_episode_is_aborted(client: Client, make: Make) -> None:
    env = make(num_agents=2, max_round=2, model="counted")
    env.reset()
    for _ in range(2):
        env.step(dict.fromkeys(env.agents, 0))
    for _ in range(3):
        env.reset()
    env.close()
    states = [episode["status"] for episode in client.paginate(client.episodes, model="counted")]
    assert states == ["aborted"] * 3 + ["finished"]
    env.reset()
    assert len(env.agents) == 2


def test_a_game_that_is_done_before_it_begins_has_nothing_to_do(make: Make) -> None:
    # A single agent is a flock already.
    env = make("Flocking", num_agents=1)
    observations, _ = env.reset()
    assert list(observations) == ["Agent_0"]
    assert env.agents == []


def test_acts_without_a_place_are_sent_again(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    pauses: list[float] = []
    monkeypatch.setattr("swarmseat.environment.time.sleep", pauses.append)
    real = httpx.Client()
    refused = {"type": "urn:swarmbench:problem:overloaded", "title": "…", "status": 503, "detail": "…"}
    refused |= {"code": "overloaded", "retry_after_ms": 700}
    sizes: list[int] = []

    def handle(request: httpx.Request) -> httpx.Response:
        """Withholds the last act from the server at first, and answers that the server had no place for it."""
        content, more, url = request.content, [], request.url
        if request.url.path == "/swarm/act":
            acts = json.loads(content)["acts"]
            sizes.append(len(acts))
            if len(sizes) % 2:
                content, more, url = json.dumps({"acts": acts[:-1]}).encode(), [refused], url.copy_set_param("wait", 0)
        headers = {name: request.headers[name] for name in ("authorization", "content-type") if name in request.headers}
        answer = real.request(request.method, url, content=content, headers=headers)
        told = answer.json()
        if more:
            told["receipts"] += more
        return httpx.Response(answer.status_code, json=told)

    client = Client(server.url, "", http=httpx.Client(transport=httpx.MockTransport(handle)))
    env = parallel_env(num_agents=3, max_round=2, server=client)
    env.reset()
    while env.agents:
        env.step(dict.fromkeys(env.agents, 4))
    assert sizes == [3, 3, 3, 3]
    assert pauses == [0.7, 0.7]
    real.close()


def test_it_starts_and_stops_a_server_of_its_own() -> None:
    env = parallel_env("Foraging", num_agents=2, max_round=3)
    env.reset(seed=1)
    assert env._resources is not None
    own = env._resources._own_server
    assert own is not None
    assert own.is_running
    env.step({"Agent_0": 0, "Agent_1": 1})
    env.close()
    assert "stopped" in repr(own)
    env.reset()
    env.close()


def test_a_server_may_be_stopped_before_its_environments() -> None:
    with Server() as server:
        env = parallel_env("Foraging", num_agents=1, server=server)
        env.reset()
    env.close()
    with pytest.raises(ServerError, match="not started"):
        env.reset()
