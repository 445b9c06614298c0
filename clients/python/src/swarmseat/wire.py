"""The shapes of the JSON that goes over the wire, as the server's OpenAPI document has them.

Answers are plain dictionaries, so nothing that the server says gets lost, not even fields of newer servers. A field
that may be absent is `NotRequired`; one that may be null is `| None`. Times are RFC 3339 in UTC. Durations end in
their unit, `_s` or `_ms`. `tests/test_wire.py` compares this page with `openapi/openapi.json`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Generic, Literal, TypeVar

from ._compat import NotRequired, TypedDict

T = TypeVar("T")

TaskName = Literal["Transport", "Pursuit", "Synchronization", "Foraging", "Flocking"]
"""The five tasks."""

ActionName = Literal["UP", "DOWN", "LEFT", "RIGHT", "STAY", "SWITCH"]
"""All actions. An observation's `actions` are those of its task."""

# Reasons why a model's answer was invalid. A client may send all but the last three, which follow from the text.
Failure = Literal[
    "refusal",
    "content_filter",
    "truncated",
    "tool_call",
    "reasoning_only",
    "rejected",
    "empty",
    "no_marker",
    "unknown_action",
]

StatusName = Literal["waiting", "running", "finished", "aborted", "abandoned"]
"""The status of an episode."""


class Page(TypedDict, Generic[T]):
    """A page of a list."""

    items: list[T]
    next_cursor: str | None
    """The `cursor` for the next page; null on the last page."""


# Observations.


class Position(TypedDict):
    """A cell: row and column from 0; `i` grows downward, `j` to the right."""

    i: int
    j: int


class View(TypedDict):
    """A window: `cells[a][b]` is the cell `(origin.i + a, origin.j + b)`. The corner may lie outside the map."""

    origin: Position
    cells: list[list[str]]


class PastView(TypedDict):
    """The window of an agent when it decided in `round`."""

    round: int
    origin: Position
    cells: list[list[str]]


class HistoryEntry(TypedDict):
    """The agent's own action and message in a round; null if it did or said nothing."""

    round: int
    action: str | None
    message: str | None


class Task(TypedDict):
    """The task, and its goal in words."""

    name: str
    description: str


class EpisodeResult(TypedDict):
    """The result of an episode."""

    reason: str
    score: float
    rounds: int
    journal_head: str


class Sight(TypedDict):
    """An observation of an agent while a round is open, without the clock."""

    episode: str
    agent: str
    status: StatusName
    round: int
    """The number of resolved rounds: the round to answer."""
    max_round: int
    task: Task
    score: float
    """The score of the whole swarm so far."""
    alive: bool
    """False once the agent has escaped; then `position` and `view` are null."""
    position: Position | None
    view: View | None
    light_on: NotRequired[bool | None]
    """In Synchronization only."""
    carrying_food: NotRequired[bool | None]
    """In Foraging only."""
    messages: list[str]
    actions: list[str]
    history: list[HistoryEntry]
    past_views: list[PastView]
    result: NotRequired[EpisodeResult | None]
    """Once the episode has ended."""


class Observation(Sight):
    """An observation: all that one agent may know at the moment."""

    acted: bool
    """Whether this seat has answered this round."""
    deadline: str | None
    remaining_ms: int | None
    bank_ms: int | None
    prompt: NotRequired[str | None]
    """The prompt, if the request asked for it."""


class SwarmObsResponse(TypedDict):
    """The observations that wait for an act, the oldest first."""

    observations: list[Observation]
    cursor: str
    finished: bool


# Acts.


class Usage(TypedDict, total=False):
    """The tokens and the time of a language model's answer."""

    prompt_tokens: int | None
    completion_tokens: int | None
    latency_ms: int | None


class ActRequest(TypedDict):
    """An act of the token's agent: exactly one of `action` and `response`."""

    round: int
    action: NotRequired[str | None]
    message: NotRequired[str | None]
    to: NotRequired[str | None]
    response: NotRequired[str | None]
    usage: NotRequired[Usage | None]
    reasoning: NotRequired[str | None]
    failure: NotRequired[Failure | None]


class SwarmAct(TypedDict):
    """An act for one of several seats."""

    episode: str
    agent: str
    round: int
    action: NotRequired[str | None]
    message: NotRequired[str | None]
    to: NotRequired[str | None]
    response: NotRequired[str | None]
    usage: NotRequired[Usage | None]
    reasoning: NotRequired[str | None]
    failure: NotRequired[Failure | None]


class SwarmActRequest(TypedDict):
    """The acts of several seats."""

    acts: Sequence[SwarmAct]


