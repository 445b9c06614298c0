//! The table `results`, and the other sources of boards.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard};

use futures::TryStreamExt;
use jiff::Timestamp;
use swarmbench_engine::Seed;

use crate::ids::{EntryKey, EpisodeKey, RunKey};
use crate::store::Store;
use crate::store::StoreError;
use crate::store::entries::Entry;
use crate::store::sql::{Builder, Connection, FromRow, SqlRow, get, query};
use crate::store::templates::opening;
use serde::Serialize;
use serde::de::DeserializeOwned;
use swarmbench_journal::Tally;
use swarmbench_journal::record::{ActRecord, RawRecord};

/// Runs, or games of several holders, read by one query.
const CHUNK: i64 = 256;

/// Length of the log of changes. A reader that missed older ones reads everything again.
const CHANGES_MAX: usize = 65_536;

/// Inserts the result of an episode, in the transaction of its end.
pub(in crate::store) async fn add(
    connection: &mut Connection,
    episode: EpisodeKey,
    seed: Seed,
    score: f64,
    rounds: u32,
    tally: Tally,
) -> Result<(), sqlx::Error> {
    let count = |number: u64| i64::try_from(number).unwrap_or(i64::MAX);
    query(
        "INSERT INTO results (episode, task, seed, score, rounds, status, acts, invalid, clock_outs,
                              prompt_tokens, completion_tokens, failures, usage)
         SELECT key, task, CAST($1 AS BIGINT), CAST($2 AS DOUBLE PRECISION), CAST($3 AS BIGINT), status,
                CAST($4 AS BIGINT), CAST($5 AS BIGINT), CAST($6 AS BIGINT), CAST($7 AS BIGINT), CAST($8 AS BIGINT),
                CAST($9 AS TEXT), CAST($10 AS TEXT)
         FROM episodes WHERE key = $11
         ON CONFLICT (episode) DO UPDATE SET
             task = excluded.task, seed = excluded.seed, score = excluded.score, rounds = excluded.rounds,
             status = excluded.status, acts = excluded.acts, invalid = excluded.invalid,
             clock_outs = excluded.clock_outs, prompt_tokens = excluded.prompt_tokens,
             completion_tokens = excluded.completion_tokens, failures = excluded.failures, usage = excluded.usage",
    )
    .bind(i64::from(seed))
    .bind(score)
    .bind(rounds)
    .bind(count(tally.acts))
    .bind(count(tally.invalid))
    .bind(count(tally.timeouts))
    .bind(count(tally.prompt_tokens))
    .bind(count(tally.completion_tokens))
    .bind(json(&tally.failures))
    .bind(json(&tally.usage))
    .bind(episode.0)
    .execute(connection)
    .await?;
    Ok(())
}

/// A commit that may affect a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    Run(RunKey),
    /// The description of an entrant has changed.
    Entrant(EntryKey),
    /// An entrant has started an attempt.
    Started(EntryKey),
    /// All attempts of a competition may be on boards now.
    Revealed,
    /// Games were imported.
    Imports,
    /// A game that counts has ended, or was voided.
    Episode(EpisodeKey),
}

/// The effect of an entry on boards and lists, in the form that other servers of the cluster read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::store) struct Effect {
    pub(in crate::store) kind: i16,
    /// Key of the affected row; 0 if there is none.
    pub(in crate::store) key: i64,
}

impl Effect {
    const LISTED: i16 = 0;
    const ENDED: i16 = 1;
    const VOIDED: i16 = 2;
    const RUN: i16 = 3;
    const ENTRANT: i16 = 4;
    const STARTED: i16 = 5;
    const REVEALED: i16 = 6;
    const IMPORTED: i16 = 7;
    const MEASURED: i16 = 8;
    const ENTERED: i16 = 9;

