"""Episodes as conversations: the prompts, the reading of answers and the players of the server, in this process."""

import re
import threading
from typing import Any

import pytest

from swarmseat import Client, wire
from swarmseat.names import TASKS, TaskName

pytest.importorskip("swarmseat._native", reason="only wheels of bindings/python have the native module")

from swarmseat.rewards import full_score
from swarmseat.text import MODES, TextEpisode, Turn

WORDS = ("UP", "DOWN", "LEFT", "RIGHT", "STAY", "SWITCH", "JUMP", "")


def answer(agent: int, round: int) -> str:
    """An answer as models write it: valid, with a message, with a wrong action, or empty."""
    word = WORDS[(agent * 5 + round * 3) % len(WORDS)]
    said = f"\n**MSG:** round {round}" if (agent + round) % 3 == 0 else ""
    return f"I think.\n- ACTION: {word}{said}" if word else f"Let me see.{said}"


def played(episode: TextEpisode, turn: Turn) -> Turn:
    """Plays to the end with these answers, in any mode."""
    while not turn.done:
        if episode.mode in {"seats", "joint"}:
            turn = episode.step({agent: answer(agent, turn.round) for agent in turn.asked})
        else:
            turn = episode.step(answer(turn.asked[0], turn.round))
    return turn


@pytest.mark.parametrize("settings", [
    {}, {"rules": "reference", "answer_reader": "first-marker", "noise": 0.3}, {"control": "centralized", "memory": 1},
], ids=str)  # fmt: skip
@pytest.mark.parametrize("task", TASKS)
def test_it_plays_the_game_of_the_server(client: Client, task: TaskName, settings: dict[str, Any]) -> None:
    settings = {"num_agents": 5, "max_round": 8, **settings}
    here = TextEpisode(task, **settings)
    turn = here.reset(27)
    assert here.seed == 27
    episode = client.create_episode(task=task, seed=27, **settings)
    swarm = client.with_token(episode["swarm_token"])
    while True:
        there = swarm.swarm_obs(wait=30, limit=100, prompt=True)
        if there["finished"]:
            assert turn.done
            break
        seats = {int(seat["agent"].removeprefix("Agent_")): seat for seat in there["observations"]}
        assert turn.prompts == {agent: seat["prompt"] for agent, seat in seats.items()}
        assert list(turn.asked) == list(seats)
        texts = {agent: answer(agent, turn.round) for agent in seats}
        sent: list[wire.SwarmAct] = [
            {"episode": episode["id"], "agent": f"Agent_{agent}", "round": turn.round, "response": text}
            for agent, text in texts.items()
        ]
        receipts = swarm.swarm_act(sent)["receipts"]
        counted = {agent for agent, receipt in zip(texts, receipts, strict=True) if receipt.get("valid") is not False}
        turn = here.step(dict(texts))
        assert set(turn.invalid) == set(texts) - counted
    assert here.world.world_digest(0) in client.journal(episode["id"]).decode()
    assert turn.score == pytest.approx(client.state(episode["id"], round=turn.round)["score"], rel=1e-6)


