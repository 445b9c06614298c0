"""Coroutines in programs without asyncio, and in notebooks."""

import asyncio
import contextvars
import threading
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any, Generic, TypeVar

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
    return _Thread(main).result()


class _Thread(Generic[T]):
    """A coroutine that runs on a thread of its own."""

    def __init__(self, main: Coroutine[Any, Any, T]) -> None:
        self._main = main
        self._running: tuple[asyncio.AbstractEventLoop, asyncio.Task[T]] | None = None
        self._values: list[T] = []
        self._error: BaseException | None = None
        context = contextvars.copy_context()
        self._thread = threading.Thread(target=context.run, args=(self._run,), name="swarmseat.run_async", daemon=True)

    def result(self) -> T:
        """Starts the thread, and waits for the coroutine's result."""
        self._thread.start()
        try:
            self._thread.join()
        except BaseException:
            # A closed loop means that the coroutine has just ended.
            with suppress(RuntimeError):
                if self._running is not None:
                    self._running[0].call_soon_threadsafe(self._running[1].cancel)
            self._thread.join()
            raise
        if self._error is not None:
            raise self._error
        return self._values[0]

    def _run(self) -> None:
        async def run() -> T:
            task = asyncio.ensure_future(self._main)
            self._running = (asyncio.get_running_loop(), task)
            return await task

        try:
            self._values.append(asyncio.run(run()))
        except BaseException as error:
            self._error = error
