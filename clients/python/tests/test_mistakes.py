"""Mistakes of new users: each error is one of the package and names the mistake."""

import json
import math
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import numpy as np
import pytest
from test_client import answering, ok

from swarmseat import (
    ApiError,
    ArgumentError,
    AsyncClient,
    Client,
    ConnectionFailedError,
    Retry,
    Server,
    SwarmbenchError,
    SwarmEnv,
    parallel_env,
)
from swarmseat.exchange import call

BOTH = {"Agent_0": 0, "Agent_1": 0}


@pytest.mark.parametrize(("server", "told"), [
    ("localhost:8080", "begins with http:// or https://.*'localhost:8080'"), ("example.org", "begins with http"),
    ("ftp://example.org", "begins with http"), ("http://", "has a host"), ("http://a/?b=c", "neither query nor"),
    ("http://[::1", "no address of a server"), (8080, "is a text.*it is 8080"),
])  # fmt: skip
def test_an_address_that_is_none(server: Any, told: str) -> None:
    for kind in Client, AsyncClient:
        with pytest.raises(ArgumentError, match=told):
            kind(server)
    with pytest.raises(SwarmbenchError, match=told if isinstance(server, str) else "8080"):
        parallel_env(server=server)


def test_where_no_server_has_been_it_is_said_at_once() -> None:
    began = time.monotonic()
    for server in "http://127.0.0.1:9", "http://no-such-host.invalid":
        with Client(server, "") as client:
            with pytest.raises(ConnectionFailedError, match=f"no answer to GET {server}/healthz.*is the address right"):
                client.health()
            with pytest.raises(ConnectionFailedError, match="is the address right"):
                client.with_token("seat_a").obs()
            with pytest.raises(ConnectionFailedError, match="is the address right"):
                list(client.events("ep_1"))
    assert time.monotonic() - began < 5


def test_a_server_that_was_there_is_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    pauses: list[float] = []
    monkeypatch.setattr("swarmseat.client.time.sleep", pauses.append)
    transport, _ = answering(ok(), *[httpx.ConnectError("no")] * 3)
    client = Client("http://test", "", retry=Retry(times=2), http=httpx.Client(transport=transport))
    client.health()
    with pytest.raises(ConnectionFailedError, match=r"GET http://test/obs: no \(3 attempts\)"):
        client.with_token("seat_a").obs()
    assert len(pauses) == 2


def test_nothing_within_the_time() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        client = Client(f"http://127.0.0.1:{silent.getsockname()[1]}", "", timeout=0.2, retry=Retry(times=0))
        began = time.monotonic()
        with pytest.raises(ConnectionFailedError, match=r"nothing came within 0\.2 s") as error:
            client.health()
        assert 0.2 <= time.monotonic() - began < 3
        assert isinstance(error.value.__cause__, httpx.ReadTimeout)
        client.close()


@pytest.mark.parametrize("timeout", [0, -1, math.nan, math.inf, "5", None, True])
def test_a_timeout_that_is_none(timeout: Any) -> None:
    with pytest.raises(ArgumentError, match="timeout is a number of seconds above 0"):
        Client("http://test", "", timeout=timeout)


def test_tokens(server: Server, client: Client) -> None:
    token = client.create_episode(task="Foraging", num_agents=1)["seats"][0]["token"]
    for shown in f"Bearer {token}", f" {token}\n":
        with Client(server.url, shown) as seat:
            assert seat.obs()["agent"] == "Agent_0"
    for wrong in "seat_…", "seat_a\nb", "seat a", 5:
        with pytest.raises(ArgumentError, match="token") as error:
            client.with_token(wrong)  # type: ignore[arg-type]
        assert "seat" not in str(error.value) or wrong == 5
    for unknown in "seat_nobody", "":
        with pytest.raises(ApiError, match="401 unauthorized"):
            client.with_token(unknown).obs()


def test_a_closed_client(server: Server) -> None:
    client = server.client()
    client.close()
    for ask in client.health, lambda: list(client.events("ep_1")):
        with pytest.raises(SwarmbenchError, match="is closed: make another one"):
            ask()