@pytest.mark.parametrize("task", TASKS)
def test_partners_decide_as_those_of_the_server(client: Client, task: TaskName) -> None:
    settings: dict[str, Any] = {"num_agents": 5, "max_round": 12}
    here = TextEpisode(task, "one_seat", partners="default", **settings)
    turn = here.reset(42)
    episode = client.create_episode(
        task=task, seed=42, **settings, open_seats=4, fill_after_s=0, fill_with="default", start="now"
    )
    seat = client.with_token(episode["swarm_token"])
    while not turn.done:
        now = seat.swarm_obs(wait=30, prompt=True)
        assert [one["prompt"] for one in now["observations"]] == [turn.prompt]
        text = answer(0, turn.round)
        seat.swarm_act([{"episode": episode["id"], "agent": "Agent_0", "round": turn.round, "response": text}])
        turn = here.step(text)
    while not seat.swarm_obs(wait=30)["finished"]:
        pass
    assert here.world.world_digest(0) in client.journal(episode["id"]).decode()


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("rewards", ["team", "individual"])
def test_all_modes_play_the_same_game(task: TaskName, rewards: Any) -> None:
    digests, settings = set(), {"num_agents": 4, "max_round": 9}
    for mode in ("seats", "turns", "joint"):
        episode = TextEpisode(task, mode, rewards=rewards, **settings)  # type: ignore[arg-type]
        turn, total, gain, earned = episode.reset(57), 0.0, 0.0, [0.0] * 4
        while not turn.done:
            turn = played_once(episode, turn)
            total, gain = total + turn.reward, gain + turn.gain
            earned = [sum(parts) for parts in zip(earned, turn.rewards.values(), strict=True)]
        assert turn.asked == ()
        assert turn.prompts == {}
        assert turn.prompt == ""
        assert total == pytest.approx(turn.score)
        assert gain == pytest.approx(min(turn.score / episode.full_score, 1.0))
        assert earned == pytest.approx(episode.earned)
        if rewards == "individual" and task in {"Foraging", "Transport", "Pursuit"}:
            assert sum(earned) == pytest.approx(turn.score, rel=1e-5)
        digests.add(episode.world.world_digest(0))
    assert len(digests) == 1


def played_once(episode: TextEpisode, turn: Turn) -> Turn:
    texts = {agent: answer(agent, turn.round) for agent in turn.asked}
    return episode.step(texts[turn.asked[0]] if episode.mode in {"turns", "one_seat"} else dict(texts))


def test_a_turn_resolves_the_round_only_when_all_have_answered() -> None:
    episode = TextEpisode("Foraging", "turns", num_agents=3, max_round=5)
    turn = episode.reset(1)
    asked = []
    for _ in range(6):
        asked.append((turn.round, turn.asked))
        turn = episode.step("ACTION: UP")
    assert asked == [(round, (agent,)) for round in (0, 1) for agent in range(3)]
    assert turn.round == 2


def test_a_joint_answer_has_a_line_for_each_agent() -> None:
    episode = TextEpisode("Synchronization", "joint", num_agents=5, max_round=5)
    turn = episode.reset(1)
    assert [f"Agent_{agent} at (" in turn.prompt for agent in range(5)] == [True] * 5
    assert "Agent_5 at" not in turn.prompt
    turn = episode.step(
        "Agent_1: UP\nSo:\n- **Agent_0**: switch\n* Agent 1 = ACTION: SWITCH MSG: now\n"
        "Agent_2: fly\n`Agent_3: MSG: only a message`\nAgent_9: UP"
    )
    assert turn.invalid == {2: "unknown_action", 4: "not_named"}
    sights = [episode.world.sight(0, agent) for agent in range(5)]
    assert [sight["history"][-1]["action"] for sight in sights] == ["SWITCH", "SWITCH", None, None, None]
    assert [sight["history"][-1]["message"] for sight in sights] == [None, "now", None, "only a message", None]
    centralized = TextEpisode("Foraging", "joint", num_agents=3, control="centralized").reset(1)
    assert centralized.prompt.count("The whole map") == 1


def test_who_escapes_is_asked_no_more_and_earns_on() -> None:
    """Built-in players that know the way play one seat through the texts; its agent leaves before the others."""
    leader = TextEpisode("Transport", "one_seat", seat=0, partners="default")
    turn = leader.reset(27)
    guide = leader.world.partners
    mate = guide(0, {0: "default"})
    while not turn.done:
        act = leader.world.decide(0, mate)[0]
        said = "" if act.message is None else f"\nMSG: {act.message}"
        turn = leader.step(f"ACTION: {leader.world.actions[act.action]}{said}")
    assert leader.world.sight(0, 0)["position"] is None
    assert turn.score > 9
    assert sum(leader.earned[:1]) == pytest.approx(turn.score, rel=1e-5)
    assert leader.turn.reward > 0


