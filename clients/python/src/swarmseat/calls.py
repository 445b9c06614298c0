"""The calls of the protocol that follow from its OpenAPI document.

Generated from openapi/openapi.json by `python clients/python/generate.py`: do not edit.
"""

from . import wire
from ._compat import Unpack
from .exchange import Call, call
from .operation import Operation, once


class Calls:
    """The calls; `Operations` adds the others."""

    @Operation
    def obs(
        self, *, after: int | None = None, wait: float | None = None, prompt: bool | None = None
    ) -> Call[wire.Observation]:
        """Get the current observation of the token's agent.

        A look never changes anything and never costs a move.

        Args:
            after: Round for `wait`: wait until the open round is later.
            wait: Maximum number of seconds to wait, up to 60; after that the answer is the current observation.
            prompt: Whether to add the text for a language model.
        """
        return call("GET", "/obs", query={"after": after, "wait": wait, "prompt": prompt})

    @Operation
    def swarm_acts(
        self,
        *,
        episode: str | None = None,
        agent: str | None = None,
        last: int | None = None,
        before: int | None = None,
        prompt: bool | None = None,
    ) -> Call[wire.SeatActs]:
        """Get the acts of one seat in the last resolved rounds, with what its program kept for its next question.

        Only the holder of the seat may read them so, also while the game is sealed. The answer has about 1 MiB:
        `before` with the round of its first act continues to older acts that did not fit.

        Args:
            episode: Id of the episode.
            agent: Name of an agent whose seat the token holds.
            last: Number of resolved rounds, up to 20; 1 by default.
            before: Round before which these rounds are; that which is open by default.
            prompt: Whether to add the texts for a language model.
        """
        return call(
            "GET",
            "/swarm/acts",
            query={"episode": episode, "agent": agent, "last": last, "before": before, "prompt": prompt},
        )

    @Operation
    def swarm_obs(
        self,
        *,
        after: str | None = None,
        wait: float | None = None,
        limit: int | None = None,
        prompt: bool | None = None,
    ) -> Call[wire.SwarmObsResponse]:
        """Get the observations of several seats that wait for an act, oldest first.

        The answer has at least one observation, unless the time is up or all episodes are over. It has at most 8
        MB: it may have fewer observations than `limit`, and its cursor is that of its last one.

        Args:
            after: Cursor of an earlier answer: return only what was opened since.
            wait: Seconds to wait for at least one observation, up to 60.
            limit: Maximum number of observations, up to 1,024; 256 by default.
            prompt: Whether to add the texts for a language model.
        """
        return call("GET", "/swarm/obs", query={"after": after, "wait": wait, "limit": limit, "prompt": prompt})

    @Operation
    def create_episode(
        self, *, idempotency_key: str | None = None, **settings: Unpack[wire.EpisodeRequest]
    ) -> Call[wire.CreatedEpisode]:
        """Create an episode.

        The tokens are shown only once. A repeat with the same `Idempotency-Key` and body returns the same episode
        with new tokens and revokes the earlier ones.

        Args:
            idempotency_key: Any text of at most 200 characters that names this creation
            **settings: Fields of `wire.EpisodeRequest`.
        """
        return call("POST", "/api/v1/episodes", body=settings, headers=once(idempotency_key))

    @Operation
    def fork(
        self, id: str, *, idempotency_key: str | None = None, **settings: Unpack[wire.ForkRequest]
    ) -> Call[wire.CreatedForks]:
        """Fork an episode: play on from one of its rounds.

        The request makes one or several new episodes that begin with the state of this one before round `round`,
        all or none. Whoever may create episodes and may read the journal now may fork; sealed games can be forked
        after the reveal, games of several holders after their end. The journal of a fork has the acts of the
        rounds before, without the answers of models. Forks never count on boards. The tokens are shown only once.
        A repeat with the same `Idempotency-Key` and body returns the same forks with new tokens and revokes the
        earlier ones.

        Args:
            id: The id of the episode that is continued
            idempotency_key: Any text of at most 200 characters that names this creation
            **settings: Fields of `wire.ForkRequest`.
        """
        return call("POST", "/api/v1/episodes/{}/fork", id, body=settings, headers=once(idempotency_key))

    @Operation
    def episode(self, id: str) -> Call[wire.EpisodeSummary]:
        """Show an episode.

        Args:
            id: The episode's id
        """
        return call("GET", "/api/v1/episodes/{}", id)

    @Operation
    def episodes(
        self,
        *,
        status: wire.StatusName | None = None,
        task: wire.TaskName | None = None,
        model: str | None = None,
        run: str | None = None,
        fork_of: str | None = None,
        people: str | None = None,
        sort: str | None = None,
        curves: str | None = None,
        limit: int | None = None,
        cursor: str | None = None,
    ) -> Call[wire.EpisodeList]:
        """List episodes, newest first by default.

        Episodes that the caller may not read before their end are listed after it. A page of a sorted list may be
        short, even empty, although `next_cursor` names another one: the server looks at a limited number of
        episodes for each.

        Args:
            status: Status: `waiting`, `running`, `finished`, `aborted` or `abandoned`.
            task: Name of a task.
            model: Name of a model.
            run: Id of a run.
            fork_of: Id of an episode: only its forks are listed.
            people: `true`: only episodes in which people take part and that anyone may read.
            sort: Order: `newest` (by default), `oldest`, `score` (highest first), `rounds` (most first) or `seed`
                (lowest first); `-score`, `-rounds` and `-seed` turn these around, and list only ended episodes
                that anyone may read.
            curves: `true`: ended episodes have their `curve`; a sealed one once its competition is revealed.
            limit: Maximum number of items, up to 1,000; 50 by default.
            cursor: Cursor: the `next_cursor` of the previous page.
        """
        return call(
            "GET",
            "/api/v1/episodes",
            query={
                "status": status,
                "task": task,
                "model": model,
                "run": run,
                "fork_of": fork_of,
                "people": people,
                "sort": sort,
                "curves": curves,
                "limit": limit,
                "cursor": cursor,
            },
        )

    @Operation
    def start_episode(self, id: str) -> Call[wire.EpisodeSummary]:
        """Start an episode that was created with `"start": "manual"`.

        Starting a running episode changes nothing.

        Args:
            id: The episode's id
        """
        return call("POST", "/api/v1/episodes/{}/start", id)

    @Operation
    def abort_episode(self, id: str) -> Call[wire.EpisodeSummary]:
        """Abort an episode; the journal keeps the rounds that were played.

        Aborting an aborted episode changes nothing.

        Args:
            id: The episode's id
        """
        return call("DELETE", "/api/v1/episodes/{}", id)

    @Operation
    def claim_seats(
        self, id: str, *, idempotency_key: str | None = None, **settings: Unpack[wire.ClaimRequest]
    ) -> Call[wire.CreatedClaim]:
        """Claim open seats of an episode.

        The tokens are shown only once, and are valid for these seats alone. A repeat with the same
        `Idempotency-Key` and body returns the same seats with new tokens and revokes the earlier ones. The claim
        of the last open seat starts the episode, unless its creator wants to start it.

        Args:
            id: The episode's id
            idempotency_key: Any text of at most 200 characters that names this claim
            **settings: Fields of `wire.ClaimRequest`.
        """
        return call("POST", "/api/v1/episodes/{}/claims", id, body=settings, headers=once(idempotency_key))

    @Operation
    def seats(self, id: str) -> Call[wire.SeatList]:
        """List the seats of an episode with their holders.

        Args:
            id: The episode's id
        """
        return call("GET", "/api/v1/episodes/{}/claims", id)

    @Operation
    def state(self, id: str, *, round: int | None = None) -> Call[wire.State]:
        """Show the whole world after any round.

        Args:
            id: The episode's id
            round: Number of rounds that led to the state; the current state by default.
        """
        return call("GET", "/api/v1/episodes/{}/state", id, query={"round": round})

    @Operation
    def journal(self, id: str) -> Call[bytes]:
        """Read an episode's journal (JSON Lines).

        The journal has the opening (configuration, rules revision, prompt template), then every resolved round
        with its acts and the digest of the state after it, and finally the end. Each line has the head of the
        hash chain after it. `swarmbench verify FILE` replays and checks the journal.

        Args:
            id: The episode's id
        """
        return call("GET", "/api/v1/episodes/{}/journal", id, read=bytes)

    @Operation
    def metrics(
        self,
        id: str,
        *,
        definition: wire.Definition | None = None,
        series: bool | None = None,
        from_: int | None = None,
        states: int | None = None,
    ) -> Call[wire.GameMetrics]:
        """Show the metrics of an episode.

        Metrics are whole numbers and means that describe how the swarm spoke, chose and moved
        (`docs/evaluate/metrics.md`). A running episode has those of its rounds so far.

        Args:
            id: The episode's id
            definition: Definition: `paper` (the default) or `toolkit`.
            series: Whether to add the values of states to those of the game.
            from_: First state of the series; by default 0, the layout.
            states: Number of states of the series, up to 1,000, which is also the default.
        """
        return call(
            "GET",
            "/api/v1/episodes/{}/metrics",
            id,
            query={"definition": definition, "series": series, "from": from_, "states": states},
        )

    @Operation
    def worth(self, id: str, *, seats: bool | None = None) -> Call[wire.GameWorth]:
        """Show what could still be scored in an episode.

        The worth of a state is the score that the reference swarm, the task's default built-in player, reaches
        from there: that of a fork with `"player": "default"` (`docs/evaluate/worth.md`). The answer has the worth
        of each state, what each round and each seat lost, and the ten decisions that lost most. A worth of a game
        that has ended is stored.

        Callers who may fork the episode may read it: it is computed from random draws that are still to come.

        Args:
            id: The episode's id
            seats: Whether to add the losses of seats, the default. Without them the answer is there about as many
                times sooner as there are seats.
        """
        return call("GET", "/api/v1/episodes/{}/worth", id, query={"seats": seats})

    @Operation
    def line(self, id: str, *, round: int | None = None, rounds: int | None = None) -> Call[wire.ReferenceLine]:
        """Show how the reference would play on.

        The rounds that a fork with `"player": "default"` would begin with, without making one. Callers who may
        fork the episode may read them.

        Args:
            id: The episode's id
            round: Round from whose state the reference plays on; by default that of the newest state.
            rounds: Number of rounds, up to 100; by default 10.
        """
        return call("GET", "/api/v1/episodes/{}/line", id, query={"round": round, "rounds": rounds})

    @Operation
    def replay(
        self, id: str, *, from_: int | None = None, rounds: int | None = None, ground: bool | None = None
    ) -> Call[wire.Replay]:
        """Read the states of an episode, a page of rounds at a time.

        A page has positions, decisions, messages with their readers, and metrics of each round. While several
        holders play, decisions are left out. Pages overlap by one state; the open round is never shown.

        Args:
            id: The episode's id
            from_: First state; by default 0, the layout.
            rounds: Number of rounds after it, up to 100, which is also the default. Pages of games of many agents
                have fewer.
            ground: Whether to add the cells that never change; true by default.
        """
        return call("GET", "/api/v1/episodes/{}/replay", id, query={"from": from_, "rounds": rounds, "ground": ground})

    @Operation
    def agent_round(self, id: str, round: int, agent: str) -> Call[wire.AgentRound]:
        """Show the knowledge of an agent in a round, and its act.

        The answer has its observation, the messages that it read with their senders, the text for a language
        model, and its act with the answer and the reasons. Whoever may read the journal may read this.

        Args:
            id: The episode's id
            round: The round that the observation answers: 0 up to the number of resolved rounds
            agent: The agent's name
        """
        return call("GET", "/api/v1/episodes/{}/rounds/{}/agents/{}", id, str(round), agent)

    @Operation
    def scores(self, id: str, *, points: int | None = None) -> Call[wire.Scores]:
        """Show the score of an episode in equal steps of rounds.

        Args:
            id: The episode's id
            points: Maximum number of scores besides the first and the newest, up to 1,000; 200 by default.
        """
        return call("GET", "/api/v1/episodes/{}/scores", id, query={"points": points})

    @Operation
    def verification(self, id: str) -> Call[wire.Verification]:
        """Verify an episode: the server plays its journal again.

        The server checks every hash, digest, act and score; before the end, those of the resolved rounds. It
        verifies each head of the hash chain once. Whoever may read the journal may request it; `swarmbench
        verify` does the same with a file.

        Args:
            id: The episode's id
        """
        return call("GET", "/api/v1/episodes/{}/verification", id)

    @Operation
    def suites(self) -> Call[wire.SuiteList]:
        """Show the built-in suites in full, by each rule set."""
        return call("GET", "/api/v1/suites")

    @Operation
    def create_run(
        self, *, idempotency_key: str | None = None, **settings: Unpack[wire.RunRequest]
    ) -> Call[wire.CreatedRun]:
        """Start a run: a suite of games for one model, or for a team of several.

        The answer has one token for all seats of all games, or one for each holder of a team, shown only once.
        Games are opened in the order of the plan as others end. A repeat with the same `Idempotency-Key` and body
        returns the same run with a new token and revokes the earlier one.

        Args:
            idempotency_key: Any text of at most 200 characters that names this creation
            **settings: Fields of `wire.RunRequest`.
        """
        return call("POST", "/api/v1/runs", body=settings, headers=once(idempotency_key))

    @Operation
    def run(self, id: str) -> Call[wire.RunDetail]:
        """Show a run, its results and its games.

        Args:
            id: The run's id
        """
        return call("GET", "/api/v1/runs/{}", id)

    @Operation
    def runs(
        self,
        *,
        status: str | None = None,
        model: str | None = None,
        suite: str | None = None,
        limit: int | None = None,
        cursor: str | None = None,
    ) -> Call[wire.RunList]:
        """List runs, newest first.

        Runs that the caller may not see before their end are listed after it.

        Args:
            status: Status: `running`, `finished`, `aborted`, `abandoned` or `closed`.
            model: Name of a model.
            suite: Name of a suite.
            limit: Maximum number of items, up to 1,000; 50 by default.
            cursor: Cursor: the `next_cursor` of the previous page.
        """
        return call(
            "GET",
            "/api/v1/runs",
            query={"status": status, "model": model, "suite": suite, "limit": limit, "cursor": cursor},
        )

    @Operation
    def abort_run(self, id: str) -> Call[wire.RunDetail]:
        """Abort a run and its open games; games that were played stay, and count.

        Aborting an aborted run changes nothing.

        Args:
            id: The run's id
        """
        return call("DELETE", "/api/v1/runs/{}", id)

    @Operation
    def renew_run_token(self, id: str, *, holder: str | None = None) -> Call[wire.RunToken]:
        """Get a new token for a run, in place of a lost one.

        The earlier token is revoked; in a team, that of the holder. The games continue.

        Args:
            id: The run's id
            holder: Name of the holder in the run's team; only for a run with `holders`.
        """
        return call("POST", "/api/v1/runs/{}/token", id, query={"holder": holder})

    @Operation
    def run_metrics(
        self, id: str, *, definition: wire.Definition | None = None, limit: int | None = None, cursor: str | None = None
    ) -> Call[wire.RunMetrics]:
        """Show the metrics of the games of a run.

        The page has the games that have ended and were not voided, with means by task over its games.

        Args:
            id: The run's id
            definition: Definition: `paper` (the default) or `toolkit`.
            limit: Maximum number of games, up to 200; 50 by default.
            cursor: Cursor: the `next_cursor` of the previous page.
        """
        return call(
            "GET", "/api/v1/runs/{}/metrics", id, query={"definition": definition, "limit": limit, "cursor": cursor}
        )

    @Operation
    def run_scores(
        self, id: str, *, points: int | None = None, limit: int | None = None, cursor: str | None = None
    ) -> Call[wire.RunScores]:
        """Show the scores of the games of a run in equal steps of rounds.

        The page has the games that were opened and not voided, running ones too, as far as the caller may read
        them.

        Args:
            id: The run's id
            points: Maximum number of scores of a game besides the first and the newest, up to 1,000; 50 by
                default.
            limit: Maximum number of games, up to 200; 50 by default.
            cursor: Cursor: the `next_cursor` of the previous page.
        """
        return call("GET", "/api/v1/runs/{}/scores", id, query={"points": points, "limit": limit, "cursor": cursor})

    @Operation
    def leaderboard(self, **query: Unpack[wire.LeaderboardQuery]) -> Call[wire.Leaderboard]:
        """Show the leaderboard of a suite.

        The board has a row for each player: owner, model, temperature, `top_p` and prompt template, as declared.
        Runs that are over count, also those that ended early; planned games that were not played count as 0.
        `docs/evaluate/boards.md` defines all values. All pages except the last name the next one in `next_cursor`
        and in the header `X-Next-Cursor`.

        Args:
            **query: Fields of `wire.LeaderboardQuery`.
        """
        return call("GET", "/api/v1/leaderboard", query={**query, "format": "json"})

    @Operation
    def leaderboard_csv(self, **query: Unpack[wire.LeaderboardQuery]) -> Call[str]:
        """Show the leaderboard of a suite.

        The board has a row for each player: owner, model, temperature, `top_p` and prompt template, as declared.
        Runs that are over count, also those that ended early; planned games that were not played count as 0.
        `docs/evaluate/boards.md` defines all values. All pages except the last name the next one in `next_cursor`
        and in the header `X-Next-Cursor`.

        Args:
            **query: Fields of `wire.LeaderboardQuery`.
        """
        return call("GET", "/api/v1/leaderboard", query={**query, "format": "csv"}, read=bytes.decode)

    @Operation
    def cross_play(self, **query: Unpack[wire.CrossPlayQuery]) -> Call[wire.CrossPlay]:
        """Show the scores of pairs of models that played together.

        The models had seats of the same episode, as different holders. Each pair covers all its finished episodes
        of equal settings. All pages except the last name the next one in `next_cursor` and in the header
        `X-Next-Cursor`.

        Args:
            **query: Fields of `wire.CrossPlayQuery`.
        """
        return call("GET", "/api/v1/cross-play", query={**query, "format": "json"})

    @Operation
    def cross_play_csv(self, **query: Unpack[wire.CrossPlayQuery]) -> Call[str]:
        """Show the scores of pairs of models that played together.

        The models had seats of the same episode, as different holders. Each pair covers all its finished episodes
        of equal settings. All pages except the last name the next one in `next_cursor` and in the header
        `X-Next-Cursor`.

        Args:
            **query: Fields of `wire.CrossPlayQuery`.
        """
        return call("GET", "/api/v1/cross-play", query={**query, "format": "csv"}, read=bytes.decode)

    @Operation
    def health(self) -> Call[wire.Health]:
        """Check that the process is alive."""
        return call("GET", "/healthz")

    @Operation
    def ready(self) -> Call[wire.Health]:
        """Check whether the server can be used.

        The server can be used while the database answers, its files are where they were, no commit has failed or
        waits for long, the time of day is certain, a server of a cluster has its lease, and the episodes that
        were running before a restart run again, except those that take long to replay. Otherwise the detail names
        every problem.
        """
        return call("GET", "/readyz")