    pub(in crate::store) fn of(entry: &Entry) -> Option<Self> {
        let (kind, key) = match entry {
            Entry::End(row) if row.counts => (Self::ENDED, row.episode.0),
            Entry::VoidEpisode { episode, .. } => (Self::VOIDED, episode.0),
            Entry::EndRun { run, .. } | Entry::ReopenRun { run } | Entry::VoidRun { run, .. } => {
                (Self::RUN, run.0)
            }
            Entry::SetEntrant { entry, .. }
            | Entry::RenameEntrant { entry, .. }
            | Entry::EraseEntrant { entry, .. } => (Self::ENTRANT, entry.0),
            Entry::DescribeEntrant(facts) => (Self::ENTRANT, facts.entry.0),
            Entry::OpenRun(row) => match row.attempt {
                Some((entry, _)) => (Self::STARTED, entry.0),
                None => (Self::LISTED, 0),
            },
            Entry::Reveal { .. } => (Self::REVEALED, 0),
            Entry::Import { .. } => (Self::IMPORTED, 0),
            Entry::Measured { .. } => (Self::MEASURED, 0),
            Entry::Open(_)
            | Entry::AddCompetition(_)
            | Entry::ChangeCompetition { .. }
            | Entry::CancelCompetition { .. } => (Self::LISTED, 0),
            Entry::AddEntrant(_) => (Self::ENTERED, 0),
            Entry::CheckToken(_)
            | Entry::Start { .. }
            | Entry::BeginForks(_)
            | Entry::Act(_)
            | Entry::Round(_)
            | Entry::End(_)
            | Entry::Claim(_)
            | Entry::Seat(_)
            | Entry::ReplaceTokens { .. }
            | Entry::AddKey(_)
            | Entry::RevokeKey { .. }
            | Entry::ReplaceRunToken { .. }
            | Entry::ReplaceKey { .. }
            | Entry::ExtendAttempts { .. }
            | Entry::AddInvitations { .. }
            | Entry::RevokeInvitations { .. }
            | Entry::Audit(_) => return None,
        };
        Some(Self { kind, key })
    }
}

/// A log of recent changes to boards, and counters of changes.
#[derive(Debug, Default)]
pub struct Changes {
    log: Mutex<Log>,
    /// Counts commits that boards, or lists of competitions, may show.
    revision: AtomicU64,
    /// Counts commits that lists of entrants may show.
    entrants: AtomicU64,
    /// Counts measured games.
    measured: AtomicU64,
    /// Counts voided episodes.
    voided: AtomicU64,
}

/// A position in the log of changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LogPosition(u64);

#[derive(Debug, Default)]
struct Log {
    changes: VecDeque<Change>,
    /// Number of changes before the first one in the log.
    before: u64,
}

impl Log {
    fn end(&self) -> u64 {
        self.before + self.changes.len() as u64
    }
}

impl Changes {
    /// The end of the log. Reads after this call include all changes up to it.
    pub fn position(&self) -> LogPosition {
        LogPosition(self.log().end())
    }

    /// The changes since a position, and the end of the log; `None` if some of them were dropped.
    pub fn since(&self, position: LogPosition) -> (LogPosition, Option<Vec<Change>>) {
        let log = self.log();
        let missed =
            position.0.checked_sub(log.before).and_then(|missed| usize::try_from(missed).ok());
        let changes = missed.map(|missed| log.changes.iter().skip(missed).copied().collect());
        (LogPosition(log.end()), changes)
    }

    /// Changes with every commit that boards, or lists of competitions, may show.
    pub fn revision(&self) -> u64 {
        self.revision.load(Ordering::Acquire)
    }

    /// Changes with every commit that lists of entrants may show.
    pub fn entrants(&self) -> u64 {
        self.entrants.load(Ordering::Acquire)
    }

    /// Changes when the metrics of a game are stored.
    pub fn measured(&self) -> u64 {
        self.measured.load(Ordering::Acquire)
    }

    /// Changes when an episode is voided.
    pub(in crate::store) fn voided(&self) -> u64 {
        self.voided.load(Ordering::Acquire)
    }

    /// Notes committed entries.
    pub(in crate::store) fn note(&self, entries: &[Entry]) {
        entries.iter().filter_map(Effect::of).for_each(|effect| self.apply(effect));
    }