def test_what_is_no_answer_costs_the_act_only() -> None:
    episode = TextEpisode("Pursuit", num_agents=4, max_round=3)
    turn = episode.reset(3)
    turn = episode.step({0: None, 1: "", 2: "x\ud800" * 500_000})
    assert turn.invalid == {0: "empty", 1: "empty", 2: "no_marker", 3: "empty"}
    assert turn.round == 1
    turn = episode.step({})
    turn = episode.step(dict.fromkeys(turn.asked, "ACTION: UP\nMSG: \udfff"))
    assert turn.done
    assert episode.invalid_answers == [2, 2, 2, 2]


def test_long_answers_are_cut() -> None:
    long = "ACTION: UP\n" + "word " * 100_000
    for reader, text, is_read in (
        ("last-marker", long, False), ("last-marker", long + "\nACTION: UP", True), ("first-marker", long, True),
        ("first-marker", "word " * 100_000 + "ACTION: UP", False),
    ):  # fmt: skip
        episode = TextEpisode("Foraging", "one_seat", answer_reader=reader)  # type: ignore[arg-type]
        assert (episode.step(text).invalid == {}) is is_read, reader


def test_an_episode_is_repeated_by_its_seed() -> None:
    for mode in MODES:
        episode = TextEpisode("Foraging", mode, num_agents=4, max_round=6)
        first = played(episode, episode.reset())
        digest, seed = episode.world.world_digest(0), episode.seed
        other = TextEpisode("Foraging", mode, num_agents=4, max_round=6)
        assert played(other, other.reset(seed)) == first
        assert other.world.world_digest(0) == digest
        assert other.seed == seed
        # The same object plays a second episode.
        assert played(episode, episode.reset(seed)) == first


def test_hundreds_are_in_one_process() -> None:
    episodes = [TextEpisode("Pursuit", "one_seat", max_round=4) for _ in range(300)]
    ends: list[Turn | None] = [None] * len(episodes)

    def play(places: range) -> None:
        for place in places:
            ends[place] = played(episodes[place], episodes[place].reset(place % 10))

    threads = [threading.Thread(target=play, args=(range(first, 300, 4),)) for first in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(ends[place] == ends[place % 10] is not None for place in range(300))


def test_full_scores() -> None:
    assert [full_score(task) for task in TASKS] == [12, 100, 100, 40, 12]
    assert full_score("Foraging", num_agents=6, max_round=50) == 10


@pytest.mark.parametrize(("arguments", "says"), [
    ({"mode": "chat"}, "mode must be one of 'seats'"), ({"seat": 12}, "seat must be a whole number from 0 to 11"),
    ({"mode": "one_seat", "partners": "nobody"}, 'no built-in player "nobody" plays Foraging, only'),
    ({"partners": "default"}, "must name a player for each agent"),
    ({"mode": "one_seat", "partners": {1: "default"}}, "must play all agents but 0"),
    ({"partners": dict.fromkeys(range(12), "default")}, "nobody is left to ask"),
    ({"partners": {12: "default"}}, "from 0 to 11"), ({"answer_reader": "best"}, "answer_reader"),
    ({"answer_chars_max": 0}, "answer_chars_max"), ({"num_agents": 0}, "num_agents must be a whole number from 1"),
])  # fmt: skip
def test_what_cannot_be_made_is_named(arguments: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=re.escape(says)):
        TextEpisode("Foraging", **arguments)


@pytest.mark.parametrize(("mode", "answers", "says"), [
    ("seats", "ACTION: UP", "by the numbers of agents"), ("seats", {7: "ACTION: UP"}, "agent 7 was not asked"),
    ("seats", {0: 5}, "an answer is a text"), ("turns", {0: "ACTION: UP"}, "an answer is one text"),
    ("one_seat", 5, "an answer is a text"), ("joint", 5, "an answer is a text"),
])  # fmt: skip
def test_what_cannot_be_answered_is_named_and_changes_nothing(mode: Any, answers: Any, says: str) -> None:
    episode = TextEpisode("Foraging", mode, num_agents=4, max_round=2)
    before, digest = episode.reset(1), episode.world.world_digest(0)
    with pytest.raises(ValueError, match=says):
        episode.step(answers)
    assert episode.turn is before
    assert episode.world.world_digest(0) == digest
    played(episode, before)
    with pytest.raises(Exception, match="the episode is over"):
        episode.step(answers)
