"""Environments in this process: the game of the server, as arrays."""

import json
import pickle
import subprocess
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

from swarmseat import Client, Server, SwarmbenchError, SwarmEnv, parallel_env
from swarmseat.names import TASKS, TaskName
from swarmseat.server import find_binary
from swarmseat.settings import STANDARD

pytest.importorskip("swarmseat._native", reason="only wheels of bindings/python have the native module")

import gymnasium
from gymnasium.vector import AutoresetMode
from pettingzoo.test.parallel_test import parallel_api_test

from swarmseat.cells import CHANNELS
from swarmseat.native import VecEnv, Words
from swarmseat.text import TextEpisode
from swarmseat.vector import gym_vector_env

GOLDEN = sorted((ROOT / "tests" / "golden" / "1").glob("*.jsonl"))


def drawn(env: VecEnv, random: np.random.Generator) -> Any:
    return random.integers(0, len(env.actions), (env.num_envs, env.num_agents))


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_recorded_games_are_played_to_the_same_states(path: Path) -> None:
    opening, *records = [json.loads(line)["record"] for line in path.read_text().strip().split("\n")]
    settings = {name: opening["config"][name] for name in ("task", *STANDARD)}
    env = VecEnv(num_envs=1, messages=True, autoreset="disabled", **settings)
    env.reset(seed=[opening["config"]["seed"]])
    rounds = [record for record in records if record["kind"] == "round"]
    for record in rounds:
        actions = np.full((1, env.num_agents), -1)
        words: list[Words] = [None] * env.num_agents
        for act in record["acts"]:
            place = int(act["agent"].removeprefix("Agent_"))
            if act.get("action") in env.actions:
                actions[0, place] = env.actions.index(act["action"])
            if act.get("message"):
                to = act.get("to")
                words[place] = (act["message"], None if to is None else int(to.removeprefix("Agent_")))
        told = env.step(actions, [words])
        assert env.world_digest(0) == record["digest"]
        assert told["score"][0] == np.float32(record["score"])
    assert bool(env.buffers["terminated"][0]) == (bool(rounds) and records[-1].get("status") == "finished")