@pytest.mark.parametrize(("ask", "told"), [
    (lambda c: c.episode(None), "not empty; it is None"), (lambda c: c.episode(""), "not empty; it is ''"),
    (lambda c: c.episode({"id": "ep_7"}), "'ep_7'"), (lambda c: c.obs(wait="long"), "'long'"),
    (lambda c: c.create_episode(task="Foraging", noise=math.nan), "'noise': nan"),
    (lambda c: c.create_episode(task="Foraging", agent_meta={"a": {1}}), r"\{1\}.* of set"),
    (lambda c: c.create_episode(task="Foraging", agent_meta={(1, 2): 3}), "keys must be"),
    (lambda c: c.swarm_act({"agent": "Agent_0"}), "list of acts.*not of dict"),
    (lambda c: c.swarm_act(None), "list of acts.*NoneType"),
])  # fmt: skip
def test_arguments_that_cannot_be_sent(client: Client, ask: Callable[[Any], Any], told: str) -> None:
    with pytest.raises(ArgumentError, match=told):
        ask(client)


def test_numbers_of_numpy_are_numbers(client: Client) -> None:
    created = client.create_episode(
        task="Foraging",
        seed=np.int64(27),  # type: ignore[arg-type]
        num_agents=np.uint8(3),  # type: ignore[arg-type]
    )
    assert len(created["seats"]) == 3
    sent = call("POST", "/", body={"weights": np.array([1.5, 2]), "on": np.bool_(True)}).body
    assert json.loads(sent or b"") == {"weights": [1.5, 2.0], "on": True}


def test_an_error_says_a_thing_once(client: Client) -> None:
    with pytest.raises(ApiError) as error:
        client.create_episode(task="Foraging", width=2)
    assert str(error.value).count("width must be") == 1


@pytest.fixture
def env(server: Server) -> Iterator[SwarmEnv]:
    with parallel_env(num_agents=2, max_round=2, server=server) as env:
        env.reset(seed=1)
        yield env


@pytest.mark.parametrize(("settings", "told"), [
    ({"task": "Forage"}, "task must be one of 'Transport'.*is 'Forage'"), ({"num_agents": "2"}, "num_agents.*is '2'"),
    ({"num_agents": 5000}, "1 to 1024"), ({"max_round": 1.5}, "max_round.*is 1.5"), ({"width": 0}, "width.*is 0"),
    ({"noise": 2}, "noise.*0 to 1"), ({"noise": "0.5"}, "noise.*'0.5'"), ({"seed": "27"}, "seed.*is '27'"),
    ({"seed": -1}, "seed must be a whole number from 0"), ({"token": "key_1"}, "token is the key for"),
    ({"messages": "yes"}, "messages must be True or False"), ({"rules": "mine"}, "rules must be one of"),
    ({"control": None}, "control must be one of"),
    ({"rewards": "mine"}, "'team', 'individual'"), ({"render_mode": "gif"}, "'rgb_array', is 'gif'"),
])  # fmt: skip
def test_environments_that_cannot_be(settings: dict[str, Any], told: str) -> None:
    with pytest.raises(ArgumentError, match=told):
        parallel_env(**settings)


def test_a_setting_that_does_not_exist() -> None:
    with pytest.raises(TypeError, match="'hight' is no argument and no setting: settings are num_agents, rules, width"):
        parallel_env(hight=9)  # type: ignore[call-arg]


def test_what_is_unusual_and_right(server: Server) -> None:
    with parallel_env("foraging", num_agents=np.int64(2), seed=np.int32(5), server=server) as env:  # type: ignore[arg-type]
        env.reset(seed=np.uint8(3))  # type: ignore[arg-type]
        assert env.seed == 3
        env.step({"Agent_0": np.int64(1), "Agent_1": np.array([2])})
        assert env.seen["Agent_0"]["round"] == 1


