"""Every call, by both clients, against a real server. Each answer must have the shape of its type."""

import asyncio
import inspect
import json
from collections.abc import Callable, Iterator
from typing import Any, get_args

import httpx
import pytest
from conftest import Cup
from shapes import differences
from typing_extensions import assert_type, get_type_hints

from swarmseat import (
    ApiError,
    AsyncClient,
    Client,
    ConnectionFailedError,
    Server,
    UnexpectedAnswerError,
    is_refused,
    wire,
)
from swarmseat.exchange import Call, Retry
from swarmseat.operation import Operation
from swarmseat.operations import Operations

SMALL: dict[str, Any] = {"task": "Synchronization", "num_agents": 2, "max_round": 2, "seed": 27}


class Checked:
    """A client whose answers are compared with their types. Each call of an `AsyncClient` runs a loop to its end."""

    asked: set[str] = set()  # noqa: RUF012 - shared by all on purpose

    def __init__(self, client: Client | AsyncClient, loop: asyncio.AbstractEventLoop) -> None:
        self.client = client
        self.loop = loop

    def __getattr__(self, name: str) -> Callable[..., Any]:
        method = getattr(self.client, name)
        operation = getattr(Operations, name)
        shape = get_args(get_type_hints(operation.__wrapped__)["return"])[0]

        def checked(*args: Any, **kwargs: Any) -> Any:
            answer = method(*args, **kwargs)
            if inspect.isawaitable(answer):
                answer = self.loop.run_until_complete(answer)
            Checked.asked.add(name)
            assert not differences(answer, shape), name
            return answer

        return checked

    def with_token(self, token: str) -> "Checked":
        return Checked(self.client.with_token(token), self.loop)

    def paginate(self, name: str, **query: Any) -> list[Any]:
        """All items of a list, from several pages."""
        client: Any = self.client
        return self.all_of(client.paginate(getattr(client, name), **query))

    def all_of(self, stream: Any) -> list[Any]:
        """All items of a stream or an iterator of either client."""
        if isinstance(self.client, Client):
            return list(stream)

        async def collect() -> list[Any]:
            return [item async for item in stream]

        return self.loop.run_until_complete(collect())


@pytest.fixture(params=["sync", "async"])
def checked(request: pytest.FixtureRequest, server: Server) -> Iterator[Checked]:
    loop = asyncio.new_event_loop()
    if request.param == "sync":
        with server.client() as client:
            yield Checked(client, loop)
    else:
        asynchronous = server.async_client()
        yield Checked(asynchronous, loop)
        loop.run_until_complete(asynchronous.aclose())
    loop.close()


def test_two_calls_play_a_seat(checked: Checked) -> None:
    created = checked.create_episode(**SMALL)
    first, second = (checked.with_token(seat["token"]) for seat in created["seats"])
    seen = first.obs(prompt=True)
    assert seen["round"] == 0
    assert "ACTION" in seen["prompt"]
    receipt = first.act(0, "STAY", message="all lights on", usage={"latency_ms": 3}, reasoning="none")
    assert (receipt["message"], receipt["waiting_for"]) == ("all lights on", 1)
    answer = second.act(0, response="I stay.\nACTION: STAY", wait=10)
    assert answer["obs"]["round"] == 1
    assert first.obs(after=0, wait=10)["round"] == 1
    # The time of a wait may be up.
    assert second.act(1, "SWITCH", wait=0)["obs"] is None
    assert first.act(1, "SWITCH", wait=10)["obs"]["result"]["reason"] == "rounds_played"


def test_a_swarm_plays_all_seats(checked: Checked) -> None:
    created = checked.create_episode(**SMALL)
    swarm = checked.with_token(created["swarm_token"])
    cursor = None
    for round in range(2):
        seen = swarm.swarm_obs(after=cursor, wait=10, limit=10, prompt=round == 0)
        cursor = seen["cursor"]
        acts = [
            {"episode": o["episode"], "agent": o["agent"], "round": round, "action": "STAY"}
            for o in seen["observations"]
        ]
        assert not any(map(is_refused, swarm.swarm_act(acts)["receipts"]))
    assert swarm.swarm_obs(wait=10)["finished"]
    refused = swarm.swarm_act([{"episode": created["id"], "agent": "Agent_0", "round": 7, "action": "STAY"}])[
        "receipts"
    ]
    assert [ApiError(problem).code for problem in refused if is_refused(problem)] == ["round_ahead"]


