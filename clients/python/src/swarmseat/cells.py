"""Cells as agents see them, as zeros and ones."""

from collections.abc import Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

CHANNELS = ("empty", "outside", "wall", "block", "prey", "nest", "food", "self", "agent", "marked agent")
"""The channels of `view`, its first axis. Exactly one channel of each cell is 1."""

_SYMBOLS = {".": 0, "*": 1, "W": 2, "B": 3, "P": 4, "N": 5, "F": 6, "Y": 7}
_CHANNEL_BITS = 4
_EACH_CHANNEL = np.arange(len(CHANNELS), dtype=np.int32)[:, None, None]


class _Codes(dict[str, int]):
    """A number for every symbol: its channel, and in higher bits 1 more than the agent's number.

    Symbols of agents are added when they first occur.
    """

    def __missing__(self, symbol: str) -> int:
        number = symbol.removeprefix("$")
        if not number.isdecimal():
            raise ValueError(f"the cell {symbol!r} is of a newer server")
        channel = CHANNELS.index("marked agent" if symbol.startswith("$") else "agent")
        self[symbol] = (int(number) + 1 << _CHANNEL_BITS) | channel
        return self[symbol]


_CODES = _Codes(_SYMBOLS)


def encode_maps(maps: Sequence[list[list[str]]]) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Encodes several maps of one size, at least one, as `encode_cells` does one; the maps are the first axis."""
    symbols = chain.from_iterable(chain.from_iterable(maps))
    codes = np.array([_CODES[symbol] for symbol in symbols], np.int32)
    codes = codes.reshape(len(maps), len(maps[0]), -1)
    planes = (codes & ((1 << _CHANNEL_BITS) - 1))[:, None] == _EACH_CHANNEL
    return planes.view(np.uint8), (codes >> _CHANNEL_BITS) - 1


def encode_cells(rows: list[list[str]]) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Rows of symbols as zeros and ones (channel, row, column), and the agents' numbers, -1 where there is none."""
    planes, agents = encode_maps([rows])
    return planes[0], agents[0]
