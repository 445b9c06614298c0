"""All seats of a swarm token, by both clients: episodes, and attempts in competitions."""

import asyncio
from collections.abc import Callable
from typing import Any

import httpx
import pytest
from conftest import Cup
from test_docs import BLOCK, PAGE

from swarmseat import ApiError, ArgumentError, AsyncClient, Client, Server, wire
from swarmseat.play import DELAYS_MAX

SMALL: dict[str, Any] = {"task": "Synchronization", "num_agents": 2, "max_round": 4, "seed": 27}


def blink(seen: wire.Observation) -> str:
    return "STAY" if seen["light_on"] == (seen["round"] % 2 == 0) else "SWITCH"


def play(url: str, token: str, decide: Callable[[wire.Observation], Any], **more: Any) -> None:
    with Client(url, token) as swarm:
        swarm.play(decide, **more)


def play_async(url: str, token: str, decide: Callable[[wire.Observation], Any], **more: Any) -> None:
    async def main() -> None:
        async def decided(seen: wire.Observation) -> Any:
            await asyncio.sleep(0)
            return decide(seen)

        async with AsyncClient(url, token) as swarm:
            await swarm.play(decided, **more)

    asyncio.run(main())


both = pytest.mark.parametrize("play", [play, play_async])


@both
def test_all_seats_play_to_the_end(play: Callable[..., None], server: Server, client: Client) -> None:
    created = client.create_episode(**SMALL)
    prompts: list[str] = []

    def decide(seen: wire.Observation) -> Any:
        prompts.append(seen["prompt"] or "")
        return {"response": f"ACTION: {blink(seen)}\nMSG: on"}

    play(server.url, created["swarm_token"], decide, prompt=True)
    ended = client.episode(created["id"])
    assert (ended["status"], ended["score"]) == ("finished", 4.0)
    assert len(prompts) == 8
    assert all(prompt.startswith("You are Agent_") for prompt in prompts)
    # A second call returns at once: all games are over.
    play(server.url, created["swarm_token"], decide)


@both
def test_what_was_interrupted_is_played_on(play: Callable[..., None], server: Server, client: Client) -> None:
    created = client.create_episode(**SMALL)

    def fails(seen: wire.Observation) -> str:
        if seen["round"] == 2:
            raise KeyError("no idea")
        return blink(seen)

    with pytest.raises(KeyError, match="no idea"):
        play(server.url, created["swarm_token"], fails)
    assert client.episode(created["id"])["round"] == 2
    play(server.url, created["swarm_token"], blink)
    assert client.episode(created["id"])["score"] == 4.0


@both
@pytest.mark.parametrize("decision", [None, 3, ["UP"]])
def test_a_decision_that_is_none_is_told(play: Callable[..., None], decision: object, server: Server) -> None:
    with server.client() as client:
        token = client.create_episode(**SMALL)["swarm_token"]
    with pytest.raises(ArgumentError, match="an agent decides with the name of an action"):
        play(server.url, token, lambda _: decision)


@both
def test_an_act_that_the_server_refuses_is_an_error(play: Callable[..., None], server: Server) -> None:
    with server.client() as client:
        token = client.create_episode(**SMALL)["swarm_token"]
    with pytest.raises(ApiError) as error:
        play(server.url, token, lambda _: {"action": "UP", "to": 7})
    assert error.value.status in {400, 422}


@pytest.mark.parametrize(("refusals", "is_played"), [(3, True), (DELAYS_MAX + 1, False)])
def test_acts_that_cannot_be_taken_now_are_decided_again(
    refusals: int, is_played: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    pauses: list[float] = []
    monkeypatch.setattr("swarmseat.client.time.sleep", pauses.append)
    told = {"type": "about:blank", "title": "", "status": 503, "detail": "not now", "code": "overloaded"}
    left = [told | {"retry_after_ms": 200}] * refusals + [told | {"code": "round_over"}]

    def answer(request: httpx.Request) -> httpx.Response:
        if request.url.path == "/swarm/act":
            return httpx.Response(200, json={"receipts": [left.pop(0)]})
        seen = {"episode": "ep_1", "agent": "Agent_0", "round": 0}
        observations = [seen] if left else []
        return httpx.Response(200, json={"observations": observations, "cursor": "", "finished": not left})

    with httpx.Client(transport=httpx.MockTransport(answer)) as http:
        client = Client("http://127.0.0.1:9", "swarm_x", http=http)
        if is_played:
            client.play(lambda _: "UP")
            assert pauses == [0.2] * refusals + [0.0]
        else:
            with pytest.raises(ApiError, match="not now"):
                client.play(lambda _: "UP")


def test_the_page_plays_an_attempt_and_resumes_it(cup: Cup) -> None:
    (block,) = [block for _, block in BLOCK.findall(PAGE) if "start_attempt" in block]
    names: dict[str, Any] = {}
    exec(f"import swarmseat\n{block}", names)
    play_attempt: Callable[..., wire.AttemptSummary] = names["play_attempt"]
    key = cup.enter()

    def fails(seen: wire.Observation) -> str:
        if seen["round"] == 1:
            raise KeyError("no idea")
        return "STAY"

    with Client(cup.url, key) as client:
        with pytest.raises(KeyError, match="no idea"):
            play_attempt(client, cup.id, fails)
        (begun,) = client.attempts(cup.id)["items"]
        assert (begun["status"], begun["total"]) == ("running", None)
        ended = play_attempt(client, cup.id, lambda _: "STAY")
        assert (ended["run"], ended["status"], ended["games_ended"]) == (begun["run"], "finished", 2)
        assert ended["total"] is not None
        assert client.attempts(cup.id)["items"] == [ended]


def test_attempts_are_played_with_asyncio(cup: Cup) -> None:
    async def main() -> None:
        async with AsyncClient(cup.url, cup.enter()) as client:
            started = await client.start_attempt(cup.id)
            at_once = [0, 0]

            async def decide(seen: wire.Observation) -> str:
                at_once[0] += 1
                at_once[1] = max(at_once)
                await asyncio.sleep(0.01)
                at_once[0] -= 1
                return "STAY" if seen["round"] else "UP"

            await client.with_token(started["swarm_token"]).play(decide, at_once=3)
            assert at_once == [0, 3]
            assert [attempt["status"] async for attempt in client.paginate(client.attempts, cup.id)] == ["finished"]

    asyncio.run(main())