def test_a_step_is_one_call(checked: Checked) -> None:
    created = checked.create_episode(
        **{**SMALL, "prompt_template": "{% if round == 1 %}{{ none.at.all }}{% endif %}go"}
    )
    swarm = checked.with_token(created["swarm_token"])

    def acts(round: int) -> list[dict[str, Any]]:
        return [
            {"episode": created["id"], "agent": seat["agent"], "round": round, "action": "STAY"}
            for seat in created["seats"]
        ]

    answer = swarm.swarm_act(acts(0), wait=10, prompt=True)
    assert answer["problem"]["code"] == "template_failed"
    assert answer["observations"] == []
    answer = swarm.swarm_act(acts(0), wait=10)
    assert [(seen["agent"], seen["round"]) for seen in answer["observations"]] == [("Agent_0", 1), ("Agent_1", 1)]
    assert not answer["finished"]
    answer = swarm.swarm_act(acts(1), wait=10, prompt=True)
    assert [seen["prompt"] for seen in answer["observations"]] == ["go", "go"]
    assert answer["finished"]


def test_episodes(checked: Checked) -> None:
    created = checked.create_episode(**SMALL, model="listed", start="manual", idempotency_key=f"k{id(checked)}")
    again = checked.create_episode(**SMALL, model="listed", start="manual", idempotency_key=f"k{id(checked)}")
    assert again["id"] == created["id"]
    assert again["swarm_token"] != created["swarm_token"]
    assert checked.episode(created["id"])["status"] == "waiting"
    assert checked.start_episode(created["id"])["status"] == "running"
    assert checked.state(created["id"], round=0)["round"] == 0
    checked.create_episode(**SMALL, model="listed")
    listed = checked.paginate("episodes", model="listed", limit=1)
    assert created["id"] in {episode["id"] for episode in listed}
    assert len(listed) >= 2
    assert checked.abort_episode(created["id"])["status"] == "aborted"
    first = json.loads(checked.journal(created["id"]).splitlines()[0])
    assert first["record"]["config"]["seed"] == 27
    assert checked.episodes(status="aborted", task="Synchronization", limit=1)["items"]
    for task in get_args(wire.TaskName):
        checked.state(checked.create_episode(task=task)["id"])
        sight = checked.with_token(checked.create_episode(task=task, num_agents=1, seed=1)["seats"][0]["token"]).obs()
        assert set(sight["actions"]) <= set(get_args(wire.ActionName))


def test_forks(checked: Checked) -> None:
    parent = checked.create_episode(**SMALL)["id"]
    made = checked.fork(parent, round=0, count=2, model="forked", idempotency_key=f"f{id(checked)}")
    again = checked.fork(parent, round=0, count=2, model="forked", idempotency_key=f"f{id(checked)}")
    ids = [episode["id"] for episode in made["episodes"]]
    assert ids == [episode["id"] for episode in again["episodes"]]
    assert {episode["id"] for episode in checked.paginate("episodes", fork_of=parent)} == set(ids)
    assert checked.episode(ids[0])["fork"] == made["fork"]
    assert made["fork"]["episode"] == parent
    assert checked.with_token(again["episodes"][1]["swarm_token"]).swarm_obs(limit=9)["observations"]


def test_seats_of_several_holders(checked: Checked) -> None:
    created = checked.create_episode(**SMALL, open_seats=1)
    assert checked.seats(created["id"])["open"] == 1
    claim = checked.claim_seats(created["id"], agent="Agent_1", model="second")
    assert [seat["agent"] for seat in claim["seats"]] == ["Agent_1"]
    assert checked.seats(created["id"])["seats"][1]["model"] == "second"
    with pytest.raises(ApiError) as error:
        checked.claim_seats(created["id"])
    assert error.value.code == "seat_taken"


