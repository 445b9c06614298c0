"""Plays a suite of games on a server with policies that `ppo.py` has learned, and shows the board.

    python examples/training/play.py runs/Foraging/policy.pt
    python examples/training/play.py runs/*/policy.pt --suite baselines

The policies play over HTTP, as any other player does: they get the server's observations, and each game has a journal
that anybody can verify. Without `--server` the program starts a server, with the database `--db`.
"""

import argparse
import contextlib
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from ppo import AGENTS, HELD_OUT, ROUNDS, SHOW_S, SIDE, WINDOW, Policy, Senses

import swarmseat
from swarmseat.arrays import Layout

PARALLEL = 16
"""The number of games that are open at a time."""


class Swarm:
    """A policy and the games that it plays.

    Args:
        file: The file that `ppo.py` has saved.
    """

    def __init__(self, file: Path) -> None:
        saved = torch.load(file, weights_only=True)
        self.task: str = saved["task"]
        self.learned = {"file": str(file), "seed": saved["seed"], "agent_steps": saved["spent"][2]}
        self._policy = Policy(Senses(self.task, AGENTS).size, len(saved["policy"]["actor.bias"]))
        self._policy.load_state_dict(saved["policy"])
        self._layout = Layout(self.task, (WINDOW, WINDOW), (SIDE, SIDE), AGENTS, ROUNDS, messages=False)
        self._games: dict[str, tuple[Senses, torch.Generator]] = {}

    @torch.no_grad()
    def acts(self, episode: str, seed: int, sights: list[Any]) -> list[dict[str, Any]]:
        """The acts of a game's agents that are asked.

        Args:
            episode: The game.
            seed: The seed of its layout, from which the choices among likely actions are drawn, too.
            sights: The observations of these agents, in the same order each time.
        """
        if episode not in self._games:
            self._games[episode] = Senses(self.task, AGENTS), torch.Generator().manual_seed(seed)
        senses, chance = self._games[episode]
        sights = sorted(sights, key=_number)
        arrays = self._layout.encode(sights)
        flag = self._layout.flag
        seen = senses.see(
            np.array([_number(sight) for sight in sights]),
            arrays["view"],
            arrays["position"],
            arrays["round"][:, 0],
            arrays[flag][:, 0] if flag else np.zeros(len(sights), np.uint8),
        )
        chosen = torch.multinomial(self._policy(seen)[0].exp(), 1, generator=chance).flatten().tolist()
        return [
            {"episode": episode, "agent": sight["agent"], "round": sight["round"], "action": sight["actions"][action]}
            for sight, action in zip(sights, chosen, strict=True)
        ]


def _number(sight: Any) -> int:
    return int(sight["agent"].removeprefix("Agent_"))


def play(client: swarmseat.Client, run: Any, swarms: dict[str, Swarm]) -> None:
    """Plays all games of a run."""
    seats = client.with_token(run["swarm_token"])
    seeds: dict[Any, Any] = {}
    shown = time.monotonic()
    while not (now := seats.swarm_obs(wait=30))["finished"]:
        games: dict[str, list[Any]] = {}
        for sight in now["observations"]:
            games.setdefault(sight["episode"], []).append(sight)
        if not games.keys() <= seeds.keys():
            seeds = {game["episode"]: game["seed"] for game in client.run(run["id"])["games"]}
        if time.monotonic() - shown >= SHOW_S:
            shown = time.monotonic()
            told = client.run(run["id"])
            print(f"{told['played']} of {told['planned']} games played", file=sys.stderr)
        acts: list[Any] = [
            act
            for episode, sights in games.items()
            for act in _decided(swarms.get(sights[0]["task"]["name"]), episode, seeds[episode], sights)
        ]
        refused = [answer for answer in seats.swarm_act(acts)["receipts"] if swarmseat.is_refused(answer)]
        if refused:
            raise SystemExit(f"the server refused an act: {refused[0]}")


def _decided(swarm: Swarm | None, episode: str, seed: int, sights: list[Any]) -> list[dict[str, Any]]:
    if swarm:
        return swarm.acts(episode, seed, sights)
    return [{**{name: sight[name] for name in ("episode", "agent", "round")}, "action": "STAY"} for sight in sights]


