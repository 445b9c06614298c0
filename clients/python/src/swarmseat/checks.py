"""Checks of arguments. An error names the argument, its allowed values and its value."""

import operator
from collections.abc import Iterable
from typing import Any

from .errors import ArgumentError
from .names import TASKS, TaskName


def one_of(name: str, value: object, allowed: Iterable[object]) -> None:
    """Checks that a value is one of a few."""
    listed = list(allowed)
    # Not `in`: an array compares itself with every element.
    if not any(value is one or (isinstance(value, str) and value == one) for one in listed):
        raise ArgumentError(f"{name} must be one of {', '.join(map(repr, listed))}, is {shown(value)}")


def whole(name: str, value: Any, least: int, most: int | None = None) -> int:
    """Reads a whole number of Python or NumPy."""
    try:
        number = None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        number = None
    if number is None or number < least or (most is not None and number > most):
        limits = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise ArgumentError(f"{name} must be a whole number {limits}, is {shown(value)}")
    return number


def probability(name: str, value: Any) -> float:
    """Reads a number from 0 to 1."""
    try:
        number = None if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError):
        number = None
    if number is None or not 0 <= number <= 1:
        raise ArgumentError(f"{name} must be a number from 0 to 1, is {shown(value)}")
    return number


def task_name(value: object) -> TaskName:
    """Reads the name of a task, in upper or lower case."""
    if isinstance(value, str):
        for task in TASKS:
            if value.casefold() == task.casefold():
                return task
    raise ArgumentError(f"task must be one of {', '.join(map(repr, TASKS))}, is {shown(value)}")


def agent_name(value: object, agents: list[str]) -> str:
    """Reads the name of an agent of the environment."""
    if not isinstance(value, str) or value not in agents:
        last = f" to {agents[-1]!r}" if len(agents) > 1 else ""
        raise ArgumentError(f"there is no agent {shown(value)}: agents are {agents[0]!r}{last}")
    return value


def shown(value: object) -> str:
    """A value as an error shows it: the beginning of a long one."""
    text = repr(value)
    return text if len(text) <= 100 else f"{text[:100]}…"
