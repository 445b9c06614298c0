"""The settings of a game: their names, types, defaults and checks. docs/rules.md says what they mean."""

from collections.abc import Mapping
from typing import Any, cast, get_args

from ._compat import TypedDict
from .checks import one_of, probability, whole
from .names import Control, RuleSet

SEED_MAX = 2**53 - 1


class GameSettings(TypedDict, total=False):
    """Settings of a game. Those that are left out are those of the standard setting.

    Attributes:
        num_agents: The number of agents.
        rules: The rule set.
        width: Columns of the map.
        height: Rows of the map.
        view_size: The side of an agent's window, in cells.
        memory: The number of earlier rounds in a prompt.
        max_round: The maximum number of rounds of an episode.
        control: Under `centralized` every agent sees the whole map.
        noise: The probability that a delivered message is corrupted.
        max_delay: The maximum delay of a message, in rounds.
    """

    num_agents: int
    rules: RuleSet
    width: int
    height: int
    view_size: int
    memory: int
    max_round: int
    control: Control
    noise: float
    max_delay: int


STANDARD: GameSettings = {
    "num_agents": 12, "rules": "paper", "width": 10, "height": 10, "view_size": 5, "memory": 5, "max_round": 100,
    "control": "decentralized", "noise": 0.0, "max_delay": 0,
}  # fmt: skip

_LIMITS = {"num_agents": (1, 1024), "memory": (0, 2**31), "max_delay": (0, 2**31)}


def complete(given: Mapping[str, Any]) -> GameSettings:
    """All settings, with those that are given. The server checks the limits that depend on other settings."""
    settings: dict[str, Any] = {**STANDARD, **given}
    if unknown := settings.keys() - STANDARD.keys():
        raise TypeError(f"{min(unknown)!r} is no argument and no setting: settings are {', '.join(STANDARD)}")
    one_of("rules", settings["rules"], get_args(RuleSet))
    one_of("control", settings["control"], get_args(Control))
    settings["noise"] = probability("noise", settings["noise"])
    for name, usual in STANDARD.items():
        if isinstance(usual, int):
            settings[name] = whole(name, settings[name], *_LIMITS.get(name, (1, 2**31)))
    return cast("GameSettings", settings)
