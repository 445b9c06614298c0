"""Observations as arrays of fixed shapes, and the spaces that contain them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from .cells import CHANNELS, encode_cells, encode_maps
from .wire import Observation, State

__all__ = ["CHANNELS", "MESSAGE_CHARS_MAX", "PRINTABLE", "PROMPT_CHARS_MAX", "Layout", "encode_cells", "symbols_of"]

MESSAGE_CHARS_MAX = 120
"""The maximum length of a message that is sent. The server cuts a longer one to this length and appends `...`."""

MESSAGE_CHARS_RECEIVED_MAX = MESSAGE_CHARS_MAX + len("...")
"""The maximum length of a message that is received."""

PRINTABLE = frozenset(chr(code) for code in range(0x20, 0x7F))
"""The characters of messages. Noise inserts no others."""

PROMPT_CHARS_MAX = 1_048_576


class Layout:
    """The shapes of one task's observations.

    Args:
        task: The task.
        window: Rows and columns of an agent's window.
        size: Rows and columns of the map.
        num_agents: The number of agents.
        max_round: The maximum number of rounds of an episode.
        messages: Whether agents talk.
    """

    def __init__(
        self, task: str, window: tuple[int, int], size: tuple[int, int], num_agents: int, max_round: int, messages: bool
    ) -> None:
        self.window = window
        self.messages = messages
        self._farthest = np.array(size, np.float32) - 1
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
            text = spaces.Text(MESSAGE_CHARS_RECEIVED_MAX, min_length=1, charset=PRINTABLE)
            parts["messages"] = spaces.Sequence(text)
        return parts

    def flat_space(self) -> spaces.Box:
        """The space of observations as vectors of numbers from -1 to 1."""
        length = len(CHANNELS) * self.window[0] * self.window[1] + 3 + (self.flag is not None)
        return spaces.Box(-1.0, 1.0, (length,), np.float32)

    def flatten(self, parts: dict[str, Any]) -> NDArray[np.float32]:
        """Observations as vectors: the planes row by row, position, round and flag.

        Args:
            parts: Arrays of the shapes of `space()`, for one agent or, with more dimensions before these, for many.
        """
        view = parts["view"]
        place = np.maximum(parts["position"] / self._farthest * 2 - 1, -1)
        past = parts["round"] / np.float32(self._max_round)
        columns = [view.reshape(*view.shape[:-3], -1), place, past]
        if self.flag is not None:
            columns.append(parts[self.flag])
        return np.concatenate(columns, axis=-1, dtype=np.float32, casting="same_kind")

    def encode(self, observations: Sequence[Observation]) -> dict[str, Any]:
        """Observations, at least one, as arrays with the observations as first axis.

        An agent that has escaped is at (-1, -1) and sees only cells outside the map.
        """
        outside = [["*"] * self.window[1]] * self.window[0]
        views = [view["cells"] if (view := seen["view"]) else outside for seen in observations]
        places = [(at["i"], at["j"]) if (at := seen["position"]) else (-1, -1) for seen in observations]
        channels, agents = encode_maps(views)
        parts: dict[str, Any] = {
            "view": channels,
            "agents": agents,
            "position": np.array(places, np.int32),
            "round": np.array([[seen["round"]] for seen in observations], np.int32),
            "score": np.array([[seen["score"]] for seen in observations], np.float32),
        }
        if self.flag is not None:
            parts[self.flag] = np.array([[bool(seen.get(self.flag))] for seen in observations], np.uint8)
        if self.messages:
            parts["messages"] = [tuple(seen["messages"]) for seen in observations]
        return parts


def symbols_of(state: State) -> list[list[str]]:
    """The whole map in the symbols that agents see, with a number and a mark for each agent."""
    rows = [list(row) for row in state["grid"]]
    for number, agent in enumerate(state["agents"]):
        if agent["alive"]:
            marked = agent.get("light_on") or agent.get("carrying_food")
            rows[agent["i"]][agent["j"]] = f"${number}" if marked else str(number)
    return rows