class Receipt(TypedDict):
    """The receipt for an act that was taken and is on the server's disk."""

    episode: str
    agent: str
    round: int
    action: str | None
    message: str | None
    valid: bool
    failure: NotRequired[Failure | None]
    duplicate: bool
    waiting_for: int


class ActResponse(Receipt):
    """The receipt, and with `wait` the next observation, or null if the time was up."""

    obs: NotRequired[Observation | None]


class FieldProblem(TypedDict):
    """The problem of a field."""

    field: str
    problem: str


class Limit(TypedDict):
    """The limit that was reached."""

    name: str
    value: int


class Problem(TypedDict):
    """An error of the server (RFC 9457)."""

    type: str
    title: str
    status: int
    detail: str
    code: str
    round: NotRequired[int | None]
    retry_after_ms: NotRequired[int | None]
    limit: NotRequired[Limit | None]
    fields: NotRequired[list[FieldProblem]]


class SwarmActResponse(TypedDict):
    """One receipt or problem for each act, in their order. `swarmseat.is_problem` tells them apart.

    The other fields come with `wait`: the seats' next observations, and a `problem` only if something failed.
    """

    receipts: list[Receipt | Problem]
    observations: NotRequired[list[Observation]]
    finished: NotRequired[bool]
    problem: NotRequired[Problem]


# Episodes.


class EpisodeRequest(TypedDict):
    """The settings of a new episode. Everything except `task` has a default (docs/protocol.md)."""

    task: TaskName
    seed: NotRequired[int | None]
    rules: NotRequired[Literal["paper", "reference"] | None]
    num_agents: NotRequired[int | None]
    width: NotRequired[int | None]
    height: NotRequired[int | None]
    view_size: NotRequired[int | None]
    memory: NotRequired[int | None]
    max_round: NotRequired[int | None]
    control: NotRequired[Literal["decentralized", "centralized"] | None]
    noise: NotRequired[float | None]
    max_delay: NotRequired[int | None]
    answer_reader: NotRequired[Literal["last-marker", "first-marker"] | None]
    round_deadline_s: NotRequired[float | None]
    bank_s: NotRequired[float | None]
    start: NotRequired[Literal["now", "manual"] | None]
    idle_timeout_s: NotRequired[float | None]
    visibility: NotRequired[Literal["public", "owner"] | None]
    model: NotRequired[str | None]
    agent_meta: NotRequired[Mapping[str, Any] | None]
    prompt_template: NotRequired[str | None]
    open_seats: NotRequired[int | None]
    fill_after_s: NotRequired[float | None]
    fill_with: NotRequired[str | None]
    player: NotRequired[str | None]


class EpisodeConfig(TypedDict):
    """All settings of an episode, with defaults filled in."""

    task: str
    seed: int | None
    """Null where the caller may not know it yet."""
    rules: str
    num_agents: int
    width: int
    height: int
    view_size: int
    memory: int
    max_round: int
    control: str
    noise: float
    max_delay: int
    answer_reader: NotRequired[str]
    """Left out if it is `last-marker`."""
    round_deadline_s: float | None
    bank_s: float
    start: str
    idle_timeout_s: float
    visibility: str
    model: str
    agent_meta: dict[str, Any]
    prompt_template: str | None
    open_seats: int
    fill_after_s: float | None
    fill_with: str | None
    player: str | None


class SeatToken(TypedDict):
    """The token of one seat."""

    agent: str
    token: str


class CreatedEpisode(TypedDict):
    """A new episode with its tokens, which are shown only once."""

    id: str
    status: StatusName
    config: EpisodeConfig
    seats: list[SeatToken]
    swarm_token: str


class ForkRequest(TypedDict):
    """The round from which forks continue, and their settings, except the simulation's (docs/protocol.md)."""

    round: int
    count: NotRequired[int | None]
    round_deadline_s: NotRequired[float | None]
    bank_s: NotRequired[float | None]
    start: NotRequired[Literal["now", "manual"] | None]
    idle_timeout_s: NotRequired[float | None]
    visibility: NotRequired[Literal["public", "owner"] | None]
    model: NotRequired[str | None]
    agent_meta: NotRequired[Mapping[str, Any] | None]
    prompt_template: NotRequired[str | None]
    open_seats: NotRequired[int | None]
    fill_after_s: NotRequired[float | None]
    fill_with: NotRequired[str | None]
    player: NotRequired[str | None]


class Fork(TypedDict):
    """The parent of an episode, and the round from which the episode continues it."""

    episode: str
    round: int
    head: str | None
    """Null where the caller may not know the seed yet."""