@pytest.mark.parametrize(("actions", "told"), [
    ([0, 1], r"a dictionary with an action for each agent, not \[0, 1\]"), (None, "not None"),
    ({"Agent_0": 0}, "there is none of Agent_1"), ({**BOTH, "Agent_0": None}, "there is none of Agent_0"),
    ({**BOTH, "agent_0": 0}, "no agent 'agent_0': agents are 'Agent_0' to 'Agent_1'"),
    ({**BOTH, "Agent_2": 0}, "no agent 'Agent_2'"), ({**BOTH, "Agent_1": 5}, "0 UP, .* from 0 to 4, is 5"),
    ({**BOTH, "Agent_1": "UP"}, "is 'UP'"), ({**BOTH, "Agent_1": 1.0}, "is 1.0"),
    ({**BOTH, "Agent_1": True}, "is True"), ({**BOTH, "Agent_1": -1}, "from 0 to 4, is -1"),
    ({**BOTH, "Agent_1": np.array([1, 2])}, r"is array\(\[1, 2\]\)"),
    ({**BOTH, "Agent_1": {"action": 0}}, "without messages=True an action is a number"),
])  # fmt: skip
def test_actions_that_cannot_be(env: SwarmEnv, actions: Any, told: str) -> None:
    with pytest.raises(ArgumentError, match=told):
        env.step(actions)
    # Nothing was sent, and the round can be played.
    env.step(BOTH)
    assert env.seen["Agent_0"]["round"] == 1


@pytest.mark.parametrize(("action", "told"), [
    (1, "a dictionary with 'action', 'message'"), ({"message": "x"}, "a dictionary with 'action', 'message'"),
    ({"action": 1, "message": None}, "'' for none; it is None"), ({"action": 1, "message": "né"}, "has 'é'"),
    ({"action": 1, "message": "x", "to": 1}, "with 'action', 'message'; it is"),
])  # fmt: skip
def test_messages_that_cannot_be(server: Server, action: Any, told: str) -> None:
    with parallel_env(num_agents=1, messages=True, server=server) as env:
        env.reset()
        with pytest.raises(ArgumentError, match=told):
            env.step({"Agent_0": action})


def test_a_long_message_is_cut_and_in_the_space_of_who_hears_it(server: Server) -> None:
    with parallel_env(num_agents=2, messages=True, control="centralized", server=server) as env:
        env.reset()
        with pytest.raises(ArgumentError, match="`to` of Agent_0 must be a whole number from 0 to 1, is 7"):
            env.step({"Agent_0": {"action": 4, "message": "x", "to": 7}, "Agent_1": {"action": 4}})
        observations, *_ = env.step({"Agent_0": {"action": 4, "message": "x" * 5000}, "Agent_1": {"action": 4}})
        assert observations["Agent_1"]["messages"] == ("x" * 120 + "...",)
        assert env.observation_space("Agent_1").contains(observations["Agent_1"])


def test_steps_at_the_wrong_time(env: SwarmEnv) -> None:
    with pytest.raises(SwarmbenchError, match=r"no episode yet: call reset\(\)"):
        parallel_env().step(BOTH)
    for _ in range(2):
        env.step(BOTH)
    with pytest.raises(SwarmbenchError, match=r"the episode is over.*reset\(\)"):
        env.step(BOTH)
    assert env.step({}) == ({}, {}, {}, {}, {})
    env.close()
    with pytest.raises(SwarmbenchError, match="closed"):
        env.step(BOTH)
    for space in env.action_space, env.observation_space:
        with pytest.raises(ArgumentError, match="no agent 'Agent_9'"):
            space("Agent_9")


def test_a_server_that_is_gone_in_the_middle() -> None:
    with Server() as server, Client(server.url, "", retry=Retry(times=1)) as client:
        env = parallel_env(num_agents=2, server=client)
        env.reset()
        server.stop()
        with pytest.raises(ConnectionFailedError, match=r"POST http://.*/swarm/act: .*\(2 attempts\)"):
            env.step(BOTH)
        env.close()
