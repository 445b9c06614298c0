"""Learns one policy for all agents of a swarm, with PPO, in this process.

    python examples/training/ppo.py --task Foraging

The policy gets only what one agent may know: its window, its position, its number, the round, and a map of the cells
that it has seen. Seeds below 1,000,000 are never played here: they are for evaluations (`play.py`). The folder `--out`
gets `policy.pt`, from which `--resume` continues, and `curve.csv`.
"""

import argparse
import csv
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

import swarmseat
from swarmseat.arrays import CHANNELS

HELD_OUT = 1_000_000
"""The smallest seed for training. Smaller seeds are for evaluation."""

AGENTS, SIDE, WINDOW, ROUNDS = 12, 10, 5, 100
"""The standard setting: agents, cells of a side of the map and of a window, rounds."""

WAYS = ((-1, 0), (1, 0), (0, -1), (0, 1))
"""Up, down, left and right, in rows and columns."""

PARTS = 20
"""The number of equal parts of the game. The policy knows the part of a round, and whether the round is even."""

SAVE_S = 60.0
"""The interval between saves of the policy, in seconds."""

SHOW_S = 10.0
"""The interval between lines of output, in seconds."""

Arrays = dict[str, Any]


@dataclass(frozen=True)
class Plan:
    """The plan of a task.

    Attributes:
        seen: The channels of the window that can be set.
        remembered: The channels of which an agent keeps a map.
        rewards: The `rewards` of `VecEnv`.
        gamma: The discount: the value of a reward of the next round.
    """

    seen: tuple[str, ...]
    remembered: tuple[str, ...]
    rewards: Literal["team", "individual"]
    gamma: float


PLANS = {
    "Foraging": Plan(
        ("wall", "nest", "food", "agent", "marked agent"), ("wall", "nest", "food"), "individual", gamma=0.98
    ),
    "Synchronization": Plan(("wall", "agent", "marked agent"), (), "team", gamma=0.9),
    "Pursuit": Plan(("wall", "prey", "agent"), ("prey",), "individual", gamma=0.98),
    "Flocking": Plan(("wall", "agent"), (), "team", gamma=0.97),
}