class CreatedForks(TypedDict):
    """New forks of an episode with their tokens, which are shown only once."""

    fork: Fork
    episodes: list[CreatedEpisode]


class EpisodeSummary(TypedDict):
    """An episode."""

    id: str
    status: StatusName
    task: str
    model: str
    run: str | None
    round: int
    score: float
    created_at: str
    ended_at: str | None
    config: EpisodeConfig
    result: EpisodeResult | None
    void_reason: str | None
    fork: Fork | None


class ClaimRequest(TypedDict, total=False):
    """The open seats to claim: one seat by its agent, or a number of any seats."""

    agent: str | None
    seats: int | None
    model: str | None
    agent_meta: Mapping[str, Any] | None


class CreatedClaim(TypedDict):
    """The seats that were claimed, with tokens that are shown only once."""

    episode: str
    status: StatusName
    claim: int
    seats: list[SeatToken]
    swarm_token: str


class SeatHolder(TypedDict):
    """The holder of a seat; all fields except `agent` are null if the seat is open."""

    agent: str
    claim: int | None
    holder: str | None
    model: str | None
    player: str | None
    claimed_at: str | None


class SeatList(TypedDict):
    """The holders of the seats of an episode."""

    open: int
    seats: list[SeatHolder]


class StateAgent(TypedDict):
    """An agent as spectators see it. An agent that has escaped is at the cell to which it went."""

    agent: str
    i: int
    j: int
    alive: bool
    light_on: NotRequired[bool | None]
    carrying_food: NotRequired[bool | None]


class State(TypedDict):
    """The whole world after `round` resolved rounds; `grid` has one character per cell."""

    round: int
    score: float
    grid: list[str]
    agents: list[StateAgent]
    prey: NotRequired[Position | None]
    block: NotRequired[Position | None]
    distance: NotRequired[float | None]


class RoundEvent(TypedDict):
    """A resolved round, as the data of an event."""

    round: int
    score: float
    agents: list[StateAgent]


# A message, by the number of its sender; `to` is a commander's only receiver. A key is a keyword of Python.
ReplayMessage = TypedDict("ReplayMessage", {"from": int, "text": str, "to": NotRequired[int | None]})

# A message as the agents in `by` read it; `sent` and `text` where they differ from what was said in the round.
ReplayHeard = TypedDict(
    "ReplayHeard", {"from": int, "by": list[int], "sent": NotRequired[int | None], "text": NotRequired[str | None]}
)


class ReplayState(TypedDict):
    """A state, and the decisions of the round that led to it. Agents are numbers; empty lists are left out."""

    round: int
    score: float
    at: list[int]
    gone: NotRequired[list[int]]
    lit: NotRequired[list[int]]
    loaded: NotRequired[list[int]]
    prey: NotRequired[list[int] | None]
    block: NotRequired[list[int] | None]
    distance: NotRequired[float | None]
    actions: NotRequired[str | None]
    blocked: NotRequired[list[int]]
    pushed: NotRequired[list[int]]
    invalid: NotRequired[list[int]]
    timeouts: NotRequired[list[int]]
    said: NotRequired[list[ReplayMessage]]
    heard: NotRequired[list[ReplayHeard]]
    marks: NotRequired[list[str]]


# A page of the states of a game; the next one begins with the state `next`.
Replay = TypedDict(
    "Replay",
    {
        "episode": str,
        "task": TaskName,
        "rules": NotRequired[str | None],
        "control": NotRequired[str | None],
        "status": str,
        "rounds": int,
        "max_round": NotRequired[int | None],
        "score": float,
        "width": int,
        "height": int,
        "num_agents": int,
        "view_size": NotRequired[int | None],
        "ground": NotRequired[list[str] | None],
        "block_cells": NotRequired[list[list[int]] | None],
        "next": int | None,
        "from": int,
        "length": int,
        "metrics": dict[str, list[float | None]],
        "states": list[ReplayState],
    },
)

# A message that an agent read; `original` where noise changed it.
InboxMessage = TypedDict("InboxMessage", {"from": str, "sent": int, "text": str, "original": NotRequired[str | None]})


class ShownAct(TypedDict):
    """An act as it was recorded."""

    source: NotRequired[str | None]
    action: NotRequired[str | None]
    message: NotRequired[str | None]
    to: NotRequired[str | None]
    valid: NotRequired[bool | None]
    failure: NotRequired[Failure | None]
    response: NotRequired[str | None]
    reasoning: NotRequired[str | None]
    usage: NotRequired[Usage | None]
    bank_spent_ms: NotRequired[int | None]
    at: NotRequired[str | None]


