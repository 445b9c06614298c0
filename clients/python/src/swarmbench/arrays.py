"""Observations as arrays of fixed shapes, and the spaces that contain them."""

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from .wire import Observation, State

CHANNELS = ("empty", "outside", "wall", "block", "prey", "nest", "food", "self", "agent", "marked agent")
"""What the first axis of `view` means. Exactly one channel of each cell is 1."""

MESSAGE_CHARS_MAX = 120
"""How long a message is; a longer one is cut by the server."""

PRINTABLE = frozenset(chr(code) for code in range(0x20, 0x7F))
"""The characters of messages: also noise puts in none but these."""

PROMPT_CHARS_MAX = 1_048_576

_SYMBOLS = {".": 0, "*": 1, "W": 2, "B": 3, "P": 4, "N": 5, "F": 6, "Y": 7}
_ROWS = np.eye(len(CHANNELS), dtype=np.uint8)


class _Cells(dict[str, tuple[int, int]]):
    """Channel and agent's number of every symbol; those of agents are added as they are met."""

    def __missing__(self, symbol: str) -> tuple[int, int]:
        number = symbol.removeprefix("$")
        if not number.isdecimal():
            raise ValueError(f"the cell {symbol!r} is of a newer server")
        self[symbol] = (CHANNELS.index("marked agent" if symbol.startswith("$") else "agent"), int(number))
        return self[symbol]


_CELLS = _Cells({symbol: (channel, -1) for symbol, channel in _SYMBOLS.items()})


class Layout:
    """The shapes of one task's observations.

    Args:
        task: The task.
        window: Rows and columns of what an agent sees.
        size: Rows and columns of the map.
        num_agents: How many agents there are.
        max_round: After how many rounds an episode ends.
        messages: Whether agents talk.
    """

    def __init__(
        self, task: str, window: tuple[int, int], size: tuple[int, int], num_agents: int, max_round: int, messages: bool
    ) -> None:
        self.window = window
        self.messages = messages
        self.flag = {"Synchronization": "light_on", "Foraging": "carrying_food"}.get(task)
        self._num_agents = num_agents
        self._size = size
        self._max_round = max_round

    def space(self) -> dict[str, spaces.Space[Any]]:
        """The spaces of all parts of an observation."""
        last_cell = np.array(self._size, dtype=np.int32) - 1
        parts: dict[str, spaces.Space[Any]] = {
            "view": spaces.Box(0, 1, (len(CHANNELS), *self.window), np.uint8),
            "agents": spaces.Box(-1, self._num_agents - 1, self.window, np.int32),
            "position": spaces.Box(np.full(2, -1, np.int32), last_cell, dtype=np.int32),
            "round": spaces.Box(0, self._max_round, (1,), np.int32),
            "score": spaces.Box(0.0, np.inf, (1,), np.float32),
        }
        if self.flag is not None:
            parts[self.flag] = spaces.Box(0, 1, (1,), np.uint8)
        if self.messages:
            # A message that is too long arrives cut, with `...` behind it.
            text = spaces.Text(MESSAGE_CHARS_MAX + 3, min_length=1, charset=PRINTABLE)
            parts["messages"] = spaces.Sequence(text)
        return parts

    def encode(self, observation: Observation) -> dict[str, Any]:
        """An observation as arrays. An agent that has escaped is at (-1, -1) and sees nothing but the outside."""
        view, position = observation["view"], observation["position"]
        rows = [["*"] * self.window[1]] * self.window[0] if view is None else view["cells"]
        channels, agents = encode_cells(rows)
        parts: dict[str, Any] = {
            "view": channels,
            "agents": agents,
            "position": np.array((-1, -1) if position is None else (position["i"], position["j"]), np.int32),
            "round": np.array([observation["round"]], np.int32),
            "score": np.array([observation["score"]], np.float32),
        }
        if self.flag == "light_on":
            parts[self.flag] = np.array([bool(observation.get("light_on"))], np.uint8)
        elif self.flag == "carrying_food":
            parts[self.flag] = np.array([bool(observation.get("carrying_food"))], np.uint8)
        if self.messages:
            parts["messages"] = tuple(observation["messages"])
        return parts


def encode_cells(rows: list[list[str]]) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Rows of symbols as zeros and ones (channel, row, column), and the agents' numbers, -1 where there is none."""
    pairs = np.array([[_CELLS[symbol] for symbol in row] for row in rows], np.int32)
    return np.ascontiguousarray(np.moveaxis(_ROWS[pairs[:, :, 0]], -1, 0)), np.ascontiguousarray(pairs[:, :, 1])


def symbols_of(state: State) -> list[list[str]]:
    """The whole map in the symbols that agents see, with a number and a mark for each agent."""
    rows = [list(row) for row in state["grid"]]
    for number, agent in enumerate(state["agents"]):
        if agent["alive"]:
            marked = agent.get("light_on") or agent.get("carrying_food")
            rows[agent["i"]][agent["j"]] = f"${number}" if marked else str(number)
    return rows