def test_another_program_verifies_its_journal(tmp_path: Path) -> None:
    env = VecEnv("Pursuit", 3, max_round=6, seed=4)
    env.reset()
    random = np.random.default_rng(1)
    for _ in range(6):
        env.step(drawn(env, random))
    (tmp_path / "game.jsonl").write_bytes(env.journal(1))
    verified = subprocess.run(
        [find_binary(), "verify", tmp_path / "game.jsonl", "--solver", "both"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert verified.returncode == 0, verified.stderr
    assert "consistent" in verified.stdout


def test_arrays_are_the_same_ones_or_copies() -> None:
    env = VecEnv("Foraging", 2, copy=False, seed=1)
    told = env.reset()
    again = env.step(np.zeros((2, 12), np.int8))
    assert all(again[name] is told[name] is env.buffers[name] for name in told)
    env = VecEnv("Foraging", 2, seed=1, autoreset="same_step")
    told = env.reset()
    again = env.step(np.zeros((2, 12), np.int8))
    parts = {**told, "earned": again["rewards"], **again["final_obs"]}
    for name, part in parts.items():
        assert not any(np.shares_memory(part, own) for own in env.buffers.values() if isinstance(own, np.ndarray)), name


def test_two_threads_step_two_batches() -> None:
    envs = [VecEnv("Flocking", 200, seed=1, threads=1) for _ in range(2)]
    digests: list[str] = ["", ""]

    def play(place: int) -> None:
        env, random = envs[place], np.random.default_rng(2)
        env.reset()
        for _ in range(30):
            env.step(drawn(env, random))
        digests[place] = env.world_digest(150)

    threads = [threading.Thread(target=play, args=(place,)) for place in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert digests[0] == digests[1] != ""


@pytest.mark.parametrize(("how", "says"), [
    (lambda env: env.step(np.zeros((2, 11), np.int64)), r"shape \(2, 12\), are int64 of shape \(2, 11\)"),
    (lambda env: env.step(np.zeros((2, 12))), "whole numbers of shape .2, 12., are float64"),
    (lambda env: env.step(np.full((2, 12), 5)), "environment 0, agent 0: actions are 0 to 4, or -1 for none, not 5"),
    (lambda env: env.step([[0] * 12, [*[0] * 11, -2]]), "environment 1, agent 11: .* not -2"),
    (lambda env: env.step(np.zeros((2, 12), int), [[None] * 12] * 2), "messages=True"),
    (lambda env: env.reset(seed=-1), "seed must be a whole number from 0 to 9007199254740991, is -1"),
    (lambda env: env.reset(seed=2**53 - 1), "seed must be a whole number from 0 to 9007199254740991, is 9007"),
    (lambda env: env.reset(seed=[1]), "one number for each of 2 environments, has 1"),
    (lambda env: env.reset(seed="27"), "seed"),
    (lambda env: env.reset(mask=[True]), "mask must be 2 booleans"),
    (lambda env: env.fork(2, 0), "the environment must be a whole number from 0 to 1, is 2"),
    (lambda env: env.fork(0, [5]), "there is no environment 5"),
    (lambda env: env.load(0, b"{}"), "not the bytes of a state"),
    (lambda env: env.prompt(0, 12), "there is no agent 12"),
])  # fmt: skip
def test_what_is_wrong_is_named_and_changes_nothing(how: Any, says: str) -> None:
    env = VecEnv("Foraging", 2, seed=1)
    env.reset(seed=5)
    before = [env.world_digest(index) for index in range(2)]
    with pytest.raises((ValueError, TypeError), match=says):
        how(env)
    assert [env.world_digest(index) for index in range(2)] == before


@pytest.mark.parametrize(("template", "limit"), [
    ("{{ " + "not " * 8_100 + "1 }}", "template_unary_max"), ("{{ " + "- " * 10_534 + "1 }}", "template_unary_max"),
    ("{{ agent" + ".i" * 11_031 + " }}", "template_chain_max"),
    ("{% if 0 %}" + "{% elif 0 %}" * 2_334 + "{% endif %}", "template_elif_max"),
    ("{{ " + "(" * 16_000 + "1" + ")" * 16_000 + " }}", "template_nesting_max"),
], ids=["not", "minus", "chain", "elif", "brackets"])  # fmt: skip
def test_templates_too_deep_for_a_stack_are_refused(template: str, limit: str) -> None:
    environments = [VecEnv("Foraging", 2, seed=1), VecEnv("Foraging", 2, seed=1, prompt_template=template)]
    for env, given in zip(environments, (template, None), strict=True):
        env.reset()
        with pytest.raises(ValueError, match=limit):
            env.prompt(0, 0, given)
        env.step(np.zeros((2, 12), int))
    with pytest.raises(ValueError, match=limit):
        TextEpisode("Foraging", prompt_template=template)
    swarm = parallel_env("Foraging", seed=1, backend="native", observations="text", prompt_template=template)
    with pytest.raises(ValueError, match=limit):
        swarm.reset()


def test_what_cannot_be_made_is_named() -> None:
    wrongs: list[tuple[dict[str, Any], str]] = [
        ({"num_envs": 0}, "num_envs must be a whole number from 1"),
        ({"num_agents": 0}, "num_agents must be a whole number from 1 to 1024, is 0"),
        ({"width": 4}, "width must be from 8 to 256, is 4"), ({"seed": -1}, "seed must be a whole number from 0"),
        ({"observations": "text"}, "observations must be one of 'planes'"), ({"rules": "own"}, "rules"),
        ({"threads": -1}, "threads"), ({"task": "Chess"}, "task"),
    ]  # fmt: skip
    for wrong, says in wrongs:
        with pytest.raises((ValueError, TypeError), match=says):
            VecEnv(**wrong)
    env = VecEnv(num_envs=1)
    env.close()
    with pytest.raises(RuntimeError, match="the environments are closed"):
        env.reset()
    env = VecEnv(num_envs=1, record=False)
    with pytest.raises(RuntimeError, match="record=True"):
        env.state(0)


@pytest.mark.parametrize("settings", [
    {}, {"observations": "both", "messages": True, "rules": "reference", "noise": 0.5, "max_delay": 1},
    {"rewards": "individual", "rules": "reference"},
    {"control": "centralized", "observations": "text", "view_size": 3, "memory": 2}, {"observations": "flat"},
], ids=str)  # fmt: skip
@pytest.mark.parametrize("task", TASKS)
def test_parallel_environments_are_the_same_on_a_server_and_here(
    client: Client, server: Server, task: TaskName, settings: dict[str, Any]
) -> None:
    common: dict[str, Any] = {"seed": 27, "num_agents": 4, "max_round": 6, **settings}
    there = parallel_env(task, server=server, **common)
    here: Any = parallel_env(task, backend="native", **common)
    try:
        for _ in range(2):
            assert same(there.reset(), here.reset())
            assert (there.seed, there.agents) == (here.seed, here.agents)
            random = np.random.default_rng(5)
            while there.agents:
                for agent in there.agents:
                    sight, shown = {**here.seen[agent], "episode": there.episode}, there.seen[agent]
                    assert sight == {name: value for name, value in shown.items() if name in sight}
                actions: dict[str, Any] = {agent: int(random.integers(len(there.actions))) for agent in there.agents}
                if "messages" in settings:
                    actions = {
                        agent: {"action": action, "message": f"I do {action}"} for agent, action in actions.items()
                    }
                assert same(there.step(actions), here.step(actions))
                assert there.agents == here.agents
                assert np.array_equal(there.state(), here.state())
            assert here.world.world_digest(0) in client.journal(there.episode or "").decode()
    finally:
        there.close()
        here.close()


@pytest.mark.parametrize("settings", [
    {}, {"observations": "both", "messages": True, "noise": 0.5, "max_delay": 2}, {"rewards": "individual"},
], ids=str)  # fmt: skip
def test_forks_are_the_same_on_a_server_and_here(server: Server, settings: dict[str, Any]) -> None:
    common: dict[str, Any] = {"seed": 27, "num_agents": 3, "max_round": 8, **settings}
    envs = [parallel_env("Foraging", server=server, **common), parallel_env("Foraging", backend="native", **common)]

    def acts(env: SwarmEnv, action: int) -> dict[str, Any]:
        said = {"action": action, "message": f"I do {action}"} if "messages" in settings else action
        return dict.fromkeys(env.agents, said)

    try:
        for env in envs[:2]:
            env.reset()
            for action in range(3):
                env.step(acts(env, action))
            envs.extend(env.fork(2))
        there, here, *forks = envs
        for action in (3, 0, 1):
            told = there.step(acts(there, action))
            for env in (here, forks[0], forks[2]):
                assert same(env.step(acts(env, action)), told)
                assert (env.score, env.agents) == (there.score, there.agents)
            other = forks[1].step(acts(forks[1], 2))
            assert same(forks[3].step(acts(forks[3], 2)), other)
            assert not same(other, told)
        # Later episodes have the same seeds as those of the original.
        seeds = [env.reset() and env.seed for env in envs]
        assert len(set(seeds)) == 1
        while here.agents:
            here.step(acts(here, 0))
        with pytest.raises(SwarmbenchError, match="over"):
            here.fork()
    finally:
        for env in envs:
            env.close()
    with pytest.raises(SwarmbenchError, match="closed"):
        here.fork()


def same(one: Any, other: Any) -> bool:
    """Whether both have the same parts, up to single precision."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(part, other[name]) for name, part in one.items())
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    if isinstance(one, float):
        return bool(np.float32(one) == np.float32(other))
    return bool(one == other)


def test_it_passes_pettingzoos_own_test() -> None:
    for task in TASKS:
        parallel_api_test(parallel_env(task, backend="native", num_agents=4, max_round=10))


def test_copies_begin_anew() -> None:
    env = VecEnv("Pursuit", 2, max_round=7, seed=3, autoreset="disabled")
    first = env.reset()
    env.step(np.zeros((2, 12), np.int64))
    again = pickle.loads(pickle.dumps(env))
    assert (again.max_round, again.autoreset) == (7, "disabled")
    assert np.array_equal(again.reset()["seed"], first["seed"])
    single = parallel_env("Pursuit", backend="native", num_agents=3, seed=5)
    single.reset()
    other = pickle.loads(pickle.dumps(single))
    assert other.agents == []
    with pytest.raises(SwarmbenchError, match="reset"):
        other.step({})
    one, _ = single.reset(seed=9)
    two, _ = other.reset(seed=9)
    assert same(one, two)


def test_supersuit_makes_vectors_of_it() -> None:
    supersuit = pytest.importorskip("supersuit", reason=".ci/wheel installs it")
    env = supersuit.black_death_v3(
        parallel_env("Transport", backend="native", observations="flat", max_round=5, seed=1)
    )
    vectors = supersuit.concat_vec_envs_v1(
        supersuit.pettingzoo_env_to_vec_env_v1(env), 2, num_cpus=0, base_class="gymnasium"
    )
    seen, _ = vectors.reset(seed=1)
    random = np.random.default_rng(1)
    for _ in range(7):
        assert seen.shape == (24, *vectors.observation_space.shape[-1:])
        seen, rewards, ended, _, _ = vectors.step(random.integers(0, 5, 24))
        assert rewards.shape == ended.shape == (24,)
    vectors.close()


@pytest.mark.parametrize("mode", ["next_step", "same_step", "disabled"])
@pytest.mark.parametrize("agents", ["joint", "flat"])
@pytest.mark.parametrize("observations", ["planes", "symbols", "flat"])
def test_it_is_a_gym_vector_environment(agents: Any, observations: Any, mode: Any) -> None:
    env = gym_vector_env(
        "Transport", 3, agents=agents, observations=observations, autoreset=mode, max_round=5, num_agents=4, seed=3
    )
    assert env.metadata["autoreset_mode"] is AutoresetMode[mode.upper()]
    seen, _ = env.reset(seed=27)
    assert env.observation_space.contains(seen)
    ends, over = 0, False
    for _ in range(12):
        if mode == "disabled" and over:
            env.reset(options={"reset_mask": np.ones(env.num_envs, np.bool_)})
        seen, rewards, terminated, truncated, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(seen)
        assert rewards.shape == terminated.shape == truncated.shape == (env.num_envs,)
        ends, over = ends + int(terminated.sum()), bool(terminated.all())
        if mode == "same_step":
            assert ("final_obs" in info) == terminated.any()
            if terminated.any():
                assert env.observation_space.contains(info["final_obs"])
    assert ends >= 2 * env.num_envs
    env.close()


def test_it_is_registered() -> None:
    env = gymnasium.make_vec("swarmbench/Pursuit-v0", num_envs=2, vectorization_mode="vector_entry_point")
    seen, _ = env.reset(seed=1)
    assert seen["view"].shape == (2, 12, len(CHANNELS), 5, 5)
    env.close()


@pytest.mark.parametrize(("name", "told"), [
    ("swarmbench/Pursiut-v0", "mean: `Pursuit`"), ("swarmbench/pursuit-v0", "mean: `Pursuit`"),
    ("swarmbench/Pursuit-v1", "`v0`"),
])  # fmt: skip
def test_gymnasium_names_the_environment_that_was_meant(name: str, told: str) -> None:
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(gymnasium.error.UnregisteredEnv, match=told):
            make(name)


def test_one_episode_alone_is_refused_with_what_to_use() -> None:
    with pytest.raises(gymnasium.error.Error, match=r"make_vec.*parallel_env"):
        gymnasium.make("swarmbench/Pursuit-v0")