def _finished(client: swarmseat.Client, id: str) -> Any:
    told = client.run(id)
    if told["status"] != "finished":
        raise SystemExit(f"error: {id} is {told['status']}: {told['played']} of {told['planned']} games were played")
    return told


def show(client: swarmseat.Client, suite: str, tasks: list[Any]) -> None:
    """Prints the board of each task: means with their intervals of 95 %."""
    for task in tasks:
        print(f"\n{task}")
        for row in client.leaderboard(suite=suite, task=task, limit=100)["items"]:
            told = row["tasks"].get(task)
            if told is None or told["mean"] is None:
                continue
            games, deviation = told["games"] or 0, told["deviation"] or 0.0
            half = f" ± {1.96 * deviation / math.sqrt(games - 1):.2f}" if games > 1 else ""
            source = "the paper" if row["reference"] else f"{games} games"
            print(f"  {row['model'][:34]:34} {told['mean']:6.2f}{half:8}  {source}")


def seeds(text: str) -> range:
    """The seeds from `0..50`."""
    first, _, end = text.partition("..")
    if not (first.isdecimal() and end.isdecimal() and int(first) < int(end)):
        raise argparse.ArgumentTypeError(f"must be like 0..50, which is 0 to 49; is {text!r}")
    if int(end) > HELD_OUT:
        raise argparse.ArgumentTypeError(f"must be below {HELD_OUT:,}, as policies are learned on the others")
    return range(int(first), int(end))


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(
        description="Plays a suite on a server with policies that ppo.py has learned, and shows the board.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("policies", type=Path, nargs="+", metavar="policy.pt", help="one for each task")
    parser.add_argument("--seeds", type=seeds, default="0..50", help="of the games")
    parser.add_argument(
        "--suite", default=argparse.SUPPRESS, help="a built-in suite instead; agents without a policy stay"
    )
    parser.add_argument("--model", default="ppo", help="the name on the board")
    parser.add_argument("--beside", default="random,default", help="built-in players that the server plays there, too")
    parser.add_argument(
        "--server", default=argparse.SUPPRESS, help="the address of a server, with its key in SWARMBENCH_KEY"
    )
    parser.add_argument("--db", type=Path, default=Path("learned.db"), help="where a server is started for it")
    given = parser.parse_args(namespace=argparse.Namespace(suite=None, server=None))
    for file in given.policies:
        if not file.is_file():
            parser.error(f"there is no file {file}: ppo.py writes one")
    swarms = {swarm.task: swarm for swarm in map(Swarm, given.policies)}
    if len(swarms) != len(given.policies):
        parser.error("there are several policies for one task")

    with contextlib.ExitStack() as stack:
        if given.server:
            client = stack.enter_context(swarmseat.Client(given.server))
        else:
            client = stack.enter_context(stack.enter_context(swarmseat.Server(db=given.db)).client())
        suite: Any = given.suite
        if suite is None:
            name = f"{' '.join(swarms)} {given.seeds.start}..{given.seeds.stop}"
            suite = {"name": name, "tasks": list(swarms), "seeds": list(given.seeds)}
        hosted = [
            client.create_run(suite=suite, model=f"built-in/{player}", player=player, parallel=PARALLEL)
            for player in given.beside.split(",")
            if player
        ]
        learned = {task: swarm.learned for task, swarm in swarms.items()}
        run = client.create_run(suite=suite, model=given.model, parallel=PARALLEL, agent_meta={"policies": learned})
        play(client, run, swarms)
        for other in hosted:
            print(f"the server plays {other['model']}", file=sys.stderr)
            for _ in client.run_events(other["id"]):
                pass
        told, *_ = [_finished(client, one["id"]) for one in (run, *hosted)]
        show(client, f"{told['suite']['name']}@{told['suite']['digest']}", list(swarms))
        where = given.server or f"`swarmbench serve --db {given.db}`"
        print(f"\nrun {run['id']}; its games and the board are on the pages of {where}")


if __name__ == "__main__":
    try:
        main()
    except swarmseat.SwarmbenchError as error:
        raise SystemExit(f"error: {error}") from None
