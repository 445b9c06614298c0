"""Cells as agents see them, as zeros and ones."""

import numpy as np
from numpy.typing import NDArray

CHANNELS = ("empty", "outside", "wall", "block", "prey", "nest", "food", "self", "agent", "marked agent")
"""What the first axis of `view` means. Exactly one channel of each cell is 1."""

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


def encode_cells(rows: list[list[str]]) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Rows of symbols as zeros and ones (channel, row, column), and the agents' numbers, -1 where there is none."""
    pairs = np.array([[_CELLS[symbol] for symbol in row] for row in rows], np.int32)
    return np.ascontiguousarray(np.moveaxis(_ROWS[pairs[:, :, 0]], -1, 0)), np.ascontiguousarray(pairs[:, :, 1])
