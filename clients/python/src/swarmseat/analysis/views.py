"""The windows of agents when they decided: from the table `views`, or rebuilt from the maps of the table `rounds`."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..cells import CHANNELS, encode_cells
from .problems import FilesError
from .statistics import Floats

FLAGGED_TASKS = frozenset({"Synchronization", "Foraging"})
"""Tasks in which agents have a light or a load. A map shows `A` for an agent with it, and `a` for one without."""

Maps = Mapping[tuple[str, int], str]
"""Maps by episode and round."""


class Seat(NamedTuple):
    """The place and the view of an agent that decided: `radius` is None if the agent saw the whole map."""

    episode: str
    round: int
    i: int
    j: int
    flagged: bool
    inverted: bool
    radius: int | None


def seats_of(acts: pd.DataFrame) -> list[Seat]:
    """The seats of acts, which also need the columns `task`, `rules`, `control` and `view_size`."""
    names = ("episode", "round", "i", "j", "task", "rules", "control", "view_size")
    return [
        Seat(
            str(episode),
            int(number),
            int(i),
            int(j),
            task in FLAGGED_TASKS,
            rules == "reference",
            None if control == "centralized" else int(size) // 2,
        )
        for episode, number, i, j, task, rules, control, size in zip(*(acts[name] for name in names), strict=True)
    ]


def maps_of(rounds: pd.DataFrame) -> Maps:
    """The maps of the table `rounds`."""
    columns = (rounds[name].tolist() for name in ("episode", "round", "grid"))
    return {(episode, number): grid for episode, number, grid in zip(*columns, strict=True)}


def own_marks(seats: Iterable[Seat], maps: Maps) -> NDArray[np.bool_]:
    """Whether each agent's own light was on, or it carried food."""
    return np.array([seat.flagged and _rows(seat, maps)[seat.i][seat.j] == "A" for seat in seats])


def windows(seats: Iterable[Seat], maps: Maps) -> Floats:
    """The windows of seats, one row per seat: each cell in one of `CHANNELS`."""
    encoded: dict[tuple[str, int], NDArray[np.uint8]] = {}
    found = []
    for seat in seats:
        key = (seat.episode, seat.round)
        if key not in encoded:
            encoded[key] = _encode(seat, maps)
        found.append(_window(seat, encoded[key]).ravel())
    return np.array(found, float)


def _encode(seat: Seat, maps: Maps) -> NDArray[np.uint8]:
    """The map inside a margin of outside cells that is as wide as a window reaches."""
    marked, unmarked = ("0", "$0") if seat.inverted else ("$0", "0")
    symbols = {"A": marked if seat.flagged else "0", "a": unmarked}
    rows = [[symbols.get(cell, cell) for cell in row] for row in _rows(seat, maps)]
    margin = seat.radius or 0
    side, above = ["*"] * margin, [["*"] * (len(rows[0]) + 2 * margin)] * margin
    return _cells([*above, *([*side, *row, *side] for row in rows), *above])


def _window(seat: Seat, encoded: NDArray[np.uint8]) -> NDArray[np.uint8]:
    height, width = encoded.shape[1:] if seat.radius is None else (2 * seat.radius + 1,) * 2
    top, left = (0, 0) if seat.radius is None else (seat.i, seat.j)
    window = encoded[:, top : top + height, left : left + width].copy()
    row, column = (seat.i, seat.j) if seat.radius is None else (seat.radius, seat.radius)
    window[:, row, column] = 0
    window[CHANNELS.index("self"), row, column] = 1
    return window


def _rows(seat: Seat, maps: Maps) -> list[str]:
    grid = maps.get((seat.episode, seat.round))
    if grid is None:
        raise FilesError(
            f"the table rounds lacks round {seat.round} of {seat.episode}: export the games again, all tables at once"
        )
    return grid.split("\n")


def encode_views(views: Iterable[str], agents: Iterable[int]) -> Floats:
    """The texts of the table `views`, one row per text: each cell in one of `CHANNELS`."""
    return np.array([_encode_view(view, int(agent)).ravel() for view, agent in zip(views, agents, strict=True)], float)


def _encode_view(view: str, agent: int) -> NDArray[np.uint8]:
    if not view:
        raise FilesError("the table views lacks an act of the table acts: export the games again, all tables at once")
    # An agent may see itself under its own number.
    own = {str(agent), f"${agent}"}
    return _cells([["Y" if cell in own else cell for cell in row.split()] for row in view.split("\n")])


def _cells(rows: list[list[str]]) -> NDArray[np.uint8]:
    try:
        return encode_cells(rows)[0]
    except ValueError as error:
        raise FilesError(
            f"a map or window is damaged, or of a newer version ({error}): install that of the server"
        ) from error
