"""The shapes of the JSON on the wire.

Answers are plain dictionaries, so nothing that the server says gets lost, not even fields of newer servers. A field
that may be absent is `NotRequired`; one that may be null is `| None`. Times are RFC 3339 in UTC.

Generated from openapi/openapi.json by `python clients/python/generate.py`: do not edit.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeAlias

from ._compat import NotRequired, TypedDict
from .names import ActionName as ActionName
from .names import AnswerReader, Control, Pick, RuleSet, Start, Visibility
from .names import Definition as Definition
from .names import Page as Page
from .names import TaskName as TaskName

Failure: TypeAlias = Literal[
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
"""Reason for which an answer of a language model did not count, so that its agent did nothing.

The first six are known to the client that asked the model, and it may send them with the answer. The last three
are read from the answer's text, by the rules.
"""


class Try(TypedDict):
    """Invalid answer of a model, and the reply to it."""

    response: str
    """Answer of the model."""
    told: str
    """What the model was told, with which it was asked again."""


class Harness(TypedDict):
    """What stood between a prompt of the server and a model: with the prompt, what the model was sent, and what is
    kept for its next question. Parts without content are left out.
    """

    added: NotRequired[str | None]
    """Text after the prompt, such as the notes of earlier rounds."""
    carried: NotRequired[Sequence[int]]
    """Those of these rounds whose encrypted reasoning came with their answers, which is stored nowhere."""
    history: NotRequired[Sequence[int]]
    """Earlier rounds whose prompts and answers of this seat came before the prompt, in ascending order; at most 20."""
    scratchpad: NotRequired[str | None]
    """Notes of the seat after the answer, for its next question."""
    tries: NotRequired[Sequence[Try]]
    """Invalid answers before the one of the act, in order; at most 8. The usage of the act counts them."""


class Usage(TypedDict):
    """Cost of a language model's answer."""

    cache_write_tokens: NotRequired[int | None]
    """Tokens of the prompt that were written into a cache; part of `prompt_tokens`."""
    cached_tokens: NotRequired[int | None]
    """Tokens of the prompt that were read from a cache; part of `prompt_tokens`."""
    completion_tokens: NotRequired[int | None]
    """Tokens of the answer."""
    cost_nano_usd: NotRequired[int | None]
    """Cost in billionths of a US dollar: as the endpoint reported it, or else by the client's prices."""
    first_token_ms: NotRequired[int | None]
    """Time from the beginning of the request to the first token of a streamed answer, its reasoning included, in
    milliseconds.
    """
    latency_ms: NotRequired[int | None]
    """Time that the answer took, in milliseconds."""
    prompt_tokens: NotRequired[int | None]
    """Tokens of the prompt."""
    reasoning_tokens: NotRequired[int | None]
    """Tokens of reasoning; part of `completion_tokens`."""


class ActRequest(TypedDict):
    """Act of the token's agent: exactly one of `action` and `response`."""

    action: NotRequired[str | None]
    """Action of the agent: one of the observation's `actions`."""
    failure: NotRequired[Failure | None]
    """Reason for which the model gave no answer, if only its client knows it: `refusal`, `content_filter`,
    `truncated`, `tool_call`, `reasoning_only` or `rejected`. With `response` only; recorded if the response is
    invalid.
    """
    harness: NotRequired[Harness | None]
    """What the player's program added to the prompt, and keeps for the next one. With `response` only; no other seat
    reads it.
    """
    message: NotRequired[str | None]
    """Message of the agent: one line. A longer message is cut to 120 characters and `...`. With `action` only."""
    reasoning: NotRequired[str | None]
    """Free text, stored for replays."""
    response: NotRequired[str | None]
    """Whole answer of a language model, with `ACTION: …` and/or `MSG: …`."""
    round: int
    """Round that the act answers."""
    to: NotRequired[str | None]
    """Only receiver of a commander's message (centralized control only). With `action` only."""
    usage: NotRequired[Usage | None]
    """Cost of the answer."""


class Receipt(TypedDict):
    """Receipt of a durable act."""

    action: str | None
    """Action that counts; null without one."""
    agent: str
    """Name of the agent."""
    duplicate: bool
    """Whether the same act was sent before."""
    episode: str
    """Id of the episode."""
    failure: NotRequired[Failure | None]
    """Reason for which the answer is invalid; left out if it is valid."""
    message: str | None
    """Message that is delivered; null without one."""
    round: int
    """Round of the act."""
    valid: bool
    """False for an invalid answer of a language model: the agent does nothing in this round."""
    waiting_for: int
    """Number of seats for which the round waited after this act."""


class HistoryEntry(TypedDict):
    """Act of the agent in an earlier round."""

    action: str | None
    """Action of the agent; null without one."""
    message: str | None
    """Message of the agent; null without one."""
    round: int
    """Round of the act."""


Cell: TypeAlias = str
"""Cell as it is written: a short symbol."""


class Position(TypedDict):
    """Cell of the map: row `i` grows downward, column `j` to the right."""

    i: int
    """Row of the cell."""
    j: int
    """Column of the cell."""


class PastView(TypedDict):
    """View of the agent in an earlier round."""

    cells: list[list[Cell]]
    """Cells, as in a view."""
    origin: Position
    """Top-left cell."""
    round: int
    """Round of the view."""


class EpisodeResult(TypedDict):
    """End of an episode."""

    journal_head: str
    """Head of the journal's hash chain, which identifies the journal."""
    reason: str
    """Reason of the end: `task_done`, `rounds_played`, `aborted`, `closed` (the window of its attempt closed) or
    `idle`.
    """
    rounds: int
    """Number of resolved rounds."""
    score: float
    """Final score."""


StatusName: TypeAlias = Literal["waiting", "running", "finished", "aborted", "abandoned"]
"""Status of an episode."""


class Task(TypedDict):
    """Task, as it is described to an agent."""

    description: str
    """Description of the task, in words."""
    name: str
    """Name of the task."""


class View(TypedDict):
    """Rectangle of cells."""

    cells: list[list[Cell]]
    """Cells: `cells[a][b]` is the cell `(origin.i + a, origin.j + b)`: `.` empty, `W` wall, `B` block, `P` prey, `N`
    nest, `F` food, `*` outside the map, `Y` the agent itself, other agents by number, after a `$` if they have a
    mark.
    """
    origin: Position
    """Top-left cell; may lie outside the map."""


class Sight(TypedDict):
    """Part of an observation that does not change while the round is open."""

    actions: list[str]
    """Actions of the task."""
    agent: str
    """Name of the agent."""
    alive: bool
    """False once the agent has escaped."""
    carrying_food: NotRequired[bool | None]
    """Whether the agent carries food (Foraging only)."""
    episode: str
    """Id of the episode."""
    history: list[HistoryEntry]
    """Past acts of the agent, newest first, of at most as many rounds as it remembers."""
    light_on: NotRequired[bool | None]
    """Whether the agent's light is on (Synchronization only)."""
    max_round: int
    """Number of rounds after which the episode ends."""
    messages: list[str]
    """Messages delivered to the agent, sorted and without their senders."""
    past_views: list[PastView]
    """Past views of the agent, newest first, at most one fewer than the rounds that it remembers."""
    position: Position | None
    """Position of the agent; null once it has escaped."""
    result: NotRequired[EpisodeResult | None]
    """End of the episode; left out before."""
    round: int
    """Round to be answered: the number of resolved rounds."""
    score: float
    """Score of the whole swarm so far."""
    status: StatusName
    """Status of the episode."""
    task: Task
    """Task of the swarm."""
    view: View | None
    """View of the agent; null once it has escaped."""


class Moment(TypedDict):
    """Part of an observation that changes while the round is open."""

    acted: bool
    """Whether this seat has answered the round."""
    bank_ms: int | None
    """Milliseconds left in the seat's bank; `remaining_ms` includes them, and they are used last. Null without a
    clock.
    """
    deadline: str | None
    """Time at which the seat's clock expires: the opening of the round plus its deadline and the bank. Null without
    a clock.
    """
    prompt: NotRequired[str | None]
    """Text for a language model; only if requested."""
    remaining_ms: int | None
    """Milliseconds until `deadline`. Null without a clock."""


class Observation(Sight, Moment):
    """Current observation of one agent: all that it may know."""


class ActResponse(Receipt):
    """Receipt and, if requested, the next observation."""

    obs: NotRequired[Observation | None]
    """Next observation, with `wait`; null after a timeout."""


class UsageSums(TypedDict):
    """Sums over answers of what was reported beside the tokens of prompts and answers. Sums of 0 are left out."""

    cache_write_tokens: NotRequired[int]
    """Tokens of prompts that were written into a cache. `0` where it is left out."""
    cached_tokens: NotRequired[int]
    """Tokens of prompts that were read from a cache. `0` where it is left out."""
    cost_nano_usd: NotRequired[int]
    """Cost in billionths of a US dollar, of the answers whose cost is known. `0` where it is left out."""
    priced: NotRequired[int]
    """Answers whose cost is known. `0` where it is left out."""
    reasoning_tokens: NotRequired[int]
    """Tokens of reasoning. `0` where it is left out."""


class ActTally(TypedDict):
    """Counts of acts."""

    clock_out_share: float | None
    """Old name of `timeout_share`."""
    clock_outs: int
    """Old name of `timeouts`."""
    completion_tokens: int
    """Tokens of answers, as reported by players."""
    failures: dict[str, int]
    """Invalid answers, counted by reason. Games of earlier versions did not record reasons, so the sum may be less
    than `invalid`.
    """
    invalid: int
    """Invalid answers of language models among them."""
    invalid_share: float | None
    """Share of invalid answers in all acts that were sent; null before the first act."""
    prompt_tokens: int
    """Tokens of prompts, as reported by players."""
    sent: int
    """Acts that players sent."""
    timeout_share: float | None
    """Share of expired clocks in all acts that were due; null before the first act."""
    timeouts: int
    """Number of expired clocks."""
    usage: NotRequired[UsageSums]
    """What else players reported: tokens of caches and of reasoning, and the cost. Left out if nothing was."""


class ShownAct(TypedDict):
    """Act as it was recorded."""

    action: NotRequired[str | None]
    """Action of the agent."""
    at: NotRequired[str | None]
    """Time at which the act was taken."""
    bank_spent_ms: NotRequired[int | None]
    """Milliseconds of the seat's bank that the act used."""
    failure: NotRequired[Failure | None]
    """Reason for which the answer was invalid. Games of earlier versions did not record it."""
    harness: NotRequired[Harness | None]
    """What the player's program added to the prompt, and kept."""
    message: NotRequired[str | None]
    """Message of the agent."""
    reasoning: NotRequired[str | None]
    """Reasons that the player gave."""
    response: NotRequired[str | None]
    """Answer of the language model."""
    source: NotRequired[str | None]
    """Source of the decision: `player` or `clock`; missing in an imported game."""
    to: NotRequired[str | None]
    """Name of the only receiver of a commander's message."""
    usage: NotRequired[Usage | None]
    """Cost of the answer."""
    valid: NotRequired[bool | None]
    """False for an invalid answer of a language model; missing in an imported game."""