def test_a_run_its_events_and_the_boards(checked: Checked) -> None:
    suite: dict[str, Any] = {"name": f"tiny {id(checked)}", "tasks": ["Synchronization"], "seeds": [1, 2]}
    suite["settings"] = {"num_agents": 1, "max_round": 2}
    run = checked.create_run(suite=suite, model="m", temperature=0.5, player="default")
    events = checked.all_of(checked.client.run_events(run["id"]))
    assert {event.event for event in events[:-1]} == {"game"}
    assert not [wrong for event in events[:-1] for wrong in differences(event.data, wire.RunGame)]
    assert events[-1].event == "finished"
    assert not differences(events[-1].data, wire.RunDetail)
    assert checked.run(run["id"])["status"] == "finished"
    assert checked.runs(suite=suite["name"])["items"][0]["id"] == run["id"]
    measured = checked.run_metrics(run["id"], definition="paper", limit=1)
    assert [game["episode"] for game in measured["items"]] == [checked.run(run["id"])["games"][0]["episode"]]
    scores = checked.run_scores(run["id"], points=1, limit=1)
    assert (scores["items"][0]["rounds"], len(scores["items"][0]["scores"])) == (2, 2)
    board = checked.leaderboard(suite=suite["name"], pick="last", reference=False)
    assert [row["run"] for row in board["items"]] == [run["id"]]
    assert checked.leaderboard_csv(suite=suite["name"]).count("\n") == 2
    other = checked.create_run(suite="quick", model="m")
    game = checked.run(other["id"])["games"][0]["episode"]
    assert checked.with_token(other["swarm_token"]).swarm_acts(episode=game, agent="Agent_0", last=3)["acts"] == []
    checked.with_token(other["swarm_token"]).abort_episode(game)
    assert checked.with_token(other["swarm_token"]).repeat_episode(game, "a wrong prompt")["id"] == game
    assert checked.renew_run_token(other["id"])["swarm_token"] != other["swarm_token"]
    assert checked.abort_run(other["id"])["status"] == "aborted"
    assert {"standard", "quick"} <= {suite["name"] for suite in checked.suites()["items"]}
    # The numbers of the paper are on the boards of the built-in suite.
    assert checked.leaderboard(rules="paper", task="Pursuit", sort="Pursuit", limit=3)["items"][0]["reference"]


def test_cross_play(checked: Checked) -> None:
    created = checked.create_episode(**SMALL, open_seats=1, model="a")
    claim = checked.claim_seats(created["id"], agent="Agent_1", model="b")
    for round in range(2):
        for token in created["swarm_token"], claim["swarm_token"]:
            seen = checked.with_token(token).swarm_obs(wait=10)["observations"][0]
            checked.with_token(seen and token).swarm_act(
                [{"episode": created["id"], "agent": seen["agent"], "round": round, "action": "STAY"}]
            )
    pairs = checked.cross_play(task="Synchronization")
    assert ["a", "b"] in [pair["models"] for pair in pairs["items"]]
    assert "a" in checked.cross_play_csv()


def test_events_of_an_episode(checked: Checked) -> None:
    created = checked.create_episode(**SMALL, player="random")
    events = checked.all_of(checked.client.events(created["id"]))
    assert [event.event for event in events] == ["round", "round", "finished"]
    assert [event.id for event in events] == ["1", "2", None]
    assert not differences(events[0].data, wire.RoundEvent)
    assert not differences(events[-1].data, wire.EpisodeResult)
    assert checked.metrics(created["id"], series=True)["rounds"] == 2
    assert not checked.worth(created["id"])["missing"]
    assert [round["round"] for round in checked.line(created["id"], round=1)["rounds"]] == [1]
    replay = checked.replay(created["id"], from_=1, rounds=1, ground=False)
    assert [state["round"] for state in replay["states"]] == [1, 2]
    act = checked.agent_round(created["id"], 1, "Agent_0")
    assert (act["act"]["source"], act["observation"]["round"]) == ("player", 1)
    assert checked.scores(created["id"], points=2)["every"] == 1
    assert checked.verification(created["id"])["ok"]
    later = checked.all_of(checked.client.events(created["id"], after=1))
    assert [event.id for event in later] == ["2", None]