    /// Notes an effect that is durable, committed by this server or another one of the cluster.
    pub(in crate::store) fn apply(&self, effect: Effect) {
        let key = effect.key;
        match effect.kind {
            Effect::MEASURED => {
                self.measured.fetch_add(1, Ordering::AcqRel);
                return;
            }
            Effect::VOIDED => {
                self.voided.fetch_add(1, Ordering::AcqRel);
                self.add(Change::Episode(EpisodeKey(key)));
            }
            Effect::ENDED => self.add(Change::Episode(EpisodeKey(key))),
            Effect::RUN => self.add(Change::Run(RunKey(key))),
            Effect::ENTRANT => {
                self.entrants.fetch_add(1, Ordering::AcqRel);
                self.add(Change::Entrant(EntryKey(key)));
            }
            Effect::ENTERED => {
                self.entrants.fetch_add(1, Ordering::AcqRel);
            }
            Effect::STARTED => self.add(Change::Started(EntryKey(key))),
            Effect::REVEALED => self.add(Change::Revealed),
            Effect::IMPORTED => self.add(Change::Imports),
            // Boards show ended games only; lists show more.
            _ => {}
        }
        // Last, so that a reader of the new revision finds the change in the log.
        self.revision.fetch_add(1, Ordering::AcqRel);
    }

    /// Drops the log after changes were missed, so that readers read everything again.
    pub(in crate::store) fn forget(&self) {
        let mut log = self.log();
        log.before += log.changes.len() as u64 + 1;
        log.changes.clear();
        drop(log);
        self.voided.fetch_add(1, Ordering::AcqRel);
        self.measured.fetch_add(1, Ordering::AcqRel);
        self.entrants.fetch_add(1, Ordering::AcqRel);
        self.revision.fetch_add(1, Ordering::AcqRel);
    }

    fn add(&self, change: Change) {
        let mut log = self.log();
        if log.changes.len() == CHANGES_MAX {
            log.changes.pop_front();
            log.before += 1;
        }
        log.changes.push_back(change);
    }

    fn log(&self) -> MutexGuard<'_, Log> {
        self.log.lock().expect("nothing panics while it holds this")
    }
}

/// The person or team behind a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BoardOwner {
    /// Public id of the key, or of the entry in a competition.
    pub id: String,
    pub name: String,
}

#[derive(Clone, Debug)]
pub struct BoardRun {
    pub run: RunKey,
    pub id: String,
    /// The entrant of the competition, or else the holder of the key.
    pub owner: Option<BoardOwner>,
    /// Whether an organizer vouches for the declaration.
    pub vouched: bool,
    pub suite: String,
    pub digest: String,
    /// The definition of the run, as JSON.
    pub definition: String,
    pub status: String,
    pub created_at: Timestamp,
    /// Ended games in the order of the plan.
    pub games: Vec<BoardGame>,
    /// False while a game is being played, even if the run opens no further games.
    pub is_over: bool,
}