InboxMessage = TypedDict(
    "InboxMessage",
    {
        # Name of the sender.
        "from": str,
        # Text as it was sent, if noise changed it.
        "original": NotRequired[str | None],
        # Round in which the message was sent.
        "sent": int,
        # Text as the agent read it.
        "text": str,
    },
)
"""Message that an agent read."""


class AgentRound(TypedDict):
    """Knowledge of an agent in a round, and its act."""

    act: NotRequired[ShownAct | None]
    """Act of the agent; left out if the round is not resolved or the agent did not act."""
    agent: str
    """Name of the agent."""
    episode: str
    """Id of the game."""
    inbox: NotRequired[list[InboxMessage] | None]
    """Messages that the agent read, with their senders; missing in an imported game."""
    observation: NotRequired[Sight | None]
    """Observation of the agent, without clocks; missing in an imported game."""
    prompt: NotRequired[str | None]
    """Text for a language model."""
    prompt_problem: NotRequired[str | None]
    """Reason for which there is no prompt, if the template fails."""
    round: int
    """Round that the observation answers: the number of resolved rounds."""


class Announcement(TypedDict):
    """Announcement of an organizer."""

    at: str
    """Time of the announcement."""
    text: str
    """Text of the announcement."""


class AnnouncementRequest(TypedDict):
    """New announcement to all who follow a competition."""

    text: str
    """Plain text: 1 to 2,000 characters."""


Announcements: TypeAlias = Page[Announcement]
"""Announcements, newest first."""


class TaskMean(TypedDict):
    """Result of an attempt in a task."""

    deviation: float | None
    """Population standard deviation of the scores."""
    games: int
    """Games that were played and count."""
    mean: float | None
    """Mean of the scores; null if all games were voided."""
    planned: int
    """Planned games, without voided ones. Planned games that were not played count as 0."""
    task: TaskName
    """Name of the task."""
    voided: int
    """Number of voided games, which do not count."""


class AttemptSummary(TypedDict):
    """Attempt as its entrant sees it."""

    attempt: int
    """Number of the attempt."""
    created_at: str
    """Time at which the attempt was started."""
    ended_at: str | None
    """Time at which the attempt ended; null before."""
    entrant: str
    """Id of the entrant."""
    games: int
    """Number of games."""
    games_ended: int
    """Number of games that have ended."""
    on_spare_seeds: bool
    """Whether the attempt is played on spare seeds, in place of a voided one."""
    run: str
    """Id of the attempt's run."""
    status: str
    """Status: `running`, `finished`, `aborted`, `abandoned` or `closed`."""
    tasks: list[TaskMean] | None
    """Result of each task, once the attempt is over."""
    total: float | None
    """Sum of the means, once the attempt is over."""
    voided: str | None
    """Reason for which the attempt was voided; null if it was not. A voided attempt may be started again."""


AttemptList: TypeAlias = Page[AttemptSummary]
"""Attempts, in the order in which they were started."""


class AttemptRequest(TypedDict):
    """Attempt to start."""

    attempt: NotRequired[int | None]
    """Number of the attempt, from 1; by default the next open one."""
    entrant: NotRequired[str | None]
    """Id of the entrant; required if the key has several."""


class AttemptWindow(TypedDict):
    """Window in which an attempt may be played."""

    closes_at: NotRequired[str | None]
    """Time from which no round of the attempt begins; by default the closing of the competition."""
    opens_at: NotRequired[str | None]
    """Time from which the attempt can be started; by default the opening of the competition."""


Attempts: TypeAlias = int | Sequence[AttemptWindow]
"""Number of attempts, or the window of each."""


class Deed(TypedDict):
    """Entry of the audit log: an action of an organizer, a judge's look at a sealed game, or an entrant's own
    rename.
    """

    action: str
    """Name of the action."""
    at: str
    """Time of the action."""
    detail: Any
    """Further facts."""
    subject: str
    """Id of the competition, entrant, … that the action concerns."""
    who: str
    """Id of the key, or `local` for work on the server's own machine."""


AuditLog: TypeAlias = Page[Deed]
"""Page of the audit log, newest first."""


Binary: TypeAlias = str
"""Bytes of a file; this type only describes them."""


class RowDifference(TypedDict):
    """Distance of a row below another."""

    high: float | None
    """Upper end of the interval; null if `low` is null."""
    low: float | None
    """Lower end of the 95 % interval, by Student's t. If it is below 0, the order of the two rows is uncertain. Null
    if a task has fewer than three seeds that both have.
    """
    mean: float
    """Difference in favour of the row above on the seeds that both have; in a task without such a seed, difference
    of the means.
    """
    pairs: int
    """Number of seeds that both have, over all tasks."""
    to: str
    """The `id` of the row above; on the board of a competition, the id of the entrant."""


class RunHolder(TypedDict):
    """Holder of a team, as it was declared."""

    agent_meta: NotRequired[dict[str, Any]]
    """Further facts about the player; left out on boards, and before the end of the run for other holders."""
    model: str
    """Name of the model that plays."""
    name: str
    """Name within the team."""
    player: str | None
    """Built-in player with which the server plays these seats."""
    prompt: str | None
    """Name of the prompt, with its harness, as of a run; null for players that read none."""
    sampling: str | None
    """Further sampling, as of a run; null without any."""
    seats: list[int]
    """Numbers of its agents, in order."""
    temperature: float | None
    """Sampling temperature."""
    top_p: float | None
    """Nucleus of sampling (top-p)."""


class TaskScore(TypedDict):
    """Games of one task."""

    deviation: float | None
    """Population standard deviation over the seeds."""
    games: int | None
    """Games that were played and count."""
    mean: float | None
    """Mean over the seeds."""
    planned: int | None
    """Planned games, without voided ones. Planned games that were not played count as 0."""


class BoardRow(TypedDict):
    """Row of a board."""

    answer_reader: str | None
    """Reader of answers: `last-marker`, `first-marker` or `json`; null for rows of the paper and of files."""
    clock_out_share: float | None
    """Old name of `timeout_share`."""
    completion_tokens: NotRequired[int | None]
    """Tokens of answers in all games of the row, as players reported them; left out if they reported none."""
    converted: list[str]
    """Tasks whose scores were converted from the scale of those rules to that of the board."""
    cost_usd: NotRequired[float | None]
    """Mean cost of a game in US dollars; left out if no cost is known."""
    costs_are_whole: NotRequired[bool | None]
    """True if the cost of every answer is known: else `cost_usd` is less than the whole. Left out without a cost."""
    decentralization: str | None
    """`declared` if one holder had all seats, and so could pool what they saw; `enforced` if each holder's token
    read its own seats alone, or the server played; null under centralized control, and for rows of the paper.
    """
    difference: RowDifference | None
    """Distance below the nearest row above that was played here."""
    failures: dict[str, int]
    """Invalid answers, counted by reason. Games of earlier versions did not record reasons."""
    holders: NotRequired[list[RunHolder]]
    """Holders of a team, whose name is `model`; left out in other rows."""
    id: str
    """Id of the row. A player has the same id on every board."""
    imported: bool
    """Whether the row shows games that were read from files."""
    invalid_share: float | None
    """Share of invalid answers among all answers of players; null without answers."""
    kind: str | None
    """`human` if the owner declares that people played, by `agent_meta.kind`, and for the people of the paper;
    `team` if the seats belong to several holders; null for other rows.
    """
    metrics: NotRequired[dict[str, dict[str, float | None]]]
    """Requested metrics by task: means over the games of the run that is named in `run`. Null if no game has a
    value, or none was measured yet; empty for rows without a run.
    """
    model: str
    """Name of the model."""
    note: str | None
    """Source of the numbers; null for rows that were played here."""
    other_rules: list[str]
    """Tasks that those rules define in another way than the rules of the board, so that scores cannot simply be
    compared.
    """
    owner: str | None
    """Owner of the key; null without a key."""
    prompt: str | None
    """Name of the prompt: `default`, `toolkit`, `static-first` or `custom:` and the first digits of
    `prompt_template`; `default:1` for the words of an earlier revision. A system message adds `+system:` and the
    first digits of its SHA-256. Null for built-in players and people, who read no prompt, and for rows of the
    paper and of files.
    """
    prompt_template: str | None
    """First 12 hexadecimal digits of SHA-256 of the prompt template; null for the built-in template."""
    prompt_tokens: NotRequired[int | None]
    """Tokens of prompts in all games of the row, as players reported them; left out if they reported none."""
    rank: int | None
    """Rank: 1, 2, 2, 4. Null if the row has no value by which it could be ranked."""
    reference: bool
    """Whether the row comes from the paper."""
    rules: str
    """Rule set by which the row was played."""
    run: str | None
    """Id of the run that is shown; with `mean`, of the last run."""
    runs: int | None
    """Number of runs of the player on this board."""
    sampling: str | None
    """Further sampling, as an evaluation declares it in `agent_meta.eval`: limits of tokens, effort and budget of
    the reasoning, and fields of `extra` such as `top_k`. Null without any.
    """
    started_at: str | None
    """Time at which that run was started."""
    status: str | None
    """End of that run: `finished`, `aborted`, `abandoned` or `closed`. With `mean`: the end of a run that is not
    `finished`, if there is one.
    """
    table: str | None
    """Table of the paper: `models`, `rules` or `humans`; null for other rows."""
    tasks: dict[str, TaskScore]
    """Scores by task."""
    temperature: float | None
    """Sampling temperature, as declared."""
    timeout_share: float | None
    """Share of moves that timed out; null without moves."""
    top_p: float | None
    """Nucleus of sampling (top-p), as declared."""
    total: float | None
    """Sum of the means of the tasks that are shown; null if one is missing."""
    usage: NotRequired[UsageSums]
    """What else players reported in all games of the row. Left out if nothing was."""
    voided: int | None
    """Number of voided games, which do not count."""
    vouched: bool | None
    """Whether the model is vouched for; false if only its owner declares it. Null for rows of the paper."""


class CancelRequest(TypedDict):
    """Cancellation of a competition by an organizer."""

    reason: str
    """Reason, which everybody sees: 1 to 500 characters."""


class ClaimRequest(TypedDict):
    """Claim to open seats, and the player of these seats."""

    agent: NotRequired[str | None]
    """Agent whose seat is claimed; any open seat by default."""
    agent_meta: NotRequired[Mapping[str, Any] | None]
    """Further facts about the player; at most 16 KiB of JSON."""
    model: NotRequired[str | None]
    """Name of the model that plays; at most 200 characters. `unnamed` where it is left out."""
    seats: NotRequired[int | None]
    """Number of open seats to claim. The claim gets all of them, or is refused. `1` where it is left out."""


Seconds: TypeAlias = float
"""Duration in seconds; whole numbers are written without a fraction."""


class Clocks(TypedDict):
    """Clocks of all games."""

    bank_s: NotRequired[Seconds | None]
    """`0` where it is left out."""
    idle_timeout_s: NotRequired[Seconds | None]
    """`86400` where it is left out."""
    round_deadline_s: Seconds
    """Seconds that a seat has in a round before its bank is used."""