class AgentRound(TypedDict):
    """The observation and the act of an agent in a round. The observation has no fields of the clock."""

    episode: str
    round: int
    agent: str
    observation: NotRequired[Sight | None]
    inbox: NotRequired[list[InboxMessage] | None]
    prompt: NotRequired[str | None]
    prompt_problem: NotRequired[str | None]
    act: NotRequired[ShownAct | None]


class Scores(TypedDict):
    """The score of a game after 0, `every`, twice `every` … rounds, and the newest."""

    episode: str
    rounds: int
    every: int
    scores: list[float]


class RunScores(TypedDict):
    """The scores of the games of a run, or a page of them."""

    run: str
    items: list[Scores]
    next_cursor: str | None


class Verification(TypedDict):
    """The result of the verification of a journal, for which it is replayed."""

    episode: str
    ok: bool
    problem: NotRequired[str | None]
    rounds: int
    score: float
    journal_head: str
    layout_digest: NotRequired[str | None]
    final_digest: NotRequired[str | None]
    rules_revision: int
    version: str


# Runs and suites.


class OwnSettings(TypedDict, total=False):
    """Settings of a suite of your own. Settings that are left out are those of the standard setting."""

    control: Literal["decentralized", "centralized"] | None
    num_agents: int | None
    width: int | None
    height: int | None
    view_size: int | None
    memory: int | None
    max_round: int | None
    noise: float | None
    max_delay: int | None
    answer_reader: Literal["last-marker", "first-marker"] | None


class OwnSuite(TypedDict):
    """A suite of your own."""

    name: str
    seeds: Sequence[int]
    tasks: NotRequired[Sequence[TaskName] | None]
    settings: NotRequired[OwnSettings | None]


class RunRequest(TypedDict):
    """The settings of a new run: a suite by its name, or one of your own, for one model (docs/protocol.md)."""

    suite: str | OwnSuite
    model: str
    rules: NotRequired[Literal["paper", "reference"] | None]
    temperature: NotRequired[float | None]
    top_p: NotRequired[float | None]
    agent_meta: NotRequired[Mapping[str, Any] | None]
    prompt_template: NotRequired[str | None]
    parallel: NotRequired[int | None]
    round_deadline_s: NotRequired[float | None]
    bank_s: NotRequired[float | None]
    idle_timeout_s: NotRequired[float | None]
    visibility: NotRequired[Literal["public", "owner"] | None]
    player: NotRequired[str | None]


class SuiteSettingsView(TypedDict):
    """The settings of all games of a suite."""

    control: str
    num_agents: int
    width: int
    height: int
    view_size: int
    memory: int
    max_round: int
    noise: float
    max_delay: int
    answer_reader: NotRequired[str]
    """Left out if it is `last-marker`."""
    round_deadline_s: float | None
    bank_s: float


class SuiteView(TypedDict):
    """A suite, completely. Seeds and digest are null where the caller may not know them yet."""

    name: str
    rules: str
    digest: str | None
    tasks: list[str]
    seeds: list[int] | None
    seeds_by_task: bool
    games: int
    settings: SuiteSettingsView


class TaskResult(TypedDict):
    """The result of a run in a task: mean and population standard deviation over the seeds."""

    task: str
    mean: float | None
    deviation: float | None
    played: int
    planned: int
    voided: int


class ActTally(TypedDict):
    """The numbers of acts of a run, by kind."""

    sent: int
    invalid: int
    invalid_share: float | None
    failures: dict[str, int]
    timeouts: int
    timeout_share: float | None
    clock_outs: int
    clock_out_share: float | None
    prompt_tokens: int
    completion_tokens: int


class RunGame(TypedDict):
    """A game of a run."""

    slot: int
    task: str
    seed: int | None
    episode: str | None
    status: str
    round: int
    score: float | None
    reason: str | None
    void_reason: str | None


class RunSummary(TypedDict):
    """A run and its results so far."""

    id: str
    status: str
    suite: SuiteView
    model: str
    temperature: float | None
    top_p: float | None
    agent_meta: dict[str, Any]
    template_digest: str | None
    prompt: NotRequired[str]
    parallel: int
    visibility: str
    idle_timeout_s: float
    player: str | None
    attempt: int | None
    closes_at: str | None
    created_at: str
    ended_at: str | None
    void_reason: str | None
    played: int
    planned: int
    voided: int
    total: float | None
    tasks: list[TaskResult]
    acts: ActTally
    waits_for: Limit | None


class RunDetail(RunSummary):
    """A run with its games, in the order of the plan."""

    games: list[RunGame]


class CreatedRun(RunDetail):
    """A new run with the token for all seats of all its games; null where the server itself plays."""

    swarm_token: str | None


