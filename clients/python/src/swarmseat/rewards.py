"""The rewards of agents in a round, computed from the agents' observations before and after it."""

from collections.abc import Mapping

from .settings import STANDARD
from .wire import Observation, Position

Cell = tuple[int, int]
Sights = Mapping[str, Observation]


def full_score(task: str, num_agents: int = STANDARD["num_agents"], max_round: int = STANDARD["max_round"]) -> float:
    """The score that counts as 1 when rewards are shares: about the score of the best built-in player.

    Pursuit and Synchronization: a point in every round. Foraging: a delivery of each agent in 30 rounds. Flocking and
    Transport: a point for each agent.
    """
    if task in {"Pursuit", "Synchronization"}:
        return float(max_round)
    return num_agents * max_round / 30 if task == "Foraging" else float(num_agents)


def team(before: Sights, after: Sights) -> dict[str, float]:
    """The change of the score for everybody."""
    gained = _score(after) - _score(before)
    return dict.fromkeys(before, gained)


def individual(task: str, before: Sights, after: Sights) -> dict[str, float]:
    """The agents' own parts of the change of the score.

    Foraging: 1 for each load that the agent delivered. Transport: the score of the agent's own leaving. Pursuit: the
    point of a caught prey in equal shares to the agents beside it. In these three the rewards add up to the change of
    the score. In Synchronization and Flocking contributions cannot be told apart: every agent gets the change of the
    score, as with `team`.
    """
    if task == "Foraging":
        return {
            agent: float(bool(sight.get("carrying_food")) and not after[agent].get("carrying_food"))
            for agent, sight in before.items()
        }
    if task == "Transport":
        return {
            agent: (sight["max_round"] - sight["round"]) / sight["max_round"] if not after[agent]["alive"] else 0.0
            for agent, sight in before.items()
        }
    if task == "Pursuit":
        gained = _score(after) - _score(before)
        hunters = _hunters(before, after) if gained > 0 else []
        return {agent: gained / len(hunters) if agent in hunters else 0.0 for agent in before}
    return team(before, after)


def _hunters(before: Sights, after: Sights) -> list[str]:
    """The agents beside the prey that was caught; all living agents if that cannot be known.

    The prey was in a cell that is enclosed now: none of its neighbours is empty, and all of them are seen, as the
    enclosing agents see them. A prey is caught where it was when the round was decided; only the first prey of the
    rules `reference` may have been pushed from there. So the nearest of several such cells is taken.
    """
    positions = {agent: _cell(at) for agent, sight in after.items() if (at := sight["position"]) is not None}
    now = _seen(after)
    traps = [
        cell
        for cell in sorted({beside for at in positions.values() for beside in _beside(at)})
        if now.get(cell, ".") in {".", "P"} and all(now.get(other, ".") != "." for other in _beside(cell))
    ]
    prey = next((cell for cell, symbol in _seen(before).items() if symbol == "P"), None)
    if prey is not None:
        traps.sort(key=lambda cell: abs(cell[0] - prey[0]) + abs(cell[1] - prey[1]))
    return [agent for agent, at in positions.items() if traps and traps[0] in _beside(at)] or list(positions)


def _seen(sights: Sights) -> dict[Cell, str]:
    """The cells that all agents together see."""
    cells: dict[Cell, str] = {}
    for number, sight in enumerate(sights.values()):
        view, position = sight["view"], sight["position"]
        if view is None or position is None:
            continue
        top, left = view["origin"]["i"], view["origin"]["j"]
        for a, row in enumerate(view["cells"]):
            for b, symbol in enumerate(row):
                cells[top + a, left + b] = symbol
        cells[_cell(position)] = str(number)
    return cells


def _cell(position: Position) -> Cell:
    return position["i"], position["j"]


def _beside(cell: Cell) -> list[Cell]:
    i, j = cell
    return [(i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)]


def _score(sights: Sights) -> float:
    return next(iter(sights.values()))["score"]