def test_attempts_in_a_competition(checked: Checked, cup: Cup) -> None:
    client = type(checked.client)(cup.url, cup.enter())
    own = Checked(client, checked.loop)
    started = own.start_attempt(cup.id, idempotency_key="the first")
    assert (started["attempt"], started["games"]) == (1, 2)
    again = own.start_attempt(cup.id, idempotency_key="the first")
    assert again["run"] == started["run"]
    assert again["swarm_token"] != started["swarm_token"]
    assert own.start_attempt(cup.id, attempt=2, entrant=started["entrant"])["attempt"] == 2
    with pytest.raises(ApiError) as error:
        own.start_attempt(cup.id)
    assert error.value.code == "closed"
    listed = own.attempts(cup.id)["items"]
    assert [attempt["status"] for attempt in listed] == ["running"] * 2
    assert own.paginate("attempts", competition=cup.id, limit=1) == listed
    if isinstance(client, Client):
        client.close()
    else:
        checked.loop.run_until_complete(client.aclose())


def test_errors_carry_the_problem(checked: Checked) -> None:
    with pytest.raises(ApiError) as error:
        checked.create_episode(task="Foraging", width=4, height=300)
    assert (error.value.status, error.value.code) == (422, "invalid")
    assert {field["field"] for field in error.value.fields} == {"width", "height"}
    assert "width" in str(error.value)
    assert error.value.request_id
    with pytest.raises(ApiError) as error:
        checked.episode("ep_../../x y")
    assert error.value.code == "not_found"
    with pytest.raises(ApiError) as error:
        checked.with_token("seat_nobody").obs()
    assert error.value.code == "unauthorized"
    assert "seat_nobody" not in str(error.value)
    with pytest.raises(ApiError) as error:
        checked.all_of(checked.client.events("ep_none"))
    assert error.value.code == "not_found"
    seat = checked.with_token(checked.create_episode(**SMALL)["seats"][0]["token"])
    with pytest.raises(ApiError) as error:
        seat.act(5, "STAY")
    assert (error.value.code, error.value.round) == ("round_ahead", 0)


def test_the_rest_is_within_reach(checked: Checked) -> None:
    assert checked.health()["status"] == "ok"
    assert checked.ready()["status"] == "ok"
    assert checked.request("GET", "/api/v1/competitions", query={"limit": 1})["items"] == []
    with pytest.raises(ApiError) as error:
        checked.repeat_episode(checked.create_episode(**SMALL)["id"], "it is no game of a run")
    assert error.value.code == "changed"
    # The call needs an organizer's key, and a server without keys knows none.
    with pytest.raises(ApiError) as error:
        checked.void_episode(checked.create_episode(**SMALL)["id"], "a power cut")
    assert error.value.code in {"unauthorized", "forbidden"}


def test_every_call_was_made() -> None:
    made = {name for name in dir(Operations) if isinstance(getattr(Operations, name), Operation)}
    # That server only answers requests with a key.
    assert made - Checked.asked == {"void_episode"}


def test_what_is_told_of_a_client_has_no_token(server: Server) -> None:
    client = Client(server.url, "secret_1234")
    assert "secret" not in repr(client)
    assert "secret" not in repr(client.obs)
    client.close()