impl BoardRun {
    fn add(&mut self, game: Option<BoardGame>) {
        self.is_over &= game.is_some();
        self.games.extend(game);
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct BoardGame {
    pub task: String,
    pub seed: Seed,
    pub score: f64,
    pub tally: Tally,
    pub voided: bool,
}

/// A finished game with several holders.
#[derive(Clone, Debug)]
pub struct BoardMixed {
    pub episode: EpisodeKey,
    pub opening: RawRecord,
    pub score: f64,
    /// For each holder: model name, whether the name is certain (a hosted player, or vouched for by an organizer), and number
    /// of the key.
    pub models: Vec<(String, bool, Option<i64>)>,
}

/// Runs on boards: ended, not voided, and not an attempt whose competition is still sealed or whose entrant has left.
const ON_BOARDS: &str = "r.ended_at IS NOT NULL AND r.voided_at IS NULL
    AND (r.entry IS NULL OR (c.revealed_at IS NOT NULL AND n.status = 'active'))";

impl Store {
    /// A batch of runs on boards with numbers above `after`, in order; some may not be over. Empty at the end.
    pub async fn runs_on_boards(&self, after: Option<RunKey>) -> Result<Vec<BoardRun>, StoreError> {
        let mut query = select_runs();
        query.push(" AND r.key > ").push_bind(after.map_or(i64::MIN, |run| run.0));
        query.push(" ORDER BY r.key LIMIT ").push_bind(CHUNK);
        let mut runs: Vec<BoardRun> = self.fetch_all(query.build()).await?;
        if let (Some(first), Some(last)) = (runs.first(), runs.last()) {
            let (first, last) = (first.run, last.run);
            let games = self.games(first, last).await?;
            let mut runs = runs.iter_mut().peekable();
            for (run, game) in games {
                while runs.next_if(|place| place.run < run).is_some() {}
                if let Some(place) = runs.peek_mut()
                    && place.run == run
                {
                    place.add(game);
                }
            }
        }
        Ok(runs)
    }

    pub async fn run_on_boards(&self, run: RunKey) -> Result<Option<BoardRun>, StoreError> {
        let mut query = select_runs();
        query.push(" AND r.key = ").push_bind(run.0);
        let found: Option<BoardRun> = self.fetch_optional(query.build()).await?;
        let Some(mut found) = found else { return Ok(None) };
        for (_, game) in self.games(run, run).await? {
            found.add(game);
        }
        Ok(Some(found).filter(|found| found.is_over))
    }

    /// Counts of an episode's acts.
    pub async fn tally_of(&self, episode: EpisodeKey) -> Result<Tally, StoreError> {
        let query = query(
            "SELECT acts, invalid, clock_outs, prompt_tokens, completion_tokens, failures, usage
             FROM results WHERE episode = $1",
        );
        if let Some(tally) = self.fetch_optional(query.bind(episode.0)).await? {
            return Ok(tally);
        }
        // Games that do not count have no row. For a fork, only rounds played in it are counted.
        let mut tally = Tally::default();
        self.each_act(episode, |act| tally.add(&act)).await?;
        Ok(as_stored(tally))
    }

    /// Streams the acts of rounds played in an episode, without their texts.
    async fn each_act(
        &self,
        episode: EpisodeKey,
        mut see: impl FnMut(ActRecord),
    ) -> Result<(), StoreError> {
        let query = query(
            "SELECT coalesce(brief, record) FROM acts
             WHERE episode = $1 AND round >= (SELECT coalesce(fork_round, 0) FROM episodes WHERE key = $1)",
        );
        let mut reading = self.read().await?;
        let mut rows = query.bind(episode.0).fetch(&mut reading);
        while let Some(row) = rows.try_next().await? {
            see(get(&row, 0)?);
        }
        Ok(())
    }

    pub async fn run_of(&self, episode: EpisodeKey) -> Result<Option<RunKey>, StoreError> {
        let query = query("SELECT run FROM episodes WHERE key = $1");
        let run: Option<Option<RunKey>> = self.fetch_optional(query.bind(episode.0)).await?;
        Ok(run.flatten())
    }

    /// Numbers of an entrant's runs, in order.
    pub async fn runs_of_entrant(&self, entry: EntryKey) -> Result<Vec<RunKey>, StoreError> {
        let query = query("SELECT key FROM runs WHERE entry = $1 ORDER BY key");
        self.fetch_all(query.bind(entry.0)).await
    }

    /// The games of the runs `first..=last`, in order; `None` for unfinished games.
    async fn games(
        &self,
        first: RunKey,
        last: RunKey,
    ) -> Result<Vec<(RunKey, Option<BoardGame>)>, StoreError> {
        let query = query(
            "SELECT e.run, s.task, s.seed, s.score, s.acts, s.invalid, s.clock_outs, s.failures,
                    s.prompt_tokens, s.completion_tokens, s.usage,
                    e.key IN (SELECT key FROM episodes WHERE voided_at IS NOT NULL) AS voided
             FROM episodes e INDEXED BY episodes_by_run LEFT JOIN results s ON s.episode = e.key
             WHERE e.run BETWEEN $1 AND $2 ORDER BY e.run, e.slot NULLS FIRST, e.key",
        );
        self.fetch_all(query.bind(first.0).bind(last.0)).await
    }

    /// A batch of public finished games with several holders and numbers above `after`, in order, and the number after which
    /// the next batch begins; `None` at the end.
    pub async fn mixed_games(
        &self,
        after: Option<EpisodeKey>,
    ) -> Result<(Vec<BoardMixed>, Option<EpisodeKey>), StoreError> {
        let query = query(
            "SELECT DISTINCT episode FROM seats WHERE episode > $1 ORDER BY episode LIMIT $2",
        );
        let after = after.map_or(i64::MIN, |episode| episode.0);
        let episodes: Vec<EpisodeKey> = self.fetch_all(query.bind(after).bind(CHUNK)).await?;
        let mut games = Vec::new();
        for &episode in &episodes {
            games.extend(self.mixed_game(episode).await?);
        }
        Ok((games, episodes.last().copied()))
    }

    /// A game with several holders, if it is finished, public and counts.
    pub async fn mixed_game(&self, episode: EpisodeKey) -> Result<Option<BoardMixed>, StoreError> {
        let game = query(concat!(
            "SELECT ",
            opening!(),
            ", r.score FROM results r JOIN episodes e ON e.key = r.episode
             WHERE r.episode = $1 AND r.status = 'finished' AND e.voided_at IS NULL
               AND (e.visibility <> 'sealed' OR e.revealed)"
        ));
        let Some((opening, score)) = self.fetch_optional(game.bind(episode.0)).await? else {
            return Ok(None);
        };
        let query = query(
            "SELECT DISTINCT s.model, coalesce(s.model = 'built-in/' || s.player, FALSE)
                        OR coalesce(k.role = 'organizer', FALSE), s.owner, s.holder
             FROM seats s LEFT JOIN keys k ON k.number = s.owner
             WHERE s.episode = $1 ORDER BY s.holder, s.model",
        );
        let models: Vec<(String, bool, Option<i64>)> =
            self.fetch_all(query.bind(episode.0)).await?;
        Ok((!models.is_empty()).then_some(BoardMixed { episode, opening, score, models }))
    }
}

fn select_runs() -> Builder<'static> {
    let mut query = Builder::new(
        "SELECT r.key, r.id, r.suite, r.digest, r.definition, r.status, r.created_at,
                coalesce(n.id, k.id) AS owner, coalesce(n.name, k.name) AS name,
                coalesce(n.vouched, FALSE) OR coalesce(k.role = 'organizer', FALSE) AS vouched
         FROM runs r LEFT JOIN keys k ON k.number = r.owner LEFT JOIN entries n ON n.key = r.entry
         LEFT JOIN competitions c ON c.key = n.competition WHERE ",
    );
    query.push(ON_BOARDS);
    query
}

impl FromRow for Tally {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            acts: get(row, "acts")?,
            invalid: get(row, "invalid")?,
            failures: counts(row, "failures")?,
            timeouts: get(row, "clock_outs")?,
            prompt_tokens: get(row, "prompt_tokens")?,
            completion_tokens: get(row, "completion_tokens")?,
            usage: counts(row, "usage")?,
        })
    }
}