class Senses:
    """Makes the policy's input from observations, and keeps the map of each agent.

    Args:
        task: The name of the task.
        seats: The number of agents in all games together.
    """

    def __init__(self, task: str, seats: int) -> None:
        plan = PLANS[task]
        self._seen = [CHANNELS.index(name) for name in plan.seen]
        self._remembered = [CHANNELS.index(name) for name in plan.remembered]
        margin = WINDOW // 2
        side = SIDE + 2 * margin
        # The last plane is 1 where a cell has been seen.
        self._maps = np.zeros((seats, len(self._remembered) + 1, side, side), np.uint8)
        windows = np.lib.stride_tricks.sliding_window_view(self._maps, (WINDOW, WINDOW), axis=(2, 3), writeable=True)
        self._around = windows.transpose(0, 2, 3, 1, 4, 5)
        # The wall around the map is left out, as it is always the same.
        edge = margin + 1
        self._kept = self._maps[:, :, edge:-edge, edge:-edge]
        self.size = len(self._seen) * WINDOW**2 + 2 * SIDE + AGENTS + 2 + PARTS
        if plan.remembered:
            self.size += self._kept[0].size

    def forget(self, seats: NDArray[np.bool_]) -> None:
        """Clears the maps of these seats, whose new game has begun."""
        self._maps[seats] = 0

    def see(
        self,
        seats: NDArray[np.int64],
        view: NDArray[np.uint8],
        position: NDArray[np.integer[Any]],
        played: NDArray[np.integer[Any]],
        flag: NDArray[np.uint8],
    ) -> Tensor:
        """The policy's input, zeros and ones: a row for each of these seats.

        Args:
            seats: The seats. The number of an agent is the remainder of its seat by 12.
            view: (seats, 10, 5, 5), as in `VecEnv`.
            position: (seats, 2), row and column; -1, -1 for an agent that has escaped.
            played: The number of rounds that have been played.
            flag: `light_on` or `carrying_food`; zeros in other tasks.
        """
        rows, columns = np.clip(position, 0, SIDE - 1).T
        parts = [
            view[:, self._seen].reshape(len(seats), -1),
            _one_hot(rows, SIDE),
            _one_hot(columns, SIDE),
            _one_hot(seats % AGENTS, AGENTS),
            flag[:, None],
            (played % 2)[:, None],
            _one_hot(np.minimum(played * PARTS // ROUNDS, PARTS - 1), PARTS),
        ]
        if self._remembered:
            now = np.ones((len(seats), len(self._remembered) + 1, WINDOW, WINDOW), np.uint8)
            now[:, :-1] = view[:, self._remembered]
            self._around[seats, rows, columns] = now
            parts.append(self._kept[seats].reshape(len(seats), -1))
        return torch.from_numpy(np.concatenate(parts, axis=1, dtype=np.uint8, casting="unsafe"))


def _one_hot(values: NDArray[np.integer[Any]], size: int) -> NDArray[np.uint8]:
    rows: NDArray[np.uint8] = np.eye(size, dtype=np.uint8)[values]
    return rows


class Policy(nn.Module):
    """The probabilities of actions, and the value of an observation."""

    def __init__(self, inputs: int, actions: int, hidden: int = 128) -> None:
        super().__init__()
        self.trunk = nn.Sequential(
            _linear(inputs, hidden, 2**0.5), nn.ReLU(), _linear(hidden, hidden, 2**0.5), nn.ReLU()
        )
        self.actor = _linear(hidden, actions, 0.01)
        self.critic = _linear(hidden, 1, 1.0)

    def forward(self, seen: Tensor) -> tuple[Tensor, Tensor]:
        """The logarithms of the probabilities (rows, actions), and the values (rows)."""
        found = self.trunk(seen.float())
        return torch.log_softmax(self.actor(found), -1), self.critic(found).squeeze(-1)


def _linear(inputs: int, outputs: int, gain: float) -> nn.Linear:
    layer = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


def hint(task: str, gamma: float, before: Arrays, after: Arrays) -> Any:
    """The shaping that training adds to the rewards, from each agent's own observation (games, agents)."""
    goes_on = ~after["agent_done"]
    if task == "Foraging":
        # The difference of a potential, which is ½ while an agent carries food: it changes no best policy.
        return np.float32(0.5) * (gamma * after["carrying_food"] * goes_on - before["carrying_food"])
    if task == "Synchronization":
        # An agent that has switched gets the share of agents in view whose light is like its own.
        on = _count(after["view"], "marked agent")
        off = _count(after["view"], "agent")
        like = np.where(after["light_on"], on, off) / np.maximum(on + off, 1)
        return np.float32(0.1) * like * (after["light_on"] != before["light_on"]) * goes_on
    if task == "Pursuit":
        # An agent beside the prey.
        beside = np.any([_beside(after["view"], "prey", way) for way in WAYS], axis=0)
        return np.float32(0.02) * (beside & goes_on)
    return np.zeros_like(after["rewards"])


def _beside(view: NDArray[np.uint8], channel: str, way: tuple[int, int]) -> Any:
    """For each agent, whether it has such a cell beside it in this direction."""
    middle = WINDOW // 2
    return view[:, :, CHANNELS.index(channel), middle + way[0], middle + way[1]] == 1


def _count(view: NDArray[np.uint8], channel: str) -> Any:
    return view[:, :, CHANNELS.index(channel)].sum((2, 3), dtype=np.float32)


class Rollout:
    """Games that the policy plays side by side.

    Args:
        task: The name of the task.
        games: The number of games.
        rounds: The number of rounds from which the policy learns at once.
        seed: The seed from which the seeds of games are drawn.
        threads: The number of threads that step the games.

    Attributes:
        scores: The scores of the last games that the policy has played from their beginning to their end.
    """

    def __init__(self, task: str, games: int, rounds: int, seed: int, threads: int) -> None:
        self.task, self.plan, self.games, self.rounds = task, PLANS[task], games, rounds
        self.env = swarmseat.VecEnv(
            task,  # type: ignore[arg-type]
            games,
            seed=seed,
            threads=threads,
            rewards=self.plan.rewards,
            autoreset="same_step",
            copy=False,
            record=False,
        )
        self.senses = Senses(task, games * AGENTS)
        self._seats = np.arange(games * AGENTS)
        self._no_flag = np.zeros((games, AGENTS), np.uint8)
        shape = (rounds, games * AGENTS)
        self.seen = torch.zeros(*shape, self.senses.size, dtype=torch.uint8)
        self.actions = torch.zeros(shape, dtype=torch.int64)
        self.chances, self.values, self.rewards = torch.zeros(3, *shape)
        self.alive, self.ends = torch.zeros(2, *shape, dtype=torch.bool)
        self.scores: deque[float] = deque(maxlen=2 * games)
        # Games that began with random acts do not show how good the policy is.
        self._whole = np.zeros(games, np.bool_)
        self.ended = 0
        self.env_s = 0.0
        self._now = self.env.reset()
        self._spread(np.random.default_rng(seed))

    def _spread(self, random: np.random.Generator) -> None:
        """Plays up to a game's length at random, so that games do not all end in the same round."""
        begins = random.integers(0, ROUNDS, self.games)
        for played in range(ROUNDS):
            self.env.step(random.integers(0, len(self.env.actions), (self.games, AGENTS)))
            self.env.reset(mask=begins == played)
        self._now = self.env.buffers
        self._hold_out()

    def _hold_out(self) -> None:
        """A game with a seed for evaluation is not played: another seed is drawn (once in 9,000,000,000 games)."""
        while (held := self._now["seed"] < HELD_OUT).any():
            self.env.reset(mask=held)

    def look(self) -> Tensor:
        """The observations of all agents."""
        now = self._now
        flag = now[self.env.flag] if self.env.flag else self._no_flag
        return self.senses.see(
            self._seats,
            now["view"].reshape(len(self._seats), *now["view"].shape[2:]),
            now["position"].reshape(-1, 2),
            np.repeat(now["round"], AGENTS),
            flag.reshape(-1),
        )

    @torch.no_grad()
    def play(self, policy: Policy) -> Tensor:
        """Plays the next rounds. Returns the values of the agents' observations afterwards."""
        flag = self.env.flag
        for place in range(self.rounds):
            seen = self.look()
            logs, values = policy(seen)
            actions = torch.multinomial(logs.exp(), 1)
            self.seen[place], self.values[place], self.actions[place] = seen, values, actions.squeeze(-1)
            self.chances[place] = logs.gather(1, actions).squeeze(-1)
            self.alive[place] = torch.from_numpy(self._now["alive"].reshape(-1))
            before = {flag: self._now[flag].copy()} if flag else {}
            begun = time.perf_counter()
            now = self._now = self.env.step(actions.numpy().reshape(self.games, AGENTS))
            self.env_s += time.perf_counter() - begun
            rewards = now["rewards"] + hint(self.task, self.plan.gamma, before, now)
            self.rewards[place] = torch.from_numpy(rewards.reshape(-1))
            self.ends[place] = torch.from_numpy(now["agent_done"].reshape(-1))
            if (over := now["terminated"]).any():
                self.scores.extend(now["final_obs"]["score"][over & self._whole].tolist())
                self._whole |= over
                self.ended += int(over.sum())
                self.senses.forget(np.repeat(over, AGENTS))
                self._hold_out()
        values: Tensor = policy(self.look())[1]
        return values


def learn(
    policy: Policy,
    optimizer: torch.optim.Optimizer,
    told: Rollout,
    last: Tensor,
    left: float,
    given: argparse.Namespace,
) -> float:
    """Learns from the rounds that were played. Returns the mean entropy of the policy.

    Args:
        policy: The policy.
        optimizer: The optimizer of its weights.
        told: The rounds that were played.
        last: The values of the agents' current observations.
        left: The share of the time that is left: as it falls the steps become smaller, and the policy explores less.
        given: The command line.
    """
    gamma, advantages, ahead, value = told.plan.gamma, torch.zeros_like(told.values), torch.zeros_like(last), last
    for place in reversed(range(told.rounds)):
        goes_on = (~told.ends[place]).float()
        error = told.rewards[place] + gamma * value * goes_on - told.values[place]
        ahead = error + gamma * given.trace * ahead * goes_on
        advantages[place], value = ahead, told.values[place]
    returns = (advantages + told.values).flatten()
    advantages, seen, actions, chances = (
        part.flatten(0, 1) for part in (advantages, told.seen, told.actions, told.chances)
    )
    for group in optimizer.param_groups:
        group["lr"] = given.rate * max(left, 0.05)
    rows = told.alive.flatten().nonzero().squeeze(-1)
    entropies = []
    for _ in range(given.epochs):
        for part in rows[torch.randperm(len(rows))].split(given.batch):
            logs, values = policy(seen[part])
            ratio = (logs.gather(1, actions[part, None]).squeeze(-1) - chances[part]).exp()
            gain = advantages[part]
            gain = (gain - gain.mean()) / (gain.std(correction=0) + 1e-8)
            better = torch.min(ratio * gain, ratio.clamp(1 - given.clip, 1 + given.clip) * gain).mean()
            entropy = -(logs.exp() * logs).sum(-1).mean()
            off = (values - returns[part]).square().mean()
            optimizer.zero_grad()
            (off / 2 - better - given.curiosity * left * entropy).backward()
            nn.utils.clip_grad_norm_(policy.parameters(), 0.5)
            optimizer.step()
            entropies.append(entropy.item())
    return float(np.mean(entropies))


class Training:
    """A training: its policy, its progress, and its files.

    Args:
        given: The command line.
    """

    def __init__(self, given: argparse.Namespace) -> None:
        self.given = given
        torch.manual_seed(given.seed)
        torch.set_num_threads(given.threads)
        self.told = Rollout(given.task, given.games, given.rounds, given.seed, given.threads)
        self.policy = Policy(self.told.senses.size, len(self.told.env.actions))
        self.optimizer = torch.optim.Adam(self.policy.parameters(), lr=given.rate, eps=1e-5)
        self.clock_s = self.processor_s = 0.0
        self.steps = self.games = 0

    def resume(self) -> None:
        """Continues with the saved policy; games begin anew, with other seeds."""
        saved = torch.load(self.given.out / "policy.pt", weights_only=True)
        if saved["task"] != self.given.task:
            raise SystemExit(f"{self.given.out} has a policy for {saved['task']}, not for {self.given.task}")
        self.policy.load_state_dict(saved["policy"])
        self.optimizer.load_state_dict(saved["optimizer"])
        self.clock_s, self.processor_s, self.steps, self.games = saved["spent"]

    def save(self) -> None:
        """Writes the policy, and the state that is needed to continue."""
        made = self.given.out / "policy.pt.part"
        spent = (self.clock_s, self.processor_s, self.steps, self.games)
        state = {"policy": self.policy.state_dict(), "optimizer": self.optimizer.state_dict()}
        torch.save({"task": self.given.task, "seed": self.given.seed, "spent": spent, **state}, made)
        made.replace(self.given.out / "policy.pt")

    def left(self) -> float:
        """The share of the training that is left."""
        if self.given.steps:
            return max(0.0, 1 - self.steps / self.given.steps)
        spent = self.clock_s if self.given.time == "clock" else self.processor_s / self.given.threads
        share: float = 1 - spent / (60 * self.given.minutes)
        return max(0.0, share)

    def run(self) -> None:
        """Plays and learns until the training is over."""
        given, told = self.given, self.told
        clock, processor, ended = time.perf_counter() - self.clock_s, time.process_time() - self.processor_s, self.games
        shown, saved, first = -SHOW_S, self.clock_s, self.clock_s
        print("   time processors  agent steps   steps/s    games   score  entropy  in env")
        with (given.out / "curve.csv").open("a" if given.resume else "w", newline="") as file:
            curve = csv.writer(file)
            if not given.resume:
                curve.writerow(["task", "clock_s", "processor_s", "agent_steps", "games", "score", "entropy"])
            while (left := self.left()) > 0:
                last = told.play(self.policy)
                entropy = learn(self.policy, self.optimizer, told, last, left, given)
                self.clock_s, self.processor_s = time.perf_counter() - clock, time.process_time() - processor
                self.steps += told.actions.numel()
                self.games = ended + told.ended
                score = float(np.mean(told.scores)) if told.scores else float("nan")
                spent = [f"{self.clock_s:.1f}", f"{self.processor_s:.1f}"]
                curve.writerow([given.task, *spent, self.steps, self.games, f"{score:.3f}", f"{entropy:.3f}"])
                if self.clock_s - shown >= SHOW_S or self.left() == 0:
                    shown = self.clock_s
                    print(
                        f"{_minutes(self.clock_s)}    {_minutes(self.processor_s)} {self.steps:12,}"
                        f" {self.steps / self.clock_s:9,.0f} {self.games:8,} {score:7.2f} {entropy:8.2f}"
                        f" {told.env_s / (self.clock_s - first):7.0%}",
                        flush=True,
                    )
                if self.clock_s - saved >= SAVE_S:
                    saved = self.clock_s
                    self.save()
                    file.flush()


def _minutes(seconds: float) -> str:
    return f"{int(seconds) // 60:4}:{int(seconds) % 60:02}"


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(
        description="Learns one policy for all agents of a swarm, with PPO, in this process.",
        epilog="Then: python examples/training/play.py runs/Foraging/policy.pt",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--task", choices=PLANS, default="Foraging")
    parser.add_argument(
        "--out", type=Path, default=Path("runs/TASK"), help="where the policy and its curve are written"
    )
    parser.add_argument("--minutes", type=float, default=10.0, help="for how long it learns")
    parser.add_argument(
        "--steps", type=int, default=argparse.SUPPRESS,
        help="of agents, instead of minutes: the same seed then learns the same policy on the same machine",
    )  # fmt: skip
    parser.add_argument(
        "--time", choices=("clock", "processor"), default="clock",
        help="minutes of the clock, or of each processor, where the machine does other things as well",
    )  # fmt: skip
    parser.add_argument("--threads", type=int, default=1, help="for the games and for the policy")
    parser.add_argument("--seed", type=int, default=1, help="from which all else is drawn")
    parser.add_argument("--resume", action="store_true", help="continue with the policy in --out")
    learning = parser.add_argument_group("how it learns")
    learning.add_argument("--games", type=int, default=64, help="side by side")
    learning.add_argument("--rounds", type=int, default=50, help="that are played before it learns from them")
    learning.add_argument("--epochs", type=int, default=3, help="how often it learns from them")
    learning.add_argument("--batch", type=int, default=2048, help="agent steps in one step of the optimizer")
    learning.add_argument("--rate", type=float, default=1e-3, help="of learning, at first; it falls with the time")
    learning.add_argument("--clip", type=float, default=0.2, help="how far a chance may change in one go")
    learning.add_argument("--trace", type=float, default=0.95, help="lambda of generalized advantages")
    learning.add_argument("--curiosity", type=float, default=0.01, help="weight of the entropy, at first")
    given = parser.parse_args(namespace=argparse.Namespace(steps=None))
    for name in ("minutes", "steps", "threads", "games", "rounds", "epochs", "batch", "rate"):
        if getattr(given, name) is not None and getattr(given, name) <= 0:
            parser.error(f"--{name} must be more than 0, is {getattr(given, name)}")
    given.out = Path(str(given.out).replace("TASK", given.task))
    if given.resume and not (given.out / "policy.pt").exists():
        parser.error(f"--resume: {given.out} has no policy.pt")
    given.out.mkdir(parents=True, exist_ok=True)
    training = Training(given)
    if given.resume:
        training.resume()
    weights = sum(part.numel() for part in training.policy.parameters())
    print(
        f"{given.task}: {training.told.senses.size} inputs, {weights:,} weights, {given.games} games of {AGENTS} agents"
    )
    try:
        training.run()
    except KeyboardInterrupt:
        print(f"stopped; --resume --out {given.out} continues")
        raise SystemExit(130) from None
    finally:
        training.save()
        print(f"saved {given.out / 'policy.pt'}")


if __name__ == "__main__":
    main()
