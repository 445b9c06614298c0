"""Coroutines in programs without asyncio, and in notebooks."""

import asyncio
import contextvars
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any, TypeVar

from .errors import ArgumentError

T = TypeVar("T")


def run_async(main: Coroutine[Any, Any, T]) -> T:
    """Runs a coroutine to its end and returns its result, even if an event loop runs already.

    In a notebook a loop runs already, and `asyncio.run` fails. There the coroutine gets a loop on a thread of its own,
    and the caller waits; the coroutine cannot use objects that belong to the caller's loop, such as an `AsyncClient`
    that was used there. Ctrl-C, or the notebook's stop, cancels the coroutine.
    """
    if not asyncio.iscoroutine(main):
        raise ArgumentError(f"run_async takes a coroutine, as main() of `async def main()` is, and not {main!r}")
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return asyncio.run(main)
    running: list[tuple[asyncio.AbstractEventLoop, asyncio.Task[Any]]] = []

    async def run() -> T:
        task = asyncio.ensure_future(main)
        running.append((asyncio.get_running_loop(), task))
        return await task

    with ThreadPoolExecutor(1, "swarmseat.run_async") as thread:
        ended = thread.submit(contextvars.copy_context().run, asyncio.run, run())
        try:
            return ended.result()
        except BaseException:
            # A closed loop means that the coroutine has just ended.
            with suppress(RuntimeError):
                for loop, task in running:
                    loop.call_soon_threadsafe(task.cancel)
            raise
