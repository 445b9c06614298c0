"""The adapters for frameworks that train language models, with stand-ins; `.ci/frameworks` runs the real packages."""

import asyncio
import json
import re
import runpy
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytest.importorskip("swarmseat._native", reason="only wheels of bindings/python have the native module")
pytest.importorskip("pydantic", reason="the adapters are made of it")

import standins
from conftest import ROOT

from swarmseat import TextEpisode
from swarmseat.rewards import full_score

standins.verifiers()
standins.openenv()

import swarmseat.openenv as served  # noqa: E402
import swarmseat.verifiers as seated  # noqa: E402


def play(task: str, seed: int, replies: Any, **options: Any) -> tuple[TextEpisode, float]:
    """Plays the same game without a framework."""
    episode = TextEpisode(task, num_agents=4, max_round=6, **options)  # type: ignore[arg-type]
    turn = episode.reset(seed)
    while not turn.done:
        given = {agent: replies(agent, turn.prompts[agent]) for agent in turn.asked}
        turn = episode.step(given if episode.mode == "seats" else given[turn.asked[0]])
    return episode, turn.score


def reply(agent: int, prompt: str) -> str:
    round = int(re.search(r"Round: (\d+)", prompt)[1])  # type: ignore[index]
    return ("ACTION: SWITCH", "ACTION: UP\nMSG: hello", "no idea")[(agent + round) % 3]


def game(task: Any, seed: int) -> Any:
    settings = seated.Settings(num_agents=4, max_round=6)
    return seated.SwarmTask(seated.SwarmData(game=task, seed=seed, settings=settings))


@pytest.mark.parametrize("task", ["Synchronization", "Foraging"])
def test_verifiers_plays_all_seats(task: Any, tmp_path: Path) -> None:
    config = seated.SwarmEnvConfig(journals=tmp_path)
    agents = standins.Agents(reply)
    asyncio.run(seated.SwarmEnv(config).run(game(task, 27), agents))
    expected, score = play(task, 27, reply)
    assert len(agents.traces) == 4
    for agent, trace in enumerate(agents.traces):
        assert trace.rewards == {"team": pytest.approx(score / full_score(task, 4, 6))}
        assert trace.metrics == {
            "score": score, "invalid_answers": expected.invalid_answers[agent], "messages_heard": expected.heard[agent],
        }  # fmt: skip
        told = trace.info["swarmbench"]
        assert (told["seed"], told["agent"], told["digest"]) == (27, f"Agent_{agent}", expected.world.world_digest(0))
        assert Path(told["journal"]).read_bytes().count(b'"kind":"round"') == 6
        assert len(trace.prompts) == 6
    assert sum(expected.invalid_answers) > 0


def test_verifiers_plays_one_seat() -> None:
    config = seated.SwarmEnvConfig(mode="one_seat", seat=2, scale="score")
    agents = standins.Agents(lambda _, prompt: reply(2, prompt))
    asyncio.run(seated.SwarmEnv(config).run(game("Synchronization", 5), agents))
    _, score = play("Synchronization", 5, reply, mode="one_seat", seat=2)
    (trace,) = agents.traces
    assert trace.rewards == {"team": score}
    assert trace.info["swarmbench"]["agent"] == "Agent_2"


def test_verifiers_plays_on_without_a_seat_whose_conversation_has_ended() -> None:
    def tires(agent: int, prompt: str) -> str | None:
        return None if agent == 1 and "Round: 2" in prompt else reply(agent, prompt)

    agents = standins.Agents(tires)
    asyncio.run(seated.SwarmEnv(seated.SwarmEnvConfig()).run(game("Foraging", 1), agents))
    assert [len(trace.prompts) for trace in agents.traces] == [6, 3, 6, 6]
    assert [trace.info["swarmbench"]["rounds"] for trace in agents.traces] == [6] * 4


def test_verifiers_has_games() -> None:
    taskset = seated.SwarmTaskset(seated.SwarmTasksetConfig(first_seed=3, num_seeds=2))
    tasks = list(taskset)
    assert [task.data.name for task in tasks][4:7] == ["Flocking#3", "Transport#4", "Pursuit#4"]
    assert len(tasks) == len({task.key for task in tasks}) == 10
    assert taskset.bounded
    endless = seated.SwarmTaskset(seated.SwarmTasksetConfig(game="Pursuit"))
    assert not endless.bounded
    assert next(iter(endless)).data.seed == 0