class RunToken(TypedDict):
    """A new token of a run."""

    id: str
    swarm_token: str


# Attempts in competitions.


class StartedAttempt(TypedDict):
    """An attempt that was started, with the token of all seats of all its games."""

    attempt: int
    on_spare_seeds: bool
    entrant: str
    run: str
    games: int
    closes_at: str
    swarm_token: str


class TaskMean(TypedDict):
    """The result of an attempt in a task: mean and population standard deviation of its scores."""

    task: str
    mean: float | None
    deviation: float | None
    games: int
    planned: int
    voided: int


class AttemptSummary(TypedDict):
    """An attempt as its entrant sees it; it has results once it is over."""

    entrant: str
    attempt: int
    on_spare_seeds: bool
    run: str
    status: str
    created_at: str
    ended_at: str | None
    games: int
    games_ended: int
    voided: str | None
    tasks: list[TaskMean] | None
    total: float | None


# Boards.


class LeaderboardQuery(TypedDict, total=False):
    """The choice of a leaderboard, and its order (docs/evaluate/boards.md)."""

    suite: str
    rules: Literal["paper", "reference"]
    task: TaskName
    sort: str
    pick: Literal["best", "last", "mean"]
    reference: bool
    people: bool
    imported: bool
    metrics: str
    limit: int
    cursor: str


class CrossPlayQuery(TypedDict, total=False):
    """The choice of pairs of models."""

    task: TaskName
    rules: Literal["paper", "reference"]
    limit: int
    cursor: str


class TaskScore(TypedDict):
    """The result of a row in a task."""

    mean: float | None
    deviation: float | None
    games: int | None
    planned: int | None


class RowDifference(TypedDict):
    """The difference of a row to the row `to` above it, with an interval of 95 %."""

    to: str
    mean: float
    low: float | None
    high: float | None
    pairs: int


class BoardRow(TypedDict):
    """A player on a leaderboard."""

    rank: int | None
    id: str
    reference: bool
    table: str | None
    imported: bool
    note: str | None
    owner: str | None
    model: str
    temperature: float | None
    top_p: float | None
    prompt_template: str | None
    prompt: NotRequired[str | None]
    answer_reader: NotRequired[str | None]
    vouched: bool | None
    decentralization: str | None
    kind: str | None
    status: str | None
    runs: int | None
    run: str | None
    started_at: str | None
    total: float | None
    rules: str
    converted: list[str]
    other_rules: list[str]
    tasks: dict[str, TaskScore]
    difference: RowDifference | None
    invalid_share: float | None
    failures: dict[str, int]
    timeout_share: float | None
    clock_out_share: float | None
    voided: int | None
    metrics: NotRequired[dict[str, dict[str, float | None]]]


class MetricsMethod(TypedDict):
    """The method by which metrics were computed. Values of different methods cannot be compared."""

    definition: str
    metrics_revision: int
    embedder: str


class MetricValue(TypedDict):
    """The value of a metric for a game, and the number of rounds from which it was computed."""

    value: float | None
    rounds: int


# Values of the states from `from` on; `next` is the first state that is left out. A key is a keyword of Python.
MetricSeries = TypedDict(
    "MetricSeries",
    {
        "from": int,
        "length": int,
        "next": int | None,
        "counts": dict[str, list[int | None]],
        "values": dict[str, list[float | None]],
    },
)


class GameMetrics(MetricsMethod):
    """The metrics of a game (docs/evaluate/metrics.md)."""

    episode: str
    task: TaskName
    status: str
    rounds: int
    score: float
    sampled: bool
    values: dict[str, MetricValue]
    series: NotRequired[MetricSeries | None]


class MetricMean(TypedDict):
    """A mean over the games in which a metric is defined."""

    mean: float
    deviation: float
    games: int


class RunMetrics(MetricsMethod):
    """The metrics of the games of a run, or a page of them."""

    run: str
    tasks: dict[str, dict[str, MetricMean]]
    items: list[GameMetrics]
    next_cursor: str | None


class Leaderboard(TypedDict):
    """The leaderboard of a suite."""

    suite: str
    digest: str
    rules: str
    tasks: list[str]
    sort: str
    pick: str
    rows: int
    metrics: NotRequired[list[str]]
    metrics_method: NotRequired[MetricsMethod | None]
    items: list[BoardRow]
    next_cursor: str | None


class CrossPlayPair(TypedDict):
    """The scores of two models that played together."""

    task: str
    rules: str
    settings: dict[str, Any]
    models: list[str]
    vouched: bool
    games: int
    mean: float
    deviation: float


class Health(TypedDict):
    """Whether the server lives, and its version."""

    status: str
    version: str