class CodesRequest(TypedDict):
    """Order of invitation codes by an organizer."""

    labels: Sequence[str]
    """Receivers of the codes, one label for each; only organizers see them. 1 to 1,000 labels of 1 to 100
    characters.
    """


class SealedSettings(TypedDict):
    """Settings of all games, with the names, limits and defaults that they have for an episode."""

    answer_reader: NotRequired[AnswerReader | None]
    """Reader of language models' answers: `last-marker`, `first-marker` or `json`. `last-marker` where it is left
    out.
    """
    control: NotRequired[Control | None]
    """`decentralized` or `centralized`. `decentralized` where it is left out."""
    height: NotRequired[int | None]
    """Rows of the map. `10` where it is left out."""
    max_delay: NotRequired[int | None]
    """The maximum delay of a message, in rounds. `0` where it is left out."""
    max_round: NotRequired[int | None]
    """Number of rounds after which the episode ends. `100` where it is left out."""
    memory: NotRequired[int | None]
    """Number of past rounds that an agent remembers. `5` where it is left out."""
    noise: NotRequired[float | None]
    """The probability with which a delivered message is corrupted. `0.0` where it is left out."""
    num_agents: NotRequired[int | None]
    """Number of agents. `12` where it is left out."""
    view_size: NotRequired[int | None]
    """Rows and columns of an agent's window; odd, 3 to 2 · size + 1. `5` where it is left out."""
    width: NotRequired[int | None]
    """Columns of the map. `10` where it is left out."""


class SealedSuite(TypedDict):
    """Games of each attempt: every task once on each of its sealed seeds."""

    public_seeds: NotRequired[int | None]
    """Number of these seeds that make the board before the end; the other seeds then make the final board. With 0
    all seeds make both. `0` where it is left out.
    """
    rules: NotRequired[RuleSet | None]
    """Rule set: `paper` or `reference`. `paper` where it is left out."""
    seeds: NotRequired[int | None]
    """Number of sealed seeds of each attempt. `5` where it is left out."""
    settings: NotRequired[SealedSettings | None]
    """Settings of all games; those of the standard setting by default."""
    tasks: NotRequired[Sequence[TaskName] | None]
    """Names of the tasks; all five by default."""


class Terms(TypedDict):
    """Terms that entrants accept when they enter."""

    text: str
    """Text of the terms."""
    version: int
    """Version, from 1; each change of the terms makes the next one. Entrants keep the version that they accepted."""


class Competition(TypedDict):
    """Competition as everybody sees it."""

    attempts: list[AttemptWindow]
    """Window of each attempt, in order."""
    attempts_per_day: int | None
    """Number of attempts that an entrant may start on one day in UTC; null without a daily limit."""
    board: str
    """Board before the end: `public`, `hidden` or `frozen`."""
    board_freezes_at: str | None
    """Time at which a frozen board stops changing."""
    cancel_reason: str | None
    """Reason of the cancellation."""
    cancelled_at: str | None
    """Time at which an organizer cancelled the competition; null if none did."""
    categories: list[str]
    """Categories, one of which every entrant is in."""
    clocks: Clocks
    """Clocks of all games."""
    closes_at: str
    """Time from which no round begins."""
    commitment: str
    """SHA-256 of the salt and then all sealed seeds, in hexadecimal. It is published before anybody plays, so that
    everybody can check afterwards that no seed was changed.
    """
    counts: str
    """Attempt that counts: `best`, `last` or `first`."""
    created_at: str
    """Time of creation."""
    description: str
    """Information for entrants."""
    entries_per_key: int
    """Number of entrants that one key may have."""
    entry: str
    """Entry: `anybody`, or `codes` for holders of invitation codes."""
    hidden: bool
    """Whether only organizers and judges see the competition in lists."""
    id: str
    """Id of the competition."""
    name: str
    """Name of the competition."""
    opens_at: str
    """Time from which attempts can be started."""
    own_games: str
    """Time from which entrants read their own games: `sealed` or `ended`."""
    parallel: int
    """Number of games of an attempt that are open at a time."""
    phase: str
    """Phase: `announced`, `open`, `closing` (the last rounds still run), `closed` (everything is open to all) or
    `cancelled`.
    """
    revealed_at: str | None
    """Time at which everything was opened to all."""
    revision: str
    """Revision for `if_revision`: changes with every change that organizers may make. Empty from servers of earlier
    versions.
    """
    salt: str | None
    """Salt in hexadecimal; null until the competition is closed."""
    seeds: list[str] | None
    """Sealed seeds in hexadecimal, attempt by attempt; null until the competition is closed."""
    seeds_by_task: bool
    """Whether each task is played on its own seeds; false in competitions of servers that did not draw such seeds
    yet.
    """
    spares: int
    """Number of attempts on other sealed seeds that an entrant has in place of voided ones."""
    suite: SealedSuite
    """Games of each attempt."""
    terms: Terms | None
    """Terms that entrants accept when they enter."""
    tie_breaks: list[str]
    """Criteria that decide between equal totals, in this order."""


class EntrantSummary(TypedDict):
    """Entrant as everybody sees it."""

    category: str | None
    """Category of the entrant, if the competition has categories."""
    erased: bool
    """Whether the personal data of the entrant were erased."""
    id: str
    """Id of the entrant."""
    model: str
    """Name of the model, as declared."""
    name: str
    """Name of the entrant."""
    prompt: str
    """Name of the prompt: `default`, `toolkit`, `static-first` or `custom:` and the first digits of
    `prompt_template`. A declared system message (`system_message` in `agent_meta`) adds `+system:` and the first
    digits of its SHA-256. `none` for built-in players and people, who read no prompts.
    """
    prompt_template: str | None
    """Digest of the prompt template; null for the built-in template."""
    reason: str | None
    """Reason of the withdrawal or disqualification."""
    registered_at: str
    """Time of registration."""
    status: str
    """Status: `active`, `withdrawn` or `disqualified`."""
    temperature: float | None
    """Sampling temperature, as declared."""
    terms: int | None
    """Version of the terms that the entrant accepted last, if the competition has terms."""
    top_p: float | None
    """Nucleus of sampling (top-p), as declared."""
    vouched: bool
    """Whether an organizer vouches for the model."""


class CompetitionRow(TypedDict):
    """Row of the board."""

    attempt: int | None
    """Number of the attempt that counts."""
    attempts: int
    """Number of attempts that are over and were not voided."""
    clock_share: float
    """Old name of `timeout_share`."""
    decentralization: str | None
    """`declared` if the entrant has all seats, and so can pool what they see; `enforced` if it cannot; null under
    centralized control.
    """
    difference: RowDifference | None
    """Distance below the nearest row above, with a 95 % interval; `to` is the id of that row's entrant. Null while
    seeds are sealed, for the first row, and for rows without a rank.
    """
    entrant: EntrantSummary
    """The entrant."""
    failures: dict[str, int]
    """Invalid answers, counted by reason; empty while seeds are sealed. Games of earlier versions did not record
    reasons.
    """
    invalid_share: float
    """Share of invalid answers."""
    metrics: NotRequired[dict[str, dict[str, float | None]]]
    """Requested metrics by task: means over the games of the attempt that counts. Empty while seeds are sealed."""
    on_spare_seeds: bool
    """Whether that attempt was played on spare seeds, in place of a voided one."""
    rank: int | None
    """Rank: 1, 2, 2, 4. Null without a counting attempt."""
    run: str | None
    """Id of that attempt's run."""
    run_status: str | None
    """Status of that run."""
    tasks: list[TaskMean]
    """Result of each task; empty while seeds are sealed."""
    timeout_share: float
    """Share of moves that timed out."""
    total: float | None
    """Sum of the means."""
    voided_attempts: int
    """Number of voided attempts."""
    voided_games: int
    """Voided games of the attempt."""


class MetricsMethod(TypedDict):
    """Method by which metrics were computed. Values of different methods cannot be compared."""

    definition: str
    """Definition: `paper` or `toolkit`."""
    embedder: str
    """Embedder that turned texts into vectors, for the metrics that compare vectors."""
    metrics_revision: int
    """Revision of all definitions."""


class CompetitionBoard(TypedDict):
    """Board of a competition."""

    category: str | None
    """Category to which the board is limited; null for all entrants."""
    frozen_at: str | None
    """Time at which the board was frozen: it shows only attempts that were over before."""
    items: list[CompetitionRow]
    """Rows: entrants with a rank, then those without a counting attempt, then those who withdrew or were
    disqualified.
    """
    metrics: NotRequired[list[str]]
    """Requested metrics, in the requested order."""
    metrics_method: NotRequired[MetricsMethod | None]
    """Method by which the metrics were computed."""
    next_cursor: str | None
    """Cursor of the next page; null on the last page."""
    part: str
    """Seeds that make the board: `all`; `public` or `final` if the competition has public seeds."""
    shows: str
    """Contents of the board: `all`; `totals` while seeds are sealed; or `nothing`."""


class WindowExtension(TypedDict):
    """Later end of the window of an attempt."""

    attempt: int
    """Number of the attempt, from 1."""
    closes_at: str
    """Time from which no round of the attempt begins."""


class CompetitionChange(TypedDict):
    """Changes of a competition that has not closed, by an organizer. Fields that are left out do not change."""

    attempts: NotRequired[Sequence[WindowExtension] | None]
    """Later ends of the windows of single attempts, for games that are opened afterwards."""
    closes_at: NotRequired[str | None]
    """Later end, for games that are opened afterwards. Windows that end with the competition are extended with it."""
    description: NotRequired[str | None]
    """New description."""
    hidden: NotRequired[bool | None]
    """Whether only organizers and judges see the competition in lists: for a rehearsal."""
    if_revision: NotRequired[str | None]
    """The `revision` of the competition that the organizer saw. If the competition has another revision by now,
    nothing is changed (409 `changed`).
    """
    name: NotRequired[str | None]
    """New name."""
    reason: NotRequired[str | None]
    """Reason, which everybody sees: 1 to 500 characters."""
    terms: NotRequired[str | None]
    """New terms, as the next version: 1 to 20,000 characters. Entrants keep the version that they accepted."""


CompetitionList: TypeAlias = Page[Competition]
"""Page of competitions, newest first."""