def test_it_exports_what_verifiers_looks_for() -> None:
    import swarmseat_verifiers

    found = {getattr(swarmseat_verifiers, name) for name in swarmseat_verifiers.__all__}
    assert found == {seated.SwarmTaskset, seated.SwarmEnv, seated.SwarmHarness}


@pytest.mark.parametrize("mode", ["one_seat", "turns", "joint"])
def test_openenv_steps(mode: Any) -> None:
    env = served.SwarmEnvironment("Synchronization", mode, num_agents=3, max_round=6)
    seen = env.reset(seed=27, episode_id="mine")
    assert seen.reward is None
    assert env.state.model_dump(include={"episode_id", "seed", "mode"}) == {
        "episode_id": "mine",
        "seed": 27,
        "mode": mode,
    }
    rewards, raw = [], 0.0
    while not seen.done:
        assert seen.prompt
        assert (seen.agent is None) is (mode == "joint")
        text = "ACTION: SWITCH" if mode != "joint" else "Agent_0: SWITCH\nAgent_1: SWITCH\nAgent_2: SWITCH"
        seen = env.step(served.SwarmAction(response=text))
        assert seen.invalid is None
        assert seen.reward is not None
        rewards.append(seen.reward)
        raw += seen.metadata["raw_reward"]
    assert seen.prompt == ""
    assert raw == pytest.approx(seen.score)
    assert all(0 <= reward <= 1 for reward in rewards)
    assert sum(rewards) == pytest.approx(min(seen.score / seen.metadata["full_score"], 1))
    assert mode == "one_seat" or seen.score == 6
    assert env.state.step_count == len(rewards) == (18 if mode == "turns" else 6)
    again = env.reset(seed=27)
    assert (again.round, again.score) == (0, 0)
    env.close()


def test_openenv_has_games() -> None:
    env = served.SwarmEnvironment()
    assert env.list_splits() == ["standard", "baselines", "train"]
    assert [env.num_tasks(split) for split in env.list_splits()] == [25, 100, 500_000]
    assert env.get_task("standard", 5) == {"id": "Transport#42", "index": 5, "task": "Transport", "seed": 42}
    assert len(env.list_tasks("train")) == 1000
    assert [one["index"] for one in env.get_task_range("train", 499_998)] == [499_998, 499_999]
    assert not {env.get_task("train", index)["seed"] for index in range(50)} & set(range(100))
    env.reset(split="standard", index=6)
    assert (env.state.task, env.state.seed) == ("Pursuit", 42)
    env.reset(task="flocking", seed=3)
    assert (env.state.task, env.state.seed) == ("Flocking", 3)
    with pytest.raises(IndexError, match="the games 0 to 24, not 25"):
        env.get_task("standard", 25)


@pytest.mark.parametrize(("how", "says"), [
    (lambda env: env.reset(split="standard"), "by split and index"), (lambda env: env.reset(seed=-1), "seed must be"),
    (lambda env: env.reset(split="mine", index=0), "split must be one of 'standard'"),
    (lambda env: env.reset(task="Chess"), "task must be one of"),
    (lambda _: served.SwarmEnvironment().step(served.SwarmAction(response="")), "reset first"),
    (lambda _: served.SwarmEnvironment(mode="seats"), "mode must be one of 'one_seat'"),
    (lambda _: served.app(num_agents=0), "num_agents must be a whole number from 1"),
    (lambda _: served.app(0), "max_concurrent_envs"),
])  # fmt: skip
def test_openenv_names_what_is_wrong(how: Any, says: str) -> None:
    env = served.SwarmEnvironment(num_agents=3, max_round=4)
    env.reset(seed=1)
    with pytest.raises(ValueError, match=says):
        how(env)
    assert env.step(served.SwarmAction(response="ACTION: UP")).round == 1