/// Counts as a row has them, whose columns are signed.
pub(in crate::store) fn as_stored(tally: Tally) -> Tally {
    let most = |number: u64| number.min(i64::MAX.unsigned_abs());
    Tally {
        prompt_tokens: most(tally.prompt_tokens),
        completion_tokens: most(tally.completion_tokens),
        ..tally
    }
}

/// Parses the columns `failures` and `usage`.
fn counts<T: DeserializeOwned>(row: &SqlRow, column: &str) -> Result<T, sqlx::Error> {
    serde_json::from_str(row.text(column)?).map_err(|error| sqlx::Error::Decode(error.into()))
}

/// Value of the columns `failures` and `usage`.
pub(in crate::store) fn json(counts: &impl Serialize) -> String {
    serde_json::to_string(counts).expect("kinds and numbers")
}

impl FromRow for BoardRun {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
        let owner = get::<Option<String>>(row, "owner")?.zip(get(row, "name")?);
        Ok(Self {
            run: get(row, "key")?,
            id: get(row, "id")?,
            owner: owner.map(|(id, name)| BoardOwner { id, name }),
            vouched: get(row, "vouched")?,
            suite: get(row, "suite")?,
            digest: get(row, "digest")?,
            definition: get(row, "definition")?,
            status: get(row, "status")?,
            created_at: get(row, "created_at")?,
            games: Vec::new(),
            is_over: true,
        })
    }
}

impl FromRow for (RunKey, Option<BoardGame>) {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
        let run = get(row, "run")?;
        let Some(task) = get(row, "task")? else { return Ok((run, None)) };
        let game = BoardGame {
            task,
            seed: get(row, "seed")?,
            score: get(row, "score")?,
            tally: Tally::from_row(row)?,
            voided: get(row, "voided")?,
        };
        Ok((run, Some(game)))
    }
}
