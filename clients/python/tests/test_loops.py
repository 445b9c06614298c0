"""The package in programs with a running event loop, such as notebooks. test_docs.py runs a real notebook."""

import asyncio
import contextvars
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import pytest

from swarmseat import ApiError, ArgumentError, AsyncClient, Client, Server, parallel_env, run_async

name = contextvars.ContextVar("name", default="nobody")


async def health(url: str) -> str:
    async with AsyncClient(url, "") as client:
        return (await client.health())["status"]


def in_a_loop(call: Callable[[], Any]) -> Any:
    async def main() -> Any:
        return call()

    return asyncio.run(main())


def both(call: Callable[[], Any]) -> list[Any]:
    return [call(), in_a_loop(call)]


def test_a_coroutine_runs_with_and_without_a_loop(server: Server) -> None:
    assert both(lambda: run_async(health(server.url))) == ["ok", "ok"]


def test_what_blocks_works_in_a_running_loop(server: Server) -> None:
    def play() -> int:
        with parallel_env(num_agents=1, max_round=2, server=server) as env, Client(server.url, "") as client:
            env.reset()
            while env.agents:
                env.step({"Agent_0": 4})
            assert env.episode is not None
            return len(list(client.events(env.episode)))

    assert both(play) == [3, 3]


def test_errors_and_context_go_through(server: Server) -> None:
    async def asks() -> Any:
        async with AsyncClient(server.url, "") as client:
            return await client.episode(name.get())

    def call() -> Any:
        token = name.set("ep_mine")
        try:
            with pytest.raises(ApiError, match="not_found"):
                run_async(asks())
        finally:
            name.reset(token)

    both(call)

    async def who() -> str:
        return name.get()

    name.set("somebody")
    assert both(lambda: run_async(who())) == ["somebody", "somebody"]


def test_an_interrupt_cancels_the_coroutine(monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[str] = []
    began = threading.Event()

    async def sleep() -> None:
        try:
            began.set()
            await asyncio.sleep(60)
        finally:
            ended.append("cancelled")

    def interrupted(_: Future[None]) -> None:
        assert began.wait(10)
        raise KeyboardInterrupt

    monkeypatch.setattr(Future, "result", interrupted)
    with pytest.raises(KeyboardInterrupt):
        in_a_loop(lambda: run_async(sleep()))
    assert ended == ["cancelled"]


def test_only_coroutines_are_taken() -> None:
    with pytest.raises(ArgumentError, match=r"main\(\)"):
        run_async(health)  # type: ignore[arg-type]