def test_server_and_token_come_from_the_environment(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    with server.client() as client:
        created = client.create_episode(task="Foraging")
    monkeypatch.setenv("SWARMBENCH_URL", server.url + "/")
    monkeypatch.setenv("SWARMBENCH_TOKEN", created["seats"][3]["token"])
    with Client() as seat:
        assert seat.obs()["agent"] == "Agent_3"


def test_a_proxy_of_the_environment_is_not_asked_for_this_machine(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HTTP_PROXY", "http://127.0.0.1:9")
    with server.client() as client:
        assert client.health()["status"] == "ok"


# Retries without any network. Pauses are noted, not slept.


@pytest.fixture
def pauses(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    noted: list[float] = []

    async def note(seconds: float) -> None:
        noted.append(seconds)

    monkeypatch.setattr("swarmseat.client.time.sleep", noted.append)
    monkeypatch.setattr("swarmseat.client.asyncio.sleep", note)
    return noted


def problem(status: int, code: str, headers: dict[str, str] | None = None, **more: object) -> httpx.Response:
    told = {"type": f"urn:swarmbench:problem:{code}", "title": code, "status": status, "detail": "…", "code": code}
    return httpx.Response(status, json=told | more, headers=headers)


def ok() -> httpx.Response:
    return httpx.Response(200, json={"status": "ok", "version": "1"})


def answering(*answers: httpx.Response | Exception) -> tuple[httpx.MockTransport, list[httpx.Request]]:
    """A transport that gives these answers one after the other, and the requests that it got."""
    left, asked = list(answers), []

    def handle(request: httpx.Request) -> httpx.Response:
        asked.append(request)
        answer = left.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    return httpx.MockTransport(handle), asked


def ask(kind: str, transport: httpx.MockTransport, question: Callable[[Any], Any], retry: Retry | None = None) -> Any:
    if kind == "sync":
        return question(Client("http://test", "", retry=retry, http=httpx.Client(transport=transport)))

    async def run() -> Any:
        return await question(AsyncClient("http://test", "", retry=retry, http=httpx.AsyncClient(transport=transport)))

    return asyncio.run(run())


both = pytest.mark.parametrize("kind", ["sync", "async"])


@both
def test_temporary_failures_are_tried_again(kind: str, pauses: list[float]) -> None:
    transport, asked = answering(
        problem(503, "overloaded", {"Retry-After": "2"}, retry_after_ms=1500),
        problem(429, "rate_limited", {"Retry-After": "7"}),
        httpx.Response(502, text="<html>Bad gateway</html>"),
        httpx.ConnectError("refused"),
        httpx.RemoteProtocolError("hung up"),
        ok(),
    )
    assert ask(kind, transport, lambda client: client.health())["status"] == "ok"
    assert len(asked) == 6
    # The client waits for the pause that the server names, exact to the millisecond if the server is.
    assert pauses[:2] == [1.5, 7.0]
    assert all(0.05 * 2**n <= pause <= 0.1 * 2**n for n, pause in enumerate(pauses) if n >= 2)


@both
def test_retry_after_may_be_a_date(kind: str, pauses: list[float]) -> None:
    transport, _ = answering(
        httpx.Response(503, headers={"Retry-After": "Fri, 31 Dec 1999 23:59:59 GMT"}),
        httpx.Response(503, headers={"Retry-After": "soon"}),
        ok(),
    )
    ask(kind, transport, lambda client: client.health())
    assert pauses[0] <= 0.1
    assert pauses[1] <= 0.2


@both
def test_text_that_is_no_unicode_is_sent_all_the_same(kind: str) -> None:
    transport, asked = answering(ok())
    ask(kind, transport, lambda client: client.act(0, response="half a \ud83d sign, and a whole \U0001f600"))
    assert json.loads(asked[0].content)["response"] == "half a ? sign, and a whole \U0001f600"


@both
def test_it_gives_up_after_so_many_times(kind: str, pauses: list[float]) -> None:
    transport, asked = answering(*[httpx.ReadTimeout("timed out")] * 3)
    with pytest.raises(
        ConnectionFailedError, match=r"no answer to GET http://test/healthz: nothing came within 30 s \(3 attempts\)"
    ):
        ask(kind, transport, lambda client: client.health(), Retry(times=2))
    assert len(asked) == 3
    assert len(pauses) == 2


@both
def test_what_would_take_too_long_fails_at_once(kind: str, pauses: list[float]) -> None:
    transport, asked = answering(problem(503, "overloaded", retry_after_ms=61_000))
    with pytest.raises(ApiError, match="503 overloaded") as error:
        ask(kind, transport, lambda client: client.health())
    assert error.value.retry_after_s == 61.0
    assert (len(asked), pauses) == (1, [])


@both
@pytest.mark.parametrize("status", [400, 401, 403, 404, 409, 413, 422, 500])
def test_lasting_failures_are_not(kind: str, status: int, pauses: list[float]) -> None:
    transport, asked = answering(problem(status, "some_code"))
    with pytest.raises(ApiError, match="some_code"):
        ask(kind, transport, lambda client: client.health())
    assert (len(asked), pauses) == (1, [])


@both
def test_a_creation_that_is_tried_again_creates_nothing_twice(kind: str, pauses: list[float]) -> None:
    transport, asked = answering(httpx.ReadError("broken"), ok(), ok())
    ask(kind, transport, lambda client: client.create_episode(task="Foraging"))
    ask(kind, transport, lambda client: client.create_episode(task="Foraging"))
    keys = [request.headers["idempotency-key"] for request in asked]
    assert keys[0] == keys[1] != keys[2]
    assert len(pauses) == 1


@both
def test_what_does_not_speak_the_protocol_is_told(kind: str) -> None:
    for answer in httpx.Response(200, text="<html>hello"), httpx.Response(404, text="<html>"), httpx.Response(302):
        transport, _ = answering(answer)
        with pytest.raises(UnexpectedAnswerError, match=r"GET http://test/healthz.*no swarmbench server answers so"):
            ask(kind, transport, lambda client: client.health())


PAGE = "<html><style>h1 { color: red }</style><body><h1>Bad Gateway</h1>\nThe \x1b[31m answer.</body></html>"


@both
@pytest.mark.parametrize("status", [408, 500, 502, 503, 504, 599])
def test_a_page_of_a_proxy_is_tried_again_and_never_shown_as_it_is(kind: str, status: int, pauses: list[float]) -> None:
    transport, asked = answering(httpx.Response(status, text=PAGE), ok())
    assert ask(kind, transport, lambda client: client.health())["status"] == "ok"
    assert (len(asked), len(pauses)) == (2, 1)
    transport, asked = answering(*[httpx.Response(status, text=PAGE + "x" * 1000)] * 3)
    with pytest.raises(UnexpectedAnswerError) as error:
        ask(kind, transport, lambda client: client.health(), Retry(times=2))
    assert len(asked) == 3
    told = f"{status} of a proxy came for GET http://test/healthz: Bad Gateway The [31m answer. x"
    assert str(error.value).rstrip("x") == told.rstrip("x")
    assert len(str(error.value)) < 300


@both
@pytest.mark.parametrize("has_arrived", [True, False])
def test_what_is_done_behind_a_proxy_is_done_once(
    kind: str, has_arrived: bool, pauses: list[float], server: Server
) -> None:
    """The server dies with a request that did or did not arrive, and its proxy answers with a page."""
    lost: list[bool] = []

    def handle(request: httpx.Request) -> httpx.Response:
        is_lost = bool(lost) and lost.pop()
        if is_lost and not has_arrived:
            return httpx.Response(504, text=PAGE)
        url = request.url.copy_with(host="127.0.0.1", port=int(server.url.rpartition(":")[2]))
        headers = [(name, value) for name, value in request.headers.items() if name != "host"]
        answer = httpx.request(request.method, url, content=request.content, headers=headers)
        return httpx.Response(502, text=PAGE) if is_lost else httpx.Response(answer.status_code, content=answer.content)

    transport = httpx.MockTransport(handle)
    lost.append(True)
    created = ask(kind, transport, lambda client: client.create_episode(**SMALL, model=f"{kind}, {has_arrived}"))
    with server.client() as client:
        made = client.episodes(model=f"{kind}, {has_arrived}")["items"]
    assert [episode["id"] for episode in made] == [created["id"]]
    lost.append(True)
    answer = ask(kind, transport, lambda client: client.with_token(created["seats"][0]["token"]).act(0, "STAY"))
    assert (answer["round"], answer["duplicate"]) == (0, has_arrived)
    acts: Any = [{"episode": created["id"], "agent": "Agent_1", "round": 0, "action": "STAY"}]
    lost.append(True)
    answer = ask(kind, transport, lambda client: client.with_token(created["swarm_token"]).swarm_act(acts))
    assert [receipt["duplicate"] for receipt in answer["receipts"]] == [has_arrived]
    assert len(pauses) == 3
    with server.client() as client:
        journal = client.with_token(created["swarm_token"]).journal(created["id"])
    assert journal.count(b'"action":"STAY"') == 2


@both
def test_a_wait_is_waited_for(kind: str) -> None:
    transport, asked = answering(ok())
    ask(kind, transport, lambda client: client.obs(after=1, wait=60))
    assert asked[0].extensions["timeout"]["read"] > 60
    assert asked[0].url.query == b"after=1&wait=60"


@both
def test_a_broken_stream_is_resumed(kind: str, pauses: list[float]) -> None:
    def broken() -> Iterator[bytes]:
        yield b'event: round\nid: 1\ndata: {"round": 1}\n\n: a comment\n\nevent: rou'
        raise httpx.ReadError("broken")

    async def broken_async() -> Any:
        for part in b'event: round\nid: 1\ndata: {"round": 1}\n\n: a comment\n\nevent: rou'.splitlines(keepends=True):
            yield part
        raise httpx.ReadError("broken")

    end = b'event: round\nid: 2\ndata: {"round": 2}\n\nevent: finished\ndata: {"score": 0}\n\n'
    first = httpx.Response(200, content=broken() if kind == "sync" else broken_async())
    transport, asked = answering(first, problem(503, "overloaded"), httpx.Response(200, content=end))

    async def collect(client: AsyncClient) -> list[Any]:
        return [event async for event in client.events("ep_1")]

    events = ask(kind, transport, lambda client: list(client.events("ep_1")) if kind == "sync" else collect(client))
    assert [(event.event, event.id) for event in events] == [("round", "1"), ("round", "2"), ("finished", None)]
    assert [request.headers.get("last-event-id") for request in asked] == [None, "1", "1"]
    assert len(pauses) == 2


@both
def test_types_are_known_to_editors(kind: str) -> None:
    """mypy reads this test: it reports each `ignore` that is not needed."""
    created = {"id": "ep_1", "status": "running", "config": {}, "seats": [], "swarm_token": "swarm_1"}

    def blocking(client: Client) -> None:
        assert_type(client.create_episode(task="Foraging", seed=27), wire.CreatedEpisode)
        for episode in client.paginate(client.episodes, task="Foraging"):
            assert_type(episode, wire.EpisodeSummary)

    async def asynchronous(client: AsyncClient) -> None:
        assert_type(await client.create_episode(task="Foraging", seed=27), wire.CreatedEpisode)
        async for episode in client.paginate(client.episodes, task="Foraging"):
            assert_type(episode, wire.EpisodeSummary)

    def wrong(client: Client) -> None:
        client.create_episode(task="Chess")  # type: ignore[arg-type]
        client.create_episode(task="Foraging", sead=27)  # type: ignore[call-arg]
        client.state()  # type: ignore[call-arg]

    answers = httpx.Response(201, json=created), httpx.Response(200, json={"items": [created], "next_cursor": None})
    transport, asked = answering(*answers)
    ask(kind, transport, blocking if kind == "sync" else asynchronous)
    assert len(asked) == 2
    assert callable(wrong)


def test_a_call_says_what_it_asks() -> None:
    asked = Operations.state.__wrapped__(None, "ep_1", round=3)  # type: ignore[attr-defined]
    assert isinstance(asked, Call)
    assert (asked.method, asked.path, asked.query) == ("GET", "/api/v1/episodes/ep_1/state", {"round": "3"})
    assert "round" in inspect.signature(Client.state).parameters
    assert "round" in inspect.signature(Client(token="").state).parameters
    assert (Client.state.__doc__ or "").startswith("Show the whole world")
