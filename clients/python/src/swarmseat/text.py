"""Episodes as conversations in this process, to train and evaluate language models.

`TextEpisode` gives the prompts of the server and reads answers as the server does. The modules `swarmseat.verifiers`
and `swarmseat.openenv` translate between it and frameworks (docs/play/frameworks.md).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias, cast, get_args

import numpy as np
from numpy.typing import NDArray

from ._compat import Unpack
from .checks import one_of, shown, whole
from .errors import ArgumentError, SwarmbenchError
from .names import AnswerReader, Rewards, TaskName
from .native import Answer, Partners, VecEnv, Words
from .rewards import full_score
from .settings import SEED_MAX, STANDARD, GameSettings

Mode: TypeAlias = Literal["seats", "turns", "one_seat", "joint"]
MODES: tuple[Mode, ...] = get_args(Mode)

ANSWER_CHARS_MAX = 65_536
"""The characters of an answer that are read: the last with the reader `last-marker`, the first with the others."""

_NO_ANSWER = Answer(-1, None, None, "empty")
_NOT_NAMED = Answer(-1, None, None, "not_named")

_JOINT_HEAD = """\
You lead {{ num_agents }} agents that share a world. In every round you choose an act for each of them.

What every agent knows about the task:
{{ task.description }}

Round: {{ round }} (of {{ max_round }}). The team's score is {{ score }}.
{% if centralized %}

The whole map, in which Y is {{ agent }}:
{{ views[0].text }}
{% endif %}
"""

_JOINT_SEAT = """\
{{ agent }} at ({{ position.i }}, {{ position.j }})\
{% if light_on is not none %}, its light is {{ "on" if light_on else "off" }}{% endif %}\
{% if carrying_food is not none %}, it carries {{ "food" if carrying_food else "no food" }}{% endif %}.
{% if not centralized %}
It sees (Y is {{ agent }}):
{{ views[0].text }}
{% endif %}
{% for message in messages %}
It heard: "{{ message }}"
{% endfor %}
"""

_JOINT_TAIL = """\
Symbols: a number is the agent with that number (numbers at the edges are rows and columns), W a wall, B a heavy \
block, . an empty cell, * outside the map. The task names further ones.

Actions:
{% for action in actions %}
- {{ action.name }}: {{ action.meaning }}
{% endfor %}