class CompetitionRequest(TypedDict):
    """Definition of a new competition. `swarmbench competition create` takes the same shape in TOML."""

    attempts: NotRequired[Attempts | None]
    """`1` where it is left out."""
    attempts_per_day: NotRequired[int | None]
    """Number of attempts that an entrant may start on one day in UTC; no daily limit by default."""
    board: NotRequired[str | None]
    """Board before the end: `public`, `hidden` or `frozen`. `public` where it is left out."""
    board_freezes_at: NotRequired[str | None]
    """Time at which a frozen board stops changing."""
    categories: NotRequired[Sequence[str] | None]
    """Categories, one of which every entrant is in: at most 20, each of 1 to 40 characters."""
    clocks: Clocks
    """Clocks of all games; `round_deadline_s` is required, so that a round that is open at the closing time ends."""
    closes_at: str
    """Time from which no round begins; open rounds may end."""
    counts: NotRequired[str | None]
    """Attempt that counts: `best`, `last` or `first`. `best` where it is left out."""
    description: NotRequired[str | None]
    """Information for entrants; at most 10,000 characters."""
    entries_per_key: NotRequired[int | None]
    """Number of entrants that one key may have. `1` where it is left out."""
    entry: NotRequired[str | None]
    """Entry: `anybody`, or `codes` for holders of invitation codes. `anybody` where it is left out."""
    name: str
    """Name of the competition: 1 to 100 characters."""
    opens_at: str
    """Time from which attempts can be started; a time that is not in the future means at once."""
    own_games: NotRequired[str | None]
    """Time from which entrants read states, journals and scores of their own games: `sealed` (with everybody, after
    the end) or `ended` (once the window of the attempt has closed). `sealed` where it is left out.
    """
    parallel: NotRequired[int | None]
    """Number of games of an attempt that are open at a time. `5` where it is left out."""
    spares: NotRequired[int | None]
    """Number of attempts on other sealed seeds that an entrant has in place of voided ones; together with the
    attempts at most 100. `0` where it is left out.
    """
    suite: NotRequired[SealedSuite | None]
    """Games of each attempt."""
    terms: NotRequired[str | None]
    """Terms that entrants accept when they enter: 1 to 20,000 characters."""
    tie_breaks: NotRequired[Sequence[str] | None]
    """Criteria that decide between equal totals, in this order: `invalid` (smaller share of invalid answers),
    `timeouts` (smaller share of moves that timed out), `attempts` (fewer attempts), `earliest` (the attempt that
    counts ended earlier).
    """


class ConfirmedClock(TypedDict):
    """Time of day of the server after a confirmation."""

    doubt: str | None
    """Reason for which the time of day was in doubt; null if it was not."""
    moved_ms: int
    """Milliseconds by which the server's time of day was moved; negative if it was set back."""
    now: str
    """Time of day that the server uses from now on: that of the host."""


class EntrantContact(TypedDict):
    """Contact of an entrant, for organizers."""

    category: str | None
    """Category of the entrant, if the competition has categories."""
    contact: str | None
    """Contact of the entrant; null if it left none or was erased."""
    entrant: str
    """Id of the entrant."""
    name: str
    """Name of the entrant."""
    status: str
    """Status: `active`, `withdrawn` or `disqualified`."""


ContactList: TypeAlias = Page[EntrantContact]
"""Contacts of the entrants, in the order in which they registered."""


class SeatToken(TypedDict):
    """Token of one agent."""

    agent: str
    """Name of the agent."""
    token: str
    """Token of the agent."""


class CreatedClaim(TypedDict):
    """Claimed seats, with tokens that are shown only once."""

    claim: int
    """Number of the claim in its episode, from 1."""
    episode: str
    """Id of the episode."""
    seats: list[SeatToken]
    """Tokens of the claimed seats, one for each seat."""
    status: StatusName
    """Status of the episode now: the claim of the last open seat starts it."""
    swarm_token: str
    """Token for all of these seats, and for no others."""


class CreatedEntrant(EntrantSummary):
    """New entrant."""

    key: str | None
    """Key of the entrant, shown only once; null if the entrant registered with a key of its own."""


class EpisodeConfig(TypedDict):
    """All settings of an episode, defaults filled in."""

    agent_meta: dict[str, Any]
    answer_reader: NotRequired[str]
    """Reader of language models' answers, `last-marker`, `first-marker` or `json`; left out if it is `last-marker`."""
    bank_s: Seconds
    control: str
    fill_after_s: Seconds | None
    fill_with: str | None
    height: int
    """Rows of the map."""
    idle_timeout_s: Seconds
    max_delay: int
    """The maximum delay of a message, in rounds."""
    max_round: int
    """Number of rounds after which the episode ends."""
    memory: int
    """Number of past rounds that an agent remembers."""
    model: str
    noise: float
    """The probability with which a delivered message is corrupted."""
    num_agents: int
    """Number of agents."""
    open_seats: int
    player: str | None
    prompt_template: str | None
    """Prompt template of the episode's own; null for the built-in template. The journal has the text of either."""
    round_deadline_s: Seconds | None
    rules: str
    seed: int | None
    """Seed of the layout; null while the caller may not know it."""
    start: str
    task: TaskName
    view_size: int
    """Rows and columns of an agent's window; odd, 3 to 2 · size + 1."""
    visibility: str
    width: int
    """Columns of the map."""


class CreatedEpisode(TypedDict):
    """New episode, with tokens that are shown only once."""

    config: EpisodeConfig
    """All settings of the episode."""
    id: str
    """Id of the episode."""
    seats: list[SeatToken]
    """Tokens of the creator's seats, one for each seat."""
    status: StatusName
    """Status of the episode."""
    swarm_token: str
    """Token for all of these seats. It also has the rights of the creator, so it exists even without any seat."""


class Fork(TypedDict):
    """Point at which an episode continues another one."""

    episode: str
    """Id of the other episode, the parent."""
    head: str | None
    """Head of the parent's hash chain before that round; null while the caller may not know the seed."""
    round: int
    """Number of rounds of the parent that were taken over."""


class CreatedForks(TypedDict):
    """New forks of an episode."""

    episodes: list[CreatedEpisode]
    """Forks, as many as requested."""
    fork: Fork
    """Point at which the forks continue their parent."""


class KeySummary(TypedDict):
    """Key as it is shown: everything except the key itself."""

    created_at: str
    """Time of creation."""
    expires_at: str | None
    """Time at which the key expires; null if it never does."""
    id: str
    """Id of the key."""
    name: str
    """Name of the holder."""
    revoked_at: str | None
    """Time at which the key was revoked; null if it was not."""
    role: str
    """Role: `entrant`, `member`, `judge` or `organizer`."""
    state: str
    """State: `good`, `expired` or `revoked`."""


class CreatedKey(KeySummary):
    """New key, shown only once."""

    secret: str
    """The key itself, to be sent as `Authorization: Bearer …`; it cannot be shown again."""


class MemberSummary(TypedDict):
    """Member of a team."""

    added_at: str
    """Time at which the member was added."""
    id: str
    """Id of the member's key."""
    name: str
    """Name of the member."""
    removed_at: str | None
    """Time at which the member was removed; null while it is a member."""


class CreatedMember(MemberSummary):
    """New member of a team."""

    key: str
    """Key of the member, shown only once. It has the same rights as the entrant's own key."""


class SuiteSettingsView(TypedDict):
    """Settings of all games of a suite."""

    answer_reader: NotRequired[str]
    """Reader of language models' answers, `last-marker`, `first-marker` or `json`; left out if it is `last-marker`."""
    bank_s: Seconds
    control: str
    height: int
    """Rows of the map."""
    max_delay: int
    """The maximum delay of a message, in rounds."""
    max_round: int
    """Number of rounds after which the episode ends."""
    memory: int
    """Number of past rounds that an agent remembers."""
    noise: float
    """The probability with which a delivered message is corrupted."""
    num_agents: int
    """Number of agents."""
    round_deadline_s: Seconds | None
    view_size: int
    """Rows and columns of an agent's window; odd, 3 to 2 · size + 1."""
    width: int
    """Columns of the map."""


class SuiteView(TypedDict):
    """Suite as it is shown. Only runs with the same name, digest and rules can be compared."""

    digest: str | None
    """First 12 hexadecimal digits of SHA-256 of the suite with its rules, seeds and settings. Null while the seeds
    are null.
    """
    games: int
    """Number of games."""
    name: str
    """Name of the suite."""
    rules: str
    """Rule set: `paper` or `reference`."""
    seeds: list[int] | None
    """Seeds; null while the caller may not know them."""
    seeds_by_task: bool
    """Whether each task has its own seeds: those of the first task come first in `seeds`."""
    settings: SuiteSettingsView
    """Settings of all games."""
    tasks: list[str]
    """Tasks, in the order in which they are played."""


class TaskResult(TypedDict):
    """Result of a run in one task. While the run is running, the values are means over the games that have ended;
    once it is over, a game that was never played counts as 0.
    """

    deviation: float | None
    """Population standard deviation over the seeds."""
    mean: float | None
    """Mean score over the seeds."""
    planned: int
    """Number of games of the plan that count."""
    played: int
    """Number of games that have ended and count."""
    task: TaskName
    """Name of the task."""
    voided: int
    """Number of voided games."""


class Limit(TypedDict):
    """Limit with its name."""

    name: str
    """Name of the limit; the unit is its last part."""
    value: int
    """Value of the limit."""


class RunSummary(TypedDict):
    """Run as it is listed."""

    acts: ActTally
    """Acts of all games that have ended and count."""
    agent_meta: dict[str, Any]
    """Further facts about the player."""
    attempt: int | None
    """Number of the attempt, if the run belongs to a competition."""
    closes_at: str | None
    """Time from which no new round begins."""
    created_at: str
    """Time of creation."""
    ended_at: str | None
    """Time at which the run ended; null before."""
    holders: NotRequired[list[RunHolder]]
    """Holders of a team; left out where one player has all seats."""
    id: str
    """Id of the run."""
    idle_timeout_s: Seconds
    """Seconds without any act after which a game ends as abandoned."""
    model: str
    """Name of the model that plays, as declared; temperature, `top_p` and `agent_meta` are declared, too."""
    parallel: int
    """Number of games that are open at a time."""
    planned: int
    """Number of games of the plan that count."""
    played: int
    """Number of games that have ended and count."""
    player: str | None
    """Built-in player with which the server plays all seats."""
    prompt: str
    """Name of the prompt: `default`, `toolkit`, `static-first` or `custom:` and the first digits of
    `template_digest`; `default:1` for the words of an earlier revision. A system message adds `+system:` and the
    first digits of its SHA-256. `none` for built-in players and people, who read no prompts.
    """
    sampling: str | None
    """Further sampling, as an evaluation declares it in `agent_meta.eval`; null without any."""
    status: str
    """Status: `running`, `finished`, `aborted`, `abandoned` or `closed`."""
    suite: SuiteView
    """Suite of the run."""
    tasks: list[TaskResult]
    """Results, task by task."""
    temperature: float | None
    """Sampling temperature."""
    template_digest: str | None
    """Digest of the prompt template; null for the built-in template."""
    top_p: float | None
    """Nucleus of sampling (top-p)."""
    total: float | None
    """Sum of the tasks' means; null while a mean is missing or the caller may not know it."""
    visibility: str
    """Visibility: `public`, `owner` or `sealed`."""
    void_reason: str | None
    """Reason for which the run was voided as an attempt; null if it was not."""
    voided: int
    """Number of voided games."""
    waits_for: Limit | None
    """Limit that keeps the run from opening more games now; null while no limit does."""