def test_openenv_is_served_with_sessions_of_their_own() -> None:
    assert served.SwarmEnvironment.SUPPORTS_CONCURRENT_SESSIONS
    envs = [served.SwarmEnvironment(num_agents=3, max_round=4) for _ in range(3)]
    seeds = [env.reset(seed=seed).metadata["seed"] for seed, env in enumerate(envs)]
    envs[1].step(served.SwarmAction(response="ACTION: UP"))
    assert seeds == [0, 1, 2]
    assert [env.state.round for env in envs] == [0, 1, 0]


def test_the_clients_read_what_the_server_says() -> None:
    client = object.__new__(served.SwarmClient)
    seen = served.SwarmEnvironment("Pursuit", max_round=3).reset(seed=2)
    shown = seen.model_dump(exclude={"reward", "done", "metadata"})
    result = client._parse_result({"observation": shown, "reward": 0.5, "done": True, "metadata": {"seed": 2}})
    assert (result.observation.prompt, result.reward, result.done) == (seen.prompt, 0.5, True)
    assert client._step_payload(served.SwarmAction(response="x")) == {"response": "x"}


def test_trl_calls_tools() -> None:
    example = runpy.run_path(str(ROOT / "examples" / "training" / "trl_grpo.py"))
    seat = example["SwarmSeat"]()
    (row,) = example["rows"]("Synchronization", 1, first_seed=27)
    first = seat.reset(**row)
    assert "Task description" in first
    assert seat.look() == first
    assert seat.say("all\non") == "It is sent with your next move."
    seen = seat.move("SWITCH")
    assert 'Round 0: action SWITCH, message "all on"' in seen
    assert seat.move("JUMP").startswith("'JUMP' is no action")
    for _ in range(example["MAX_ROUND"]):
        seen = seat.move("STAY")
    assert seen.startswith("The episode is over after 20 rounds.")
    assert 0 <= seat.get_reward() <= 1
    assert seat.reset(**row) == first
    assert seat.get_reward() == 0


def test_nemo_gym_resets_and_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    class GymnasiumServer:
        def __init__(self) -> None:
            self.session_state: dict[Any, Any] = {}

    monkeypatch.setitem(sys.modules, "nemo_gym", ModuleType("nemo_gym"))
    modules: dict[str, dict[str, Any]] = {
        "nemo_gym.openai_utils": {"NeMoGymResponse": str}, "resources_servers": {},
        "resources_servers.gymnasium": {"GymnasiumServer": GymnasiumServer, "extract_text": str},
    }  # fmt: skip
    for name, members in modules.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    example = runpy.run_path(str(ROOT / "examples" / "training" / "for_nemo_gym" / "app.py"))
    server = example["SwarmGym"]()

    async def episode(session: str) -> tuple[float, dict[str, Any]]:
        row = {"task": "Synchronization", "seed": 27, "mode": "joint", "settings": {"num_agents": 2, "max_round": 4}}
        text, info = await server.reset(row, session)
        assert info["seed"] == 27
        total = 0.0
        while text is not None:
            text, reward, over, cut, info = await server.step("Agent_0: SWITCH\nAgent_1: SWITCH", row, session)
            total += reward
            assert over is (text is None)
            assert not cut
        await server.close_session(session)
        return total, info

    async def both() -> list[tuple[float, dict[str, Any]]]:
        return list(await asyncio.gather(episode("one"), episode("two")))

    one, other = asyncio.run(both())
    assert one == other
    assert one[1]["score"] == 4
    assert one[0] == 1
    assert server.session_state == {}
    with pytest.raises(RuntimeError, match="reset it first"):
        asyncio.run(server.step("", {}, "three"))


def test_nemo_gym_has_rows() -> None:
    folder = ROOT / "examples" / "training" / "for_nemo_gym"
    made = subprocess.run(
        [sys.executable, folder / "app.py", "--rows", "5"], capture_output=True, text=True, check=True
    )
    assert made.stdout == (folder / "data" / "example.jsonl").read_text()
    assert {json.loads(line)["seed"] for line in made.stdout.splitlines()} == {1_000_000}


def test_pages_blocks_run() -> None:
    """Runs the blocks of docs/play/frameworks.md that need no framework."""
    page = (ROOT / "docs" / "play" / "frameworks.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    names: dict[str, object] = {}
    alone = [block for block in blocks if "import skyrl_gym" not in block]
    for block in alone:
        exec(compile(block, "docs/play/frameworks.md", "exec"), names)
    assert len(alone) >= 2