Reason first. End with one line for each agent, such as:
Agent_0: UP
Agent_1: ACTION: LEFT MSG: the message that it sends
"""

_JOINT_LINE = re.compile(r"^[^\w\n]*agent[ _]?(\d{1,4})[^\w\n:=]*[:=]([^\n]*)$", re.IGNORECASE | re.MULTILINE)
_MARKER = re.compile(r"\b(?:ACTION|MSG)\W{0,8}[:\uff1a]", re.IGNORECASE)


@dataclass(frozen=True)
class Turn:
    """The next prompts, and the results of the last answers.

    Attributes:
        asked: The agents whose acts are asked for; none once the episode is over.
        prompts: The prompt of each agent that is asked, by its number. Empty with the mode `joint`.
        prompt: The only prompt, in modes with one conversation; empty once the episode is over.
        reward: The change of the score in this step; with the mode `one_seat`, the seat's reward. The rewards of an
            episode add up.
        rewards: The reward of each agent in this step, agents that are no longer on the map included.
        gain: The change of the score as a share of `swarmseat.rewards.full_score`: from 0 to 1, also in their sum.
        done: Whether the episode is over.
        round: The number of resolved rounds.
        score: The score of the whole swarm.
        invalid: The agents whose answers did not count in this step, and the reason: `empty`, `no_marker`,
            `unknown_action`, or `not_named` if a joint answer has no line for the agent.
    """

    asked: tuple[int, ...]
    prompts: dict[int, str]
    prompt: str
    reward: float
    rewards: dict[int, float]
    gain: float
    done: bool
    round: int
    score: float
    invalid: dict[int, str] = field(default_factory=dict)


class TextEpisode:
    """One episode after the other, played with texts.

    A seed gives the same layout as on every server, prompts are the server's, and answers are read by its rules. An
    invalid answer costs the act of its agent and never the episode. An episode ends by itself, at the latest after
    `max_round` rounds. Objects of this class share nothing: hundreds of them may be in one process, each used by one
    thread at a time.

    | mode | a conversation is | a step takes |
    | --- | --- | --- |
    | `seats` | one of the agents; all of them are asked together | an answer of each agent that is asked, by number |
    | `turns` | the whole swarm; each turn shows one agent's prompt | one answer; the round is resolved after the last |
    | `one_seat` | one agent; built-in players play the others | one answer |
    | `joint` | the whole swarm; each turn is a round | one answer with a line for each agent |

    Prompts of `joint` are this package's own; the others are those of the server, to the byte.

    Args:
        task: The name of the task.
        mode: The kind of conversation, from the table.
        seat: With `one_seat`, the number of the agent that is asked.
        partners: Built-in players by the number of their agents; with `one_seat` also one name for all others.
            `default` is the best one of the task. They decide as the players that the server hosts.
        rewards: `team`: every agent earns the change of the score. `individual`: each agent earns its own part.
        answer_reader: The reader of answers.
        prompt_template: A template for the prompts instead of the built-in one, or the name `toolkit`.
        answer_chars_max: The maximum number of characters of an answer that are read; the rest is cut off.
        **settings: Settings of the game, as in `swarmseat.settings.GameSettings`.

    Attributes:
        world: The episode as the only one of a `VecEnv`, for its state, its journal and its digest.
        turn: The last turn.
        seed: The seed of the layout that is played.
        full_score: The score that counts as 1 in `Turn.gain`.
        earned: The sum of rewards in this episode, by agent.
        invalid_answers: The number of answers that did not count, by agent.
        heard: The number of messages received, by agent.
    """

    def __init__(
        self,
        task: TaskName = "Foraging",
        mode: Mode = "seats",
        *,
        seat: int = 0,
        partners: str | Mapping[int, str] | None = None,
        rewards: Rewards = "team",
        answer_reader: AnswerReader = "last-marker",
        prompt_template: str | None = None,
        answer_chars_max: int = ANSWER_CHARS_MAX,
        **settings: Unpack[GameSettings],
    ) -> None:
        one_of("mode", mode, MODES)
        settings.setdefault("memory", STANDARD["memory"])
        self.mode: Mode = mode
        self.world = VecEnv(
            task, 1, **settings, threads=1, observations="none", rewards=rewards, messages=True, autoreset="disabled",
            copy=False, answer_reader=answer_reader, prompt_template=prompt_template,
        )  # fmt: skip
        self._chars_max = whole("answer_chars_max", answer_chars_max, 1)
        self._keeps_end = answer_reader == "last-marker"
        self._players = self._partners_of(whole("seat", seat, 0, self.world.num_agents - 1), partners)
        self._own = tuple(agent for agent in range(self.world.num_agents) if agent not in self._players)
        if not self._own:
            raise ArgumentError("partners play every agent, so nobody is left to ask")
        self.full_score = full_score(self.world.task, self.world.num_agents, self.world.max_round)
        self.reset()

    def reset(self, seed: int | None = None) -> Turn:
        """Begins an episode with the layout of this seed, or of a random one, which the attribute `seed` names."""
        self.world.reset(None if seed is None else [whole("seed", seed, 0, SEED_MAX)])
        self.seed = int(self.world.buffers["seed"][0])
        self.earned = [0.0] * self.world.num_agents
        self.invalid_answers = [0] * self.world.num_agents
        self.heard = [0] * self.world.num_agents
        self._partners: Partners | None = self.world.partners(0, self._players) if self._players else None
        self._acts: dict[int, Answer] = {}
        self._is_over = False
        self._waiting = self._living()
        # A layout can be solved before the first round.
        self.turn = self._outputs(0.0, np.zeros(self.world.num_agents), {})
        return self.turn

    def step(self, answers: str | Mapping[int, str | None] | None) -> Turn:
        """Takes answers, and resolves the round once none is missing.

        Args:
            answers: A text. In the mode `seats` the texts of all agents that are asked, by their numbers; agents
                without a text, or with `None`, do nothing. The same is possible in the mode `joint`.

        Raises:
            ArgumentError: An answer is not a text, or of an agent that was not asked. Nothing was played.
            SwarmbenchError: The episode is over.
        """
        if self.turn.done:
            raise SwarmbenchError("the episode is over: reset() begins another")
        read = self._read(answers)
        invalid = {agent: answer.fault for agent, answer in read.items() if answer.fault is not None}
        for agent in invalid:
            self.invalid_answers[agent] += 1
        self._acts |= read
        self._waiting = self._waiting[len(read) :]
        before, earned = self.turn.score, np.zeros(self.world.num_agents)
        # Once no agent is left to ask, partners play the episode to its end.
        while not self._waiting and not self._is_over:
            earned += self._play()
        self.earned = [sum(parts) for parts in zip(self.earned, earned.tolist(), strict=True)]
        self.turn = self._outputs(before, earned, invalid)
        return self.turn

    def journal(self) -> bytes:
        """The journal of the episode so far, which `swarmbench verify` reads."""
        return self.world.journal(0)

    def close(self) -> None:
        """Frees the memory of the episode."""
        self.world.close()

    def _partners_of(self, seat: int, partners: str | Mapping[int, str] | None) -> dict[int, str]:
        agents = range(self.world.num_agents)
        if self.mode == "one_seat":
            if not isinstance(partners, Mapping):
                return {agent: partners or "default" for agent in agents if agent != seat}
            if sorted(partners) != [agent for agent in agents if agent != seat]:
                raise ArgumentError(f"with mode='one_seat' partners must play all agents but {seat}, by their numbers")
        elif isinstance(partners, str):
            raise ArgumentError(f"with mode={self.mode!r} partners must name a player for each agent that it plays")
        return {whole("the agent of a partner", agent, 0, agents[-1]): name for agent, name in (partners or {}).items()}

    def _living(self) -> tuple[int, ...]:
        alive = self.world.buffers["alive"][0]
        return tuple(agent for agent in self._own if alive[agent])

    def _read(self, answers: str | Mapping[int, str | None] | None) -> dict[int, Answer]:
        asked = self.turn.asked
        if self.mode == "joint" and not isinstance(answers, Mapping):
            return self._read_joint(self._text(answers))
        if self.mode in {"seats", "joint"}:
            if not isinstance(answers, Mapping):
                raise ArgumentError(
                    f"with mode='seats' answers are texts by the numbers of agents, such as {{0: 'ACTION: UP'}}; "
                    f"this is {shown(answers)}"
                )
            strangers = [agent for agent in answers if agent not in asked]
            if strangers:
                raise ArgumentError(
                    f"agent {shown(strangers[0])} was not asked: now answer {', '.join(map(str, asked))}"
                )
            given: Mapping[int, str | None] = answers
        else:
            if isinstance(answers, Mapping):
                raise ArgumentError(f"with mode={self.mode!r} an answer is one text, not {shown(answers)}")
            given = {asked[0]: answers}
        texts = {agent: self._text(given.get(agent)) for agent in asked}
        return {agent: self._answer(agent, text) for agent, text in texts.items()}

    def _text(self, answer: object) -> str:
        """The part of an answer that is read."""
        if answer is None:
            return ""
        if not isinstance(answer, str):
            raise ArgumentError(f"an answer is a text, or None; this is {shown(answer)}")
        kept = answer[-self._chars_max :] if self._keeps_end else answer[: self._chars_max]
        # The native module refuses half a character, which a decoder of tokens may leave.
        return kept.encode(errors="replace").decode()

    def _answer(self, agent: int, text: str) -> Answer:
        return self.world.read_answer(agent, text) if text else _NO_ANSWER

    def _read_joint(self, text: str) -> dict[int, Answer]:
        lines: dict[int, str] = {}
        for number, value in _JOINT_LINE.findall(text):
            lines[int(number)] = value if _MARKER.search(value) else f"ACTION: {value}"
        asked = self.turn.asked
        return {agent: self._answer(agent, lines[agent]) if agent in lines else _NOT_NAMED for agent in asked}

    def _play(self) -> NDArray[np.float32]:
        """Resolves a round with the given acts, and returns the rewards of all agents."""
        numbers = np.full((1, self.world.num_agents), -1)
        words: list[Words] = [None] * self.world.num_agents
        partners = {} if self._partners is None else self.world.decide(0, self._partners)
        for agent, act in (self._acts | partners).items():
            numbers[0, agent] = act.action
            words[agent] = None if act.message is None else (act.message, act.to)
        outputs = self.world.step(numbers, [words])
        self._acts = {}
        self._is_over = bool(outputs["terminated"][0])
        self._waiting = self._living()
        for agent, messages in enumerate(outputs["messages"][0]):
            self.heard[agent] += len(messages)
        return cast("NDArray[np.float32]", outputs["rewards"][0])

    def _outputs(self, before: float, earned: NDArray[Any], invalid: dict[int, str]) -> Turn:
        asked = self._waiting[:1] if self.mode == "turns" else self._waiting
        score = float(self.world.buffers["score"][0])
        prompts = {} if self.mode == "joint" else {agent: self.world.prompt(0, agent) for agent in asked}
        prompt = ""
        if self.mode == "joint" and asked:
            prompt = self._joint_prompt(asked)
        elif self.mode != "seats" and asked:
            prompt = prompts[asked[0]]
        return Turn(
            asked=asked,
            prompts=prompts,
            prompt=prompt,
            reward=float(earned[self._own[0]]) if self.mode == "one_seat" else score - before,
            rewards=dict(enumerate(earned.tolist())),
            gain=(min(score, self.full_score) - min(before, self.full_score)) / self.full_score,
            done=not asked,
            round=int(self.world.buffers["round"][0]),
            score=score,
            invalid=invalid,
        )

    def _joint_prompt(self, asked: tuple[int, ...]) -> str:
        first = asked[0]
        seats = [self.world.prompt(0, agent, _JOINT_SEAT) for agent in asked]
        return "\n".join([self.world.prompt(0, first, _JOINT_HEAD), *seats, self.world.prompt(0, first, _JOINT_TAIL)])