class RunGame(TypedDict):
    """Game of a run."""

    episode: str | None
    """Id of the game's episode; null before it is opened."""
    reason: str | None
    """Reason of the end; null before, and if the caller may not know it."""
    round: int
    """Number of resolved rounds."""
    score: float | None
    """Score so far; null before the game is opened, and while the caller may not know it."""
    seed: int | None
    """Seed of the game; null while the caller may not know it."""
    slot: int
    """Place of the game in the plan, from 0."""
    status: str
    """Status of the episode; `planned` before it is opened."""
    task: TaskName
    """Name of the task."""
    void_reason: str | None
    """Reason for which the game was voided; null if it was not."""


class RunDetail(RunSummary):
    """Run with its games."""

    games: list[RunGame]
    """Games in the order of the plan. A voided game comes before its replacement. If the answer would be too large,
    replaced games are left out, beginning with the first slot.
    """


class HolderToken(TypedDict):
    """Token of a holder of a team."""

    holder: str
    """Name of the holder within its team."""
    swarm_token: str
    """Token for the holder's seats of all games."""


class CreatedRun(RunDetail):
    """New run."""

    holder_tokens: NotRequired[list[HolderToken]]
    """Tokens of a team's holders, shown only once; none for holders that the server plays."""
    swarm_token: str | None
    """Token for all seats of all games, shown only once; null if the server itself plays, and in a team."""


class CrossPlayPair(TypedDict):
    """Two models that played together, as different holders of seats."""

    deviation: float
    """Population standard deviation of these scores."""
    games: int
    """Number of finished games in which both took part, perhaps beside others."""
    mean: float
    """Mean score of these games."""
    models: list[str]
    """Names of the two models, in order; the same name twice if two holders used the same model."""
    rules: str
    """Rule set: `paper` or `reference`."""
    settings: dict[str, Any]
    """All other settings except the seed. Games with other settings belong to another pair."""
    task: TaskName
    """Name of the task."""
    vouched: bool
    """Whether both models are vouched for in all games; false if in one of them only the holder declares the model."""


CrossPlay: TypeAlias = Page[CrossPlayPair]
"""Cross-play: pairs of models and their scores, or a page of them."""


class DearDecision(TypedDict):
    """A decision that lost much."""

    action: str | None
    """Action of the agent; null for none."""
    agent: str
    """Name of the agent."""
    kind: str
    """Kind of the decision: `moved`, `waited`, `blocked`, `switched`, `invalid` or `late`."""
    loss: float
    """Loss of the decision."""
    reference_action: str | None
    """Action of the reference in its place."""
    round: int
    """Number of the round."""
    words: str
    """The decision in words."""


class EntrantChange(TypedDict):
    """Changes of an entrant, by an organizer or by the entrant, which may rename and withdraw itself. Fields that
    are left out do not change.
    """

    accepts_terms: NotRequired[int | None]
    """Newest version of the terms, which the entrant accepts."""
    category: NotRequired[str | None]
    """New category of the competition's; organizers only."""
    contact: NotRequired[str | None]
    """New contact; an empty one removes it."""
    name: NotRequired[str | None]
    """New name, until the competition closes; it does not look like a name that another entrant has or had."""
    reason: NotRequired[str | None]
    """Reason, which everybody sees: 1 to 500 characters. Required for a disqualification."""
    status: NotRequired[str | None]
    """New status: `active`, `withdrawn` or `disqualified`."""
    vouched: NotRequired[bool | None]
    """Whether the organizer vouches for the declared model."""


class EntrantDetail(EntrantSummary):
    """Entrant with its own results."""

    attempts: list[AttemptSummary]
    """Attempts of the entrant, in the order in which they were started; the last 1,000 of them."""
    contact: str | None
    """Contact for organizers; null for judges."""


EntrantList: TypeAlias = Page[EntrantSummary]
"""Entrants, in the order in which they registered."""


class EntrantRequest(TypedDict):
    """New entrant and its player. The declaration of the player never changes: another model is another entrant."""

    accepts_terms: NotRequired[int | None]
    """Version of the terms that the entrant accepts, if the competition has terms."""
    agent_meta: NotRequired[Mapping[str, Any] | None]
    """Further facts about the player; at most 16 KiB of JSON."""
    category: NotRequired[str | None]
    """Category of the entrant, if the competition has categories."""
    code: NotRequired[str | None]
    """Invitation code, if the competition requires one. If anybody may enter, the code takes a reserved place."""
    contact: NotRequired[str | None]
    """Contact for organizers, such as an email address: 1 to 200 characters. Only organizers and the entrant see it."""
    model: str
    """Name of the model: 1 to 200 characters."""
    name: str
    """Name on the board: 1 to 100 characters that do not look like a name that another entrant has or had."""
    prompt_template: NotRequired[str | None]
    """Prompt template of the entrant's own."""
    temperature: NotRequired[float | None]
    """Sampling temperature."""
    top_p: NotRequired[float | None]
    """Nucleus of sampling (top-p)."""


class EpisodeSummary(TypedDict):
    """Episode as it is listed."""

    config: EpisodeConfig
    """All settings of the episode."""
    created_at: str
    """Time of creation."""
    curve: NotRequired[list[float] | None]
    """Scores in equal steps of rounds, the first before round 0 and the last at the end: at most 32. Only in lists
    that ask for them, and only of ended episodes.
    """
    ended_at: str | None
    """Time at which the episode ended; null before."""
    fork: Fork | None
    """Point at which the episode continues another one; null if it is no fork."""
    id: str
    """Id of the episode."""
    mixed: bool
    """True if seats are, or were, open to several holders."""
    model: str
    """Name of the model that plays."""
    people: bool
    """True if a person takes part, as declared by `agent_meta.kind`; false in an open episode with several holders."""
    result: EpisodeResult | None
    """End of the episode; null before."""
    round: int
    """Number of resolved rounds."""
    run: str | None
    """Id of the episode's run; null without a run."""
    score: float
    """Score so far."""
    status: StatusName
    """Status of the episode."""
    task: TaskName
    """Name of the task."""
    void_reason: str | None
    """Reason for which the episode was voided; null if it was not."""


EpisodeList: TypeAlias = Page[EpisodeSummary]
"""Page of episodes, newest first."""


class EpisodeRequest(TypedDict):
    """Settings of a new episode. All but `task` have defaults."""

    agent_meta: NotRequired[Mapping[str, Any] | None]
    """Further facts about the player; at most 16 KiB of JSON."""
    answer_reader: NotRequired[AnswerReader | None]
    """Reader of language models' answers: `last-marker`, `first-marker` or `json`. `last-marker` where it is left
    out.
    """
    bank_s: NotRequired[float | None]
    """Time that a seat may overspend in all rounds together, in seconds. `0` where it is left out."""
    control: NotRequired[Control | None]
    """`decentralized` or `centralized`. `decentralized` where it is left out."""
    fill_after_s: NotRequired[float | None]
    """Seconds after which built-in players take the unclaimed seats; never by default."""
    fill_with: NotRequired[str | None]
    """Built-in player that takes unclaimed seats; `default` is the task's own player. `default` where it is left
    out.
    """
    height: NotRequired[int | None]
    """Rows of the map. `10` where it is left out."""
    idle_timeout_s: NotRequired[float | None]
    """Seconds without any act after which the episode ends as abandoned. `86400` where it is left out."""
    max_delay: NotRequired[int | None]
    """The maximum delay of a message, in rounds. `0` where it is left out."""
    max_round: NotRequired[int | None]
    """Number of rounds after which the episode ends. `100` where it is left out."""
    memory: NotRequired[int | None]
    """Number of past rounds that an agent remembers. `5` where it is left out."""
    model: NotRequired[str | None]
    """Name of the model that plays; at most 200 characters. `unnamed` where it is left out."""
    noise: NotRequired[float | None]
    """The probability with which a delivered message is corrupted. `0.0` where it is left out."""
    num_agents: NotRequired[int | None]
    """Number of agents. `12` where it is left out."""
    open_seats: NotRequired[int | None]
    """Number of seats that are open to claims, those of the last agents; the creator gets no tokens for them. `0`
    where it is left out.
    """
    player: NotRequired[str | None]
    """Built-in player that the server hosts on the creator's seats, which then have no tokens; `default` is the
    task's own player.
    """
    prompt_template: NotRequired[str | None]
    """Prompt template of the episode's own; at most 32 KiB."""
    round_deadline_s: NotRequired[float | None]
    """Clock of a round in seconds; none by default."""
    rules: NotRequired[RuleSet | None]
    """Rule set: `paper` or `reference`. `paper` where it is left out."""
    seed: NotRequired[int | None]
    """Seed of the layout, 0 to 2⁵³ − 1; drawn at random by default."""
    start: NotRequired[Start | None]
    """Start of the episode: `now` or `manual`. `now` where it is left out."""
    task: TaskName
    """Task: `Transport`, `Pursuit`, `Synchronization`, `Foraging` or `Flocking`."""
    view_size: NotRequired[int | None]
    """Rows and columns of an agent's window; odd, 3 to 2 · size + 1. `5` where it is left out."""
    visibility: NotRequired[Visibility | None]
    """Readers of state, events and resolved rounds before the end: `public` (anyone) or `owner` (the creator).
    `public` where it is left out.
    """
    width: NotRequired[int | None]
    """Columns of the map. `10` where it is left out."""


class Exclusion(TypedDict):
    """Entrants that were excluded, or would be."""

    count: int
    """Number of these entrants."""
    excluded: bool
    """Whether the entrants were excluded; false in a preview."""
    items: list[EntrantSummary]
    """First 1,000 of these entrants, in the order in which they registered."""


class ExclusionRequest(TypedDict):
    """Entrants that an organizer excludes at once: those that match all fields that are given."""

    address: NotRequired[str | None]
    """Address or network from which the entrants registered, like `203.0.113.7` or `2001:db8::/32`."""
    count: NotRequired[int | None]
    """Number of matching entrants, from the preview. If it is left out, the answer is the preview, and nothing is
    done.
    """
    name: NotRequired[str | None]
    """Pattern of names, case-insensitive: `*` stands for any characters, `?` for one."""
    reason: NotRequired[str | None]
    """Reason, which everybody sees: 1 to 500 characters. Required if `count` is given."""
    registered_before: NotRequired[str | None]
    """Time of registration: before this time."""
    registered_from: NotRequired[str | None]
    """Time of registration: this time or later."""


class FieldProblem(TypedDict):
    """Field that was refused."""

    field: str
    """Name of the field."""
    problem: str
    """Allowed values, and the value that was sent."""


