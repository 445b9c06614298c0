"""Teams: what changes when one player replaces another, seat by seat, and how good a player is with strangers.

All seats of a swarm share one score, so a player has none of its own: what it contributes is by how much the score
changes when it replaces others on some seats.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from .problems import TooLittleDataError
from .statistics import mean_interval
from .tables import Games

WHO = ("model", "mixed", "prompt")
"""The columns in which teams differ by nature: the identity of each holder is in `team_holders`."""

NO_IDENTITY = ("eval.identity", "eval.replay", "eval.prompt_revision", "eval.harness", "system_message")
"""The keys of `agent_meta` that tell nothing of a player which the name of its prompt does not tell."""

Scores: TypeAlias = "pd.Series[float]"
"""The mean score of each seed."""

Team: TypeAlias = tuple[tuple[str, int], ...]
"""The players of a team and the number of seats of each, by name."""


def substitution(games: Games) -> pd.DataFrame:
    """Scores of teams in which a player replaced another on some seats, and what that changed.

    A row for each task and number of replaced seats, for each ordered pair of players of which one played all seats of
    another team. `contribution` is the score beyond that without a replaced seat, paired by seed. The intervals are
    those of boards: 95 % by Student's t over the seeds, missing with fewer than three.

    A player is a model with its sampling, prompt and harness: where those of one model differ, its name says in what.

    Args:
        games: Games loaded with `mixed=[True, False]`, as teams of several holders are left out otherwise.

    Raises:
        TooLittleDataError: No player replaced another.
    """
    found = _scores_of_teams(games)
    pairs = {(of, by, total) for (of, _), (by, _), total in _mixed(team for team, _ in found)}
    rows = [
        {"of": of, "by": by, "task": task, "replaced": seats} | _scored(scores, base if seats else base.iloc[:0])
        for of, by, total in sorted(pairs)
        for task in games.tasks
        for base in [found.get((_team({of: total}), task))]
        if base is not None
        for seats in range(total + 1)
        for scores in [found.get((_team({of: total - seats, by: seats}), task))]
        if scores is not None
    ]
    if not rows:
        raise TooLittleDataError(
            "no player replaced another: it takes a team of two players, and one of the first alone; "
            "examples/eval/teams.toml plays some"
        )
    return pd.DataFrame(rows)


def focal(games: Games) -> pd.DataFrame:
    """Scores of players among strangers.

    A row for each task and each player that had the same number of seats in the swarms of at least two others, the
    backgrounds. `score` is the mean over the backgrounds and the seeds that all of them have. `contribution` is the
    score beyond that of the backgrounds on all seats, paired by seed; it is missing where one of these did not play
    alone. Players and intervals are those of `substitution`.

    Args:
        games: Games loaded with `mixed=[True, False]`, as teams of several holders are left out otherwise.

    Raises:
        TooLittleDataError: No player had the same number of seats in the swarms of two others.
    """
    found = _scores_of_teams(games)
    sets: dict[tuple[str, int, int, str], dict[str, Scores]] = {}
    for (team, task), scores in found.items():
        for (own, seats), (other, _), total in _mixed([team]):
            sets.setdefault((own, seats, total, task), {})[other] = scores
    rows: list[dict[str, Any]] = []
    for (own, seats, total, task), swarms in sorted(sets.items(), key=lambda item: item[0]):
        backgrounds = sorted(swarms)
        scores = _averaged([swarms[name] for name in backgrounds])
        if len(backgrounds) < 2 or scores.empty:
            continue
        alone = [found.get((_team({name: total}), task)) for name in backgrounds]
        known = [base for base in alone if base is not None]
        base = _averaged(known) if len(known) == len(alone) else scores.iloc[:0]
        head = {"focal": own, "seats": seats, "backgrounds": ", ".join(backgrounds), "task": task}
        rows.append(head | _scored(scores, base))
    if not rows:
        raise TooLittleDataError(
            "no player had the same number of seats in the swarms of two others: `focal` of an experiment plays such "
            "teams, as in examples/eval/teams.toml"
        )
    return pd.DataFrame(rows)


def _scores_of_teams(games: Games) -> dict[tuple[Team, str], Scores]:
    """The scores of each team in each task."""
    episodes = games.episodes
    played = episodes[episodes["team_holders"].notna()] if "team_holders" in episodes else episodes.iloc[:0]
    if played.empty:
        return {}
    Games(games.source, games.folders, played).one_setting(but=WHO)
    holders = {text: json.loads(text) for text in played["team_holders"].unique()}
    names = _names(holder for team in holders.values() for holder in team)
    teams = {}
    for text, team in holders.items():
        seats: dict[str, int] = {}
        for holder in team:
            name = names[_identity(holder)]
            seats[name] = seats.get(name, 0) + holder["seats"]
        teams[text] = json.dumps(_team(seats))
    groups = played.assign(team=played["team_holders"].map(teams)).groupby(["team", "task"])
    return {
        (tuple((name, seats) for name, seats in json.loads(str(team))), str(task)): own.groupby("seed")["score"].mean()
        for (team, task), own in groups
    }


def _names(holders: Iterable[Mapping[str, Any]]) -> dict[str, str]:
    """The name of each player by its identity: that of its model, with what it declares where others of it differ."""
    of_models: dict[str, dict[str, dict[str, str]]] = {}
    for holder in holders:
        of_models.setdefault(holder["model"], {})[_identity(holder)] = _declared(holder)
    names = {}
    for model, players in of_models.items():
        every = {item for declared in players.values() for item in declared.items()}
        shared = {item for item in every if all(item in declared.items() for declared in players.values())}
        for identity, declared in players.items():
            own = [f"{name} {value}" for name, value in sorted(declared.items()) if (name, value) not in shared]
            names[identity] = f"{model} ({', '.join(own)})" if own else model
    return names


def _identity(holder: Mapping[str, Any]) -> str:
    return json.dumps([holder["model"], _declared(holder)], sort_keys=True)


def _declared(holder: Mapping[str, Any]) -> dict[str, str]:
    """What a holder declares of its player: the keys of nested objects are written with dots, the values as JSON."""

    def flat(name: str, value: Any) -> Iterator[tuple[str, str]]:
        if name in NO_IDENTITY:
            return
        if isinstance(value, dict):
            for key, part in value.items():
                yield from flat(f"{name}.{key}" if name else key, part)
        else:
            yield name, json.dumps(value, ensure_ascii=False, sort_keys=True)

    # A player may declare a key `prompt`, too.
    told = {"agent_meta.prompt" if name == "prompt" else name: value for name, value in flat("", holder["agent_meta"])}
    return told | {"prompt": json.dumps(holder["prompt"])}


def _team(seats: Mapping[str, int]) -> Team:
    return tuple(sorted((name, count) for name, count in seats.items() if count))


def _mixed(teams: Iterable[Team]) -> Iterator[tuple[tuple[str, int], tuple[str, int], int]]:
    """The two players of each team of two, in both orders, with the number of seats."""
    for team in teams:
        if len(team) == 2:
            total = team[0][1] + team[1][1]
            yield team[0], team[1], total
            yield team[1], team[0], total


def _averaged(swarms: Iterable[Scores]) -> Scores:
    """Means over several swarms, of the seeds that all of them have."""
    return pd.concat(swarms, axis=1, join="inner").mean(axis=1)


def _scored(scores: Scores, base: Scores) -> dict[str, float | int]:
    gains = (scores - base).dropna()
    level, gain = mean_interval(np.asarray(scores, np.float64)), mean_interval(np.asarray(gains, np.float64))
    names = ("score", "score_low", "score_high", "contribution", "low", "high")
    return dict(zip(names, (*level, *gain), strict=True)) | {"pairs": len(gains)}