class ForkRequest(TypedDict):
    """Start and settings of a fork. Settings that are left out are as for a new episode, except the visibility and
    the prompt template, which are the parent's. The settings of the simulation are the parent's and cannot be
    named.
    """

    agent_meta: NotRequired[Mapping[str, Any] | None]
    """Further facts about the player; at most 16 KiB of JSON."""
    bank_s: NotRequired[float | None]
    """Time that a seat may overspend in all rounds together, in seconds. `0` where it is left out."""
    count: NotRequired[int | None]
    """Number of forks of the same state. `1` where it is left out."""
    fill_after_s: NotRequired[float | None]
    """Seconds after which built-in players take the unclaimed seats; never by default."""
    fill_with: NotRequired[str | None]
    """Built-in player that takes unclaimed seats; `default` is the task's own player. `default` where it is left
    out.
    """
    idle_timeout_s: NotRequired[float | None]
    """Seconds without any act after which the episode ends as abandoned. `86400` where it is left out."""
    model: NotRequired[str | None]
    """Name of the model that plays; at most 200 characters. `unnamed` where it is left out."""
    open_seats: NotRequired[int | None]
    """Number of seats that are open to claims, those of the last agents; the creator gets no tokens for them. `0`
    where it is left out.
    """
    player: NotRequired[str | None]
    """Built-in player that the server hosts on the creator's seats, which then have no tokens; `default` is the
    task's own player.
    """
    prompt_template: NotRequired[str | None]
    """Prompt template of the fork's own; at most 32 KiB. The parent's by default."""
    round: int
    """Number of rounds that are taken over, from 0 to the number of resolved rounds; also the first round to be
    played.
    """
    round_deadline_s: NotRequired[float | None]
    """Clock of a round in seconds; none by default. Banks are full, whatever was used before the fork."""
    start: NotRequired[Start | None]
    """Start of the fork: `now` or `manual`. `now` where it is left out."""
    visibility: NotRequired[Visibility | None]
    """Readers of state, events and resolved rounds before the end: `public` (anyone) or `owner` (the creator); the
    parent's by default.
    """


MetricSeries = TypedDict(
    "MetricSeries",
    {
        # Whole numbers of each state; null where undefined.
        "counts": dict[str, list[int | None]],
        # First state: 0 is the layout, `n` the state after `n` rounds.
        "from": int,
        # Number of states in each list.
        "length": int,
        # First state after the lists; null if they reach the newest state.
        "next": int | None,
        # Metrics of each state; null where undefined.
        "values": dict[str, list[float | None]],
    },
)
"""Values of some states, in order."""


class MetricValue(TypedDict):
    """Value of a metric for a whole game."""

    rounds: int
    """Number of rounds from which the value was computed."""
    value: float | None
    """Mean over the rounds in which the metric is defined, unless the metric says otherwise; null if it is
    undefined.
    """


class GameMetrics(MetricsMethod):
    """Metrics of an episode or of an imported game."""

    episode: str
    """Id of the game."""
    rounds: int
    """Number of resolved rounds."""
    sampled: bool
    """Whether texts were left out of a comparison because a round had too many."""
    score: float
    """Score after these rounds."""
    series: NotRequired[MetricSeries | None]
    """Values of states, if requested."""
    status: str
    """Status of the game; `imported` for an imported game."""
    task: TaskName
    """Name of the task."""
    values: dict[str, MetricValue]
    """Values of the game."""


class WorthMethod(TypedDict):
    """Method by which worth was computed. Values of different methods cannot be compared."""

    reference: str
    """Name of the reference: the default built-in player of the task."""
    worth_revision: int
    """Revision of the reference's decisions and of all definitions."""


class LossSum(TypedDict):
    """Losses of all decisions of a seat, or of a kind."""

    decisions: int
    """Number of decisions."""
    gained: float
    """Sum of their losses below 0, as a number above 0."""
    lost: float
    """Sum of their losses above 0."""
    share: float | None
    """Share in what all decisions of the game lost; null where nothing was lost."""


class RoundLoss(TypedDict):
    """Loss of a round: worth before it minus worth after it. Below 0 where the swarm found something better than the
    reference.
    """

    loss: float
    """Worth before the round minus worth after it."""
    round: int
    """Number of the round."""
    seats: dict[str, float] | None
    """By agent: worth after the round if this agent alone had done what the reference would have done, minus worth
    after the round. Null if they are missing.
    """


class MissingPart(TypedDict):
    """A part of the answer that is missing."""

    detail: str
    """Reason for which it is missing."""
    part: str
    """The part: `values` or `seats`."""


class GameWorth(WorthMethod):
    """Worth of the states of a game, and losses of its decisions."""

    accuracy: float | None
    """The score of a game that has ended, or else the last worth, as a share of the first worth: what could be
    scored and was not lost. Above 1 where the swarm did better than the reference; null where nothing could be
    scored.
    """
    dearest: list[DearDecision] | None
    """The ten decisions that lost most, the dearest first. Null if they are missing."""
    episode: str | None
    """Id of the game; null for a file that does not say it."""
    kinds: dict[str, LossSum] | None
    """Losses of seats by kind of decision: `moved`, `waited`, `blocked`, `switched`, `invalid`, `late`."""
    losses: list[RoundLoss] | None
    """Losses of the rounds, in order. Null if it is missing."""
    missing: list[MissingPart]
    """Missing parts, with reasons."""
    reference_is_weak: bool | None
    """Whether the game scored more than the reference would have from the start: the reference is weak here."""
    rounds: int
    """Number of resolved rounds."""
    score: float
    """Score after these rounds."""
    seats: dict[str, LossSum] | None
    """Losses of each seat, by the name of its agent. Null if they are missing."""
    settled_round: int | None
    """The first round from which on the reference would have scored nothing more; null if it would still score."""
    task: TaskName
    """Name of the task."""
    values: list[float] | None
    """Worth of each state, `rounds + 1` numbers: the score that the reference reaches from there. Null if it is
    missing.
    """


class Health(TypedDict):
    """Health of the server."""

    status: str
    """Always `ok`."""
    version: str
    """Version of the server."""


class HolderRequest(TypedDict):
    """Holder of a team, who plays some seats of every game of a run. Every seat has one holder."""

    agent_meta: NotRequired[Mapping[str, Any] | None]
    """Further facts about the player; at most 16 KiB of JSON, and 64 KiB of all holders together."""
    model: NotRequired[str | None]
    """Name of the model that plays; at most 200 characters."""
    name: NotRequired[str | None]
    """Name within the team; that of the model by default. No two holders have the same."""
    player: NotRequired[str | None]
    """Built-in player with which the server plays these seats; `default` is each task's own. Such a holder has no
    token.
    """
    seats: Sequence[int]
    """Numbers of its agents."""
    temperature: NotRequired[float | None]
    """Sampling temperature."""
    top_p: NotRequired[float | None]
    """Nucleus of sampling (top-p)."""


class ImportConfig(TypedDict):
    """Settings of an imported game. The toolkit's files contain only the first five."""

    answer_reader: NotRequired[str | None]
    control: str | None
    height: int
    max_delay: int | None
    max_round: int
    memory: int | None
    noise: float | None
    num_agents: int
    rules: str | None
    view_size: int
    width: int


class ImportSummary(TypedDict):
    """Imported game. It is not verified: everything in it comes from its files."""

    acts: int
    """Number of acts; 0 if the file with them was missing or broken."""
    id: str
    """Id of the game."""
    imported_at: str
    """Time of the import."""
    model: str
    """Name of the model that played, as the files say."""
    rounds: int
    """Number of resolved rounds."""
    run_id: str
    """Name of the game in its files."""
    score: float
    """Last score."""
    seed: int
    """Seed of the game."""
    settings: ImportConfig
    """Settings that the files contain."""
    task: TaskName
    """Name of the task."""
    verified: bool
    """Always false: this server neither received the acts nor computed the states."""


ImportList: TypeAlias = Page[ImportSummary]
"""Page of imported games, newest first."""


class InvitationCode(TypedDict):
    """Invitation code."""

    code: str
    """Code, good for one entrant and shown only once."""
    label: str
    """Receiver of the code."""


class InvitationCodes(TypedDict):
    """New invitation codes, shown only once."""

    items: list[InvitationCode]
    """Codes, one for each label."""


class InvitationSummary(TypedDict):
    """Invitation code as organizers see it later: without the code itself."""

    created_at: str
    """Time of creation."""
    entrant: str | None
    """Id of the entrant that used the code."""
    label: str
    """Receiver of the code."""
    revoked_at: str | None
    """Time at which the code was revoked."""
    state: str
    """State: `unused`, `used` or `revoked`."""


InvitationList: TypeAlias = Page[InvitationSummary]
"""Invitation codes, in the order in which they were made."""


KeyList: TypeAlias = Page[KeySummary]
"""All keys that were ever made, oldest first."""


class KeyRequest(TypedDict):
    """New key, which an organizer creates for somebody."""

    expires_at: NotRequired[str | None]
    """Time at which the key expires; never by default."""
    name: str
    """Name of the holder: 1 to 100 characters."""
    role: NotRequired[str | None]
    """Role: `entrant`, `member` (the default), `judge` or `organizer`."""


class Leaderboard(TypedDict):
    """Board, or a page of one."""

    digest: str
    """First 12 hexadecimal digits of SHA-256 of the suite. Suites of the same name with other tasks, seeds, settings
    or rules have another digest and a board of their own.
    """
    items: list[BoardRow]
    """Rows, highest first."""
    metrics: NotRequired[list[str]]
    """Requested metrics, in the requested order."""
    metrics_method: NotRequired[MetricsMethod | None]
    """Method by which the metrics were computed."""
    next_cursor: str | None
    """Cursor of the next page; null on the last page."""
    pick: str
    """Run of a player that makes its row: `best`, `last` or `mean`."""
    rows: int
    """Number of rows of the whole board."""
    rules: str
    """Rule set: `paper` or `reference`."""
    sort: str
    """Value by which rows are ranked: `total`, or the name of a task for the mean of this task."""
    suite: str
    """Name of the suite."""
    tasks: list[str]
    """Tasks that are shown, in the order of the suite."""


class LineAgent(TypedDict):
    """An agent of the reference's line."""

    action: str | None
    """Its action; null for an agent that had escaped."""
    agent: str
    """Name of the agent."""
    alive: bool
    """True while it is on the map, after the round."""
    at: list[int]
    """Row and column after the round."""


class LineRound(TypedDict):
    """A round of the reference's line."""

    agents: list[LineAgent]
    """Agents after the round, in the order of their numbers."""
    round: int
    """Number of the round."""
    score: float
    """Score after the round."""


class MemberList(TypedDict):
    """Added members of a team, in the order in which they were added. The one who entered is not among them."""

    items: list[MemberSummary]
    """Members of the team, removed ones included."""


class MemberRequest(TypedDict):
    """New member of an entrant's team, who gets a key."""

    name: str
    """Name of the member, which the team, organizers and judges see: 1 to 100 characters."""


class MetricMean(TypedDict):
    """Mean over games."""

    deviation: float
    """Population standard deviation."""
    games: int
    """Number of games with a value."""
    mean: float
    """Mean over the games in which the metric is defined."""


ModelList: TypeAlias = Page[str]
"""Page of the names of models, in order."""


class Node(TypedDict):
    """Server."""

    address: str | None
    """Address at which the other servers reach it; none for a server that plays alone."""
    clock_offset_ms: int
    """Milliseconds by which the server's clock is ahead of that of the database."""
    connected: bool
    """Whether the database has the server's session. A server without one has lost its connection, or its process is
    gone.
    """
    episodes: int
    """Number of episodes in memory."""
    id: int
    """Number of the server: a server that is started again gets another. 0 for a server that plays alone."""
    is_this: bool
    """Whether this is the server that answers the request."""
    name: str
    """Host and process."""
    places: int
    """Number of games, runs and competitions that the server has taken."""
    ready: bool
    """Whether the server takes games that nobody plays."""
    seen_ms_ago: int
    """Milliseconds since the server was last seen, by the clock of the database. After 6,000 the others take over
    what it plays.
    """
    started_at: str
    """Time at which the server was started."""
    version: str
    """Version of the program."""


class NodeList(TypedDict):
    """Servers of a database, oldest first. The first server does what only one does: it measures games, and deletes
    what is old.
    """

    cluster: bool
    """Whether several servers may play on this database."""
    items: list[Node]
    """All servers."""


class OrganizerAction(TypedDict):
    """Action of an organizer in a competition, as everybody sees it."""

    action: str
    """Name of the action."""
    at: str
    """Time of the action."""
    detail: Any
    """Further facts: old and new values, and the reason."""
    subject: str
    """Id of the competition, entrant, run or game that the action concerns."""


OrganizerActions: TypeAlias = Page[OrganizerAction]
"""Actions of organizers in a competition, newest first."""


class OwnSettings(TypedDict):
    """Settings of all games of a suite of one's own, as for an episode."""

    answer_reader: NotRequired[AnswerReader | None]
    """Reader of language models' answers: `last-marker`, `first-marker` or `json`. `last-marker` where it is left
    out.
    """
    control: NotRequired[Control | None]
    """`decentralized` or `centralized`. `decentralized` where it is left out."""
    height: NotRequired[int | None]
    """Rows of the map. `10` where it is left out."""
    max_delay: NotRequired[int | None]
    """The maximum delay of a message, in rounds. `0` where it is left out."""
    max_round: NotRequired[int | None]
    """Number of rounds after which the episode ends. `100` where it is left out."""
    memory: NotRequired[int | None]
    """Number of past rounds that an agent remembers. `5` where it is left out."""
    noise: NotRequired[float | None]
    """The probability with which a delivered message is corrupted. `0.0` where it is left out."""
    num_agents: NotRequired[int | None]
    """Number of agents. `12` where it is left out."""
    view_size: NotRequired[int | None]
    """Rows and columns of an agent's window; odd, 3 to 2 · size + 1. `5` where it is left out."""
    width: NotRequired[int | None]
    """Columns of the map. `10` where it is left out."""


class OwnSuite(TypedDict):
    """Suite of one's own: every task is played once on each seed."""

    name: str
    """Name of the suite: 1 to 100 characters, and not that of a built-in suite."""
    seeds: Sequence[int]
    """Seeds, each 0 to 2⁵³ − 1."""
    settings: NotRequired[OwnSettings | None]
    """Settings of all games; settings that are left out are those of the standard setting."""
    tasks: NotRequired[Sequence[TaskName] | None]
    """Tasks, in the order in which they are played; all five by default."""


class PracticeRequest(TypedDict):
    """Practice games on open seeds."""

    entrant: NotRequired[str | None]
    """Id of the entrant; required if the key has several."""
    seeds: NotRequired[Sequence[int] | None]
    """Seeds, 1 to 10, on each of which every task is played once; by default one seed that the server draws."""
    tasks: NotRequired[Sequence[TaskName] | None]
    """Tasks of the competition; all by default."""


class Problem(TypedDict):
    """Error, with facts that help to recover."""

    code: str
    """Kind of the problem, for programs."""
    detail: str
    """Explanation of this occurrence, and advice."""
    fields: NotRequired[list[FieldProblem]]
    """Fields that were refused."""
    limit: NotRequired[Limit | None]
    """Limit that was reached."""
    retry_after_ms: NotRequired[int | None]
    """Milliseconds after which to try again."""
    round: NotRequired[int | None]
    """Current round of the episode."""
    status: int
    """HTTP status."""
    title: str
    """Kind of the problem, in words."""
    type: str
    """Kind of the problem as a URI; the same as `code`."""


class ReferenceLine(WorthMethod):
    """How the reference would play on from a state."""

    episode: str | None
    """Id of the game; null for a file that does not say it."""
    round: int
    """Round from whose state the reference plays."""
    rounds: list[LineRound]
    """Its rounds, in order; fewer than asked for where the game ends."""


class ReplacedKey(TypedDict):
    """New key that replaces one which an entrant has lost."""

    entrant: str
    """Id of the entrant."""
    key: str
    """New key, shown only once. The previous key is no longer valid."""


class ReplayHead(TypedDict):
    """Facts about the whole game."""

    block_cells: NotRequired[list[list[int]] | None]
    """Cells of the block relative to its position (Transport)."""
    control: NotRequired[str | None]
    """`decentralized` or `centralized`; left out if an imported game does not name it."""
    episode: str
    """Id of the game."""
    ground: NotRequired[list[str] | None]
    """Cells that never change, one text a row: `.` free, `W` wall, `N` nest, `F` food. Left out with `ground=false`."""
    height: int
    """Rows of the map."""
    max_round: NotRequired[int | None]
    """Number of rounds after which the game ends."""
    next: int | None
    """Value of `from` for the next page; null if this page has the newest state."""
    num_agents: int
    """Number of agents."""
    rounds: int
    """Number of resolved rounds."""
    rules: NotRequired[str | None]
    """Rule set: `paper` or `reference`; left out if an imported game does not name it."""
    score: float
    """Score after the resolved rounds."""
    status: str
    """Status of the episode; `imported` for an imported game."""
    task: TaskName
    """Name of the task."""
    view_size: NotRequired[int | None]
    """Rows and columns of an agent's window."""
    width: int
    """Columns of the map."""


ReplayHeard = TypedDict(
    "ReplayHeard",
    {
        # Numbers of the agents that read the message.
        "by": list[int],
        # Number of the sender.
        "from": int,
        # Round in which the message was sent, if that is not the round that led to this state.
        "sent": NotRequired[int | None],
        # Text as the agents read it, if that is not what the sender said in the round that led to this state: noise
        # changed it, or it came late.
        "text": NotRequired[str | None],
    },
)
"""Message as it is read."""


ReplayMark: TypeAlias = Literal["points", "drop", "invalid", "timeout", "silence", "convergence"]
"""Remarkable fact about a round."""


ReplayMessage = TypedDict(
    "ReplayMessage",
    {
        # Number of the sender.
        "from": int,
        # Text of the message.
        "text": str,
        # Only receiver of a commander's message.
        "to": NotRequired[int | None],
    },
)
"""Message as it was sent."""


class ReplayState(TypedDict):
    """State, and the decisions of the round that led to it."""

    actions: NotRequired[str | None]
    """Actions, one character for each agent: `U`, `D`, `L`, `R`, `S` stay, `X` switch the light, `-` none."""
    at: list[int]
    """Row and column of each agent, one agent after another; for an agent that escaped, those of the cell to which
    it went.
    """
    block: NotRequired[list[int] | None]
    """Row and column of the block's position (Transport)."""
    blocked: NotRequired[list[int]]
    """Numbers of the agents that chose a direction and did not move that way."""
    distance: NotRequired[float | None]
    """Cost of the placement (Flocking)."""
    gone: NotRequired[list[int]]
    """Numbers of the agents that are not on the map."""
    heard: NotRequired[list[ReplayHeard]]
    """Messages that are read with this state."""
    invalid: NotRequired[list[int]]
    """Numbers of the agents whose answer was invalid."""
    lit: NotRequired[list[int]]
    """Numbers of the agents whose light is on (Synchronization)."""
    loaded: NotRequired[list[int]]
    """Numbers of the agents that carry food (Foraging)."""
    marks: NotRequired[list[ReplayMark]]
    """Remarkable facts about the round: `points` and `drop` (the score rose, fell), `invalid`, `timeout`, `silence`
    (nobody spoke, after a round in which somebody did), `convergence` (at least two spoke and all said the same,
    not so in the round before).
    """
    prey: NotRequired[list[int] | None]
    """Row and column of the prey (Pursuit)."""
    pushed: NotRequired[list[int]]
    """Numbers of the agents that moved in another way than they chose."""
    round: int
    """Number of rounds that led to the state."""
    said: NotRequired[list[ReplayMessage]]
    """Messages of the round."""
    score: float
    """Score of the state."""
    timeouts: NotRequired[list[int]]
    """Numbers of the agents whose clock expired."""


ReplayPage = TypedDict(
    "ReplayPage",
    {
        # First state: 0 is the layout, `n` the state after `n` rounds.
        "from": int,
        # Number of states.
        "length": int,
        # Metrics by name: a number or null for each state. The values of a state are those of the round that led to it.
        "metrics": dict[str, list[float | None]],
        # States in order.
        "states": list[ReplayState],
    },
)
"""States of a page. Pages overlap by one state."""


class Replay(ReplayHead, ReplayPage):
    """Page of the states of a game."""


class RevokeCodesRequest(TypedDict):
    """Unused invitation codes to revoke: all with one of the labels, and single codes."""

    codes: NotRequired[Sequence[str]]
    """Single codes."""
    labels: NotRequired[Sequence[str]]
    """Labels; each revokes all unused codes that have it."""


class StateAgent(TypedDict):
    """Agent as a spectator sees it."""

    agent: str
    """Name of the agent."""
    alive: bool
    """Whether the agent is on the map."""
    carrying_food: NotRequired[bool | None]
    """Whether the agent carries food (Foraging)."""
    i: int
    """Row of the agent; after an escape the row of the exit."""
    j: int
    """Column of the agent."""
    light_on: NotRequired[bool | None]
    """Whether the agent's light is on (Synchronization)."""


class RoundEvent(TypedDict):
    """Event of a resolved round for spectators; the grid is in the state."""

    agents: list[StateAgent]
    """All agents after the round."""
    round: int
    """Number of resolved rounds, this one included."""
    score: float
    """Score after the round."""


RunList: TypeAlias = Page[RunSummary]
"""Page of runs, newest first."""


class RunMetrics(MetricsMethod):
    """Metrics of the games of a run, or a page of them."""

    items: list[GameMetrics]
    """Games that have ended and were not voided, in the order of the plan."""
    next_cursor: str | None
    """Cursor of the next page; null on the last page."""
    run: str
    """Id of the run."""
    tasks: dict[str, dict[str, MetricMean]]
    """Means over the games of this page, by task and metric."""


SuiteRequest: TypeAlias = str | OwnSuite
"""Suite of a run."""


class RunRequest(TypedDict):
    """Settings of a new run. All but `suite` and `model` have defaults."""

    agent_meta: NotRequired[Mapping[str, Any] | None]
    """Further facts about the player; at most 16 KiB of JSON."""
    bank_s: NotRequired[float | None]
    """Time that a seat may overspend in all rounds of a game together, in seconds. `0` where it is left out."""
    holders: NotRequired[Sequence[HolderRequest] | None]
    """Holders of a team: each plays its own seats of every game, with a token of its own; 1 to 64. Then `model` is
    the name of the team, and `player`, `temperature` and `top_p` are left out.
    """
    idle_timeout_s: NotRequired[float | None]
    """Seconds without any act after which a game ends as abandoned, and its run with it. `86400` where it is left
    out.
    """
    model: str
    """Name of the model that plays; at most 200 characters."""
    parallel: NotRequired[int | None]
    """Number of games that are open at a time. `4` where it is left out."""
    player: NotRequired[str | None]
    """Built-in player with which the server plays all seats; `default` is each task's own player. Such a run has no
    token.
    """
    prompt_template: NotRequired[str | None]
    """Prompt template of the run's own; at most 32 KiB."""
    round_deadline_s: NotRequired[float | None]
    """Clock of a round in seconds; none by default."""
    rules: NotRequired[RuleSet | None]
    """Rule set: `paper` or `reference`. `paper` where it is left out."""
    suite: SuiteRequest
    """Name of a built-in suite, or a suite of your own."""
    temperature: NotRequired[float | None]
    """Sampling temperature."""
    top_p: NotRequired[float | None]
    """Nucleus of sampling (top-p)."""
    visibility: NotRequired[Visibility | None]
    """Readers of the run and of its games before their end: `public` (anyone) or `owner` (the creator). `public`
    where it is left out.
    """


class Scores(TypedDict):
    """Scores of a game in equal steps."""

    episode: str
    """Id of the game."""
    every: int
    """Number of rounds between two scores."""
    rounds: int
    """Number of resolved rounds."""
    scores: list[float]
    """Scores after 0, `every`, twice `every` … rounds, and the newest score."""


class RunScores(TypedDict):
    """Scores of the games of a run, or a page of them."""

    items: list[Scores]
    """Games that were opened and not voided, in the order of the plan."""
    next_cursor: str | None
    """Cursor of the next page; null on the last page."""
    run: str
    """Id of the run."""


class RunToken(TypedDict):
    """New token of a run."""

    holder: NotRequired[str | None]
    """Name of the holder in the run's team; left out where one player has all seats."""
    id: str
    """Id of the run."""
    swarm_token: str
    """Token for all seats of all games, or for those of the holder, shown only once. The earlier token is revoked."""


class SeatAct(TypedDict):
    """Earlier act of a seat."""

    act: ShownAct
    """Act as it was recorded."""
    prompt: str | None
    """Text for a language model in that round; only if requested."""
    round: int
    """Round of the act."""


class SeatActs(TypedDict):
    """Earlier acts of a seat."""

    acts: list[SeatAct]
    """Acts of the newest resolved rounds in which the seat acted, in ascending order of rounds."""


class SeatHolder(TypedDict):
    """Holder of a seat. All fields but the agent are null while the seat is open."""

    agent: str
    """Name of the agent."""
    claim: int | None
    """Number of the claim; 0 is the creator."""
    claimed_at: str | None
    """Time from which the holder has the seat."""
    holder: str | None
    """Name on the key of the claim, if one was sent; `server` if the server plays. Seats of the creator have none."""
    model: str | None
    """Name of the model that plays."""
    player: str | None
    """Built-in player that the server hosts on this seat."""


class SeatList(TypedDict):
    """Holders of the seats of an episode."""

    open: int
    """Number of unclaimed seats."""
    seats: list[SeatHolder]
    """All seats, in order of the agents' numbers."""


class SeenSeeds(TypedDict):
    """Part of the seeds that an entrant has seen and on which it will play again."""

    games_opened: int
    """Number of games of the attempt that were opened, of `games`."""
    rounds: int
    """Number of rounds that were played in these games together."""
    warning: str
    """Explanation of the consequences, in a sentence."""


class StartedAttempt(TypedDict):
    """New attempt."""

    attempt: int
    """Number of the attempt."""
    closes_at: str
    """Time from which no round begins."""
    entrant: str
    """Id of the entrant."""
    games: int
    """Number of games."""
    on_spare_seeds: bool
    """Whether the attempt is played on spare seeds, in place of a voided one."""
    run: str
    """Id of the attempt's run."""
    swarm_token: str
    """Token of all seats of all games, shown only once: play with it over `/swarm/obs` and `/swarm/act`."""


class StartedPractice(TypedDict):
    """New practice run."""

    closes_at: str
    """Time from which no round begins."""
    entrant: str
    """Id of the entrant."""
    games: int
    """Number of games."""
    run: str
    """Id of the run."""
    seeds: list[int]
    """Seeds of the run."""
    swarm_token: str
    """Token of all seats of all games, shown only once: play with it over `/swarm/obs` and `/swarm/act`."""


class State(TypedDict):
    """Whole world after some round."""

    agents: list[StateAgent]
    """All agents."""
    block: NotRequired[Position | None]
    """Top-left cell of the block's shape (Transport)."""
    distance: NotRequired[float | None]
    """Cost of the placement (Flocking)."""
    grid: list[str]
    """Rows of the map, one character a cell: `.` `W` `B` `P` `F` `N`, agents `A`."""
    prey: NotRequired[Position | None]
    """Position of the prey (Pursuit)."""
    round: int
    """Number of resolved rounds."""
    score: float
    """Score so far."""


class StreamedEvent(TypedDict):
    """Fields of one Server-Sent Event. This type only describes them: a stream writes its events itself."""

    data: str
    """JSON: a `RoundEvent`, or in `finished` the `EpisodeResult`."""
    event: str
    """Kind of the event: `round` or `finished`."""
    id: NotRequired[str | None]
    """Number of resolved rounds; left out in `finished`."""


class StreamedRunEvent(TypedDict):
    """Fields of one Server-Sent Event of a run. This type only describes them: a stream writes its events itself."""

    data: str
    """JSON: a `RunGame`, or in `finished` the `RunDetail`."""
    event: str
    """Kind of the event: `game` or `finished`."""


SuiteList: TypeAlias = Page[SuiteView]
"""Built-in suites."""


class SwarmAct(TypedDict):
    """Act for one of several seats: exactly one of `action` and `response`."""

    action: NotRequired[str | None]
    """Action of the agent: one of the observation's `actions`."""
    agent: str
    """Name of the agent."""
    episode: str
    """Id of the episode."""
    failure: NotRequired[Failure | None]
    """Reason for which the model gave no answer, if only its client knows it: `refusal`, `content_filter`,
    `truncated`, `tool_call`, `reasoning_only` or `rejected`. With `response` only; recorded if the response is
    invalid.
    """
    harness: NotRequired[Harness | None]
    """What the player's program added to the prompt, and keeps for the next one. With `response` only; no other seat
    reads it.
    """
    message: NotRequired[str | None]
    """Message of the agent: one line. A longer message is cut to 120 characters and `...`. With `action` only."""
    reasoning: NotRequired[str | None]
    """Free text, stored for replays."""
    response: NotRequired[str | None]
    """Whole answer of a language model, with `ACTION: …` and/or `MSG: …`."""
    round: int
    """Round that the act answers."""
    to: NotRequired[str | None]
    """Only receiver of a commander's message (centralized control only). With `action` only."""
    usage: NotRequired[Usage | None]
    """Cost of the answer."""


class SwarmActRequest(TypedDict):
    """Acts for several seats, at most 1,024 of at most 256 KiB each."""

    acts: Sequence[SwarmAct]
    """Acts, each accepted or refused independently."""


SwarmReceipt: TypeAlias = Receipt | Problem
"""Result of one of several acts."""


class SwarmActResponse(TypedDict):
    """Results of several acts and, if requested, the next observations of their seats."""

    finished: NotRequired[bool]
    """Whether all episodes of the token have ended, with `wait`."""
    observations: NotRequired[list[Observation]]
    """Next observations, with `wait`: of each seat whose act counts, in the order of the acts. Observations that are
    not available yet are left out.
    """
    problem: NotRequired[Problem]
    """Reason for which the request did not wait or has no observations, with `wait`; left out if nothing failed."""
    receipts: list[SwarmReceipt]
    """Results in the order of the acts."""


class SwarmObsResponse(TypedDict):
    """Observations that wait for an act."""

    cursor: str
    """Cursor for `after`: the next call returns only what was opened since."""
    finished: bool
    """Whether all episodes of the token have ended."""
    observations: list[Observation]
    """Observations, oldest first."""


class Verification(TypedDict):
    """Result of playing a journal again."""

    episode: str
    """Id of the episode."""
    final_digest: NotRequired[str | None]
    """Digest of the newest state."""
    journal_head: str
    """Head of the hash chain."""
    layout_digest: NotRequired[str | None]
    """Digest of the layout."""
    ok: bool
    """Whether all hashes, digests, acts and scores are right."""
    problem: NotRequired[str | None]
    """First fault; left out if there is none."""
    rounds: int
    """Number of rounds that were played again."""
    rules_revision: int
    """Revision of the rules by which the episode was played."""
    score: float
    """Score after these rounds."""
    version: str
    """Version of the program that played the journal again."""


class VoidRequest(TypedDict):
    """Reason for voiding an episode."""

    reason: str
    """Fault that happened: 1 to 500 characters. It is shown to everybody who may see the episode."""


class VoidedAttempt(AttemptSummary):
    """Attempt that was voided."""

    seen: SeenSeeds | None
    """Part of the seeds that the entrant has seen, if it will play again on the same seeds: the competition has no
    spare seeds, or the entrant has used all.
    """


class LeaderboardQuery(TypedDict):
    """Query of `leaderboard` and `leaderboard_csv`."""

    suite: NotRequired[str]
    """Name of the suite; `name@digest` if several suites have that name. `standard` by default."""
    rules: NotRequired[RuleSet]
    """Rule set: `paper` (the default) or `reference`."""
    task: NotRequired[TaskName]
    """Only task to show."""
    sort: NotRequired[str]
    """Value by which rows are ranked: `total` (the default), or the name of a task for the mean of this task."""
    pick: NotRequired[Pick]
    """Run of a player that makes its row: `best` (the default), `last` or `mean`."""
    reference: NotRequired[bool]
    """Whether the rows of the paper are shown; true by default."""
    people: NotRequired[bool]
    """Whether the rows of people are shown; true by default."""
    imported: NotRequired[bool]
    """Whether games that were read from files are shown, too; false by default."""
    metrics: NotRequired[str]
    """Metrics that are shown for each task: names separated by commas, 16 at most."""
    limit: NotRequired[int]
    """Maximum number of rows, up to 1,000; by default 50, and 1,000 for CSV."""
    cursor: NotRequired[str]
    """Cursor: the `next_cursor` of the previous page."""


class CrossPlayQuery(TypedDict):
    """Query of `cross_play` and `cross_play_csv`."""

    task: NotRequired[TaskName]
    """Name of a task; all tasks by default."""
    rules: NotRequired[RuleSet]
    """Rule set: `paper` or `reference`; both by default."""
    limit: NotRequired[int]
    """Maximum number of pairs, up to 1,000; by default 50, and 1,000 for CSV."""
    cursor: NotRequired[str]
    """Cursor: the `next_cursor` of the previous page."""
