//! The one task that writes: it takes everything that is queued into one transaction.
//!
//! Under load a commit carries what came in while the one before was on its way to the disk, so the
//! cost of a commit is shared. Three things can go wrong, and each costs as little as it can:
//!
//! - A statement is refused, by a constraint say. The transaction is rolled back and its jobs are
//!   written again, each behind a savepoint: that job alone gets an error, the others are committed.
//!   Nothing was acknowledged yet, so this is safe, and a group without such a job costs nothing more.
//! - Another program holds the lock of the database. Beginning is tried again for [`BEGIN_PATIENCE`].
//! - The disk fails, or a commit. Nothing is acknowledged any more, as nobody can know what the disk
//!   still holds of it: the writer refuses everything until the server is restarted.
//!
//! The records of an episode are a chain. After one of its jobs was refused, all later ones would
//! leave a gap in the chain, so they are refused, too, until the episode was recovered from what is
//! on the disk ([`WriterState::recovered`]).

use std::collections::HashSet;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex as StdMutex, MutexGuard as StdMutexGuard};
use std::time::{Duration, Instant};

use sqlx::sqlite::SqliteConnection;
use sqlx::{Connection, QueryBuilder, Sqlite};
use tokio::sync::{Mutex, mpsc};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::competitions;
use super::files::Files;
use super::results::Changes;
use super::rows::{Insert, chunks};
use super::templates::Cut;
use super::{Stopped, StoreError};
use crate::ids::EpisodeKey;
use crate::keys::KeyRow;
use crate::store::entries::{ActRow, EndRow, Entry, OpeningRow, RoundRow, TokenRow};
use crate::store::port::Committed;
use crate::telemetry;
use swarmbench_journal::record::{RawRecord, Source};

/// Jobs that one transaction takes at most, so that the first does not wait for ever.
const GROUP_MAX: usize = 1024;

/// How long SQLite itself waits for the lock of the database before it says that it is busy.
const BUSY_TIMEOUT: Duration = Duration::from_secs(1);

/// How long beginning is tried again in all for the jobs of a transaction, while another program holds the lock.
const BEGIN_PATIENCE: Duration = Duration::from_mins(1);

/// The first and the longest pause between two tries.
const BEGIN_PAUSES: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(1));

/// Primary result codes of SQLite after which the state of the file or of the transaction is not
/// known: `NOMEM`, `READONLY`, `IOERR`, `CORRUPT`, `FULL`, `CANTOPEN`, `PROTOCOL`, `MISUSE` and `NOTADB`.
const FATAL_CODES: [u32; 9] = [7, 8, 10, 11, 13, 14, 15, 21, 26];

/// `BUSY` and `LOCKED`.
const BUSY_CODES: [u32; 2] = [5, 6];

/// Entries that are written together or not at all, and the callback for the outcome.
struct Job {
    entries: Vec<Entry>,
    bytes: usize,
    committed: Committed,
}

type Outcome = Result<(), StoreError>;

/// The state of the writer, shared with readers.
#[derive(Debug, Default)]
pub struct WriterState {
    failed: CancellationToken,
    locked_out: AtomicBool,
    backlog_jobs: AtomicUsize,
    backlog_bytes: AtomicUsize,
    changes: Changes,
    /// Episodes of which a job was refused and that were not recovered since.
    broken: StdMutex<HashSet<EpisodeKey>>,
}

impl WriterState {
    /// Whether a commit failed: nothing is stored any more.
    pub fn has_failed(&self) -> bool {
        self.failed.is_cancelled()
    }

    /// Cancelled when a commit fails.
    pub fn failed(&self) -> &CancellationToken {
        &self.failed
    }

    /// Whether another program has held the lock of the database for a while: nothing can be written.
    pub fn is_locked_out(&self) -> bool {
        self.locked_out.load(Ordering::Acquire)
    }

    /// What boards have to read again.
    pub fn changes(&self) -> &Changes {
        &self.changes
    }

    pub fn backlog_jobs(&self) -> usize {
        self.backlog_jobs.load(Ordering::Relaxed)
    }

    /// How many bytes the queued jobs take.
    pub fn backlog_bytes(&self) -> usize {
        self.backlog_bytes.load(Ordering::Relaxed)
    }

    /// Accepts jobs of an episode again. To be called when its old actor has ended, all that it handed
    /// over was answered, and before anybody continues with what is on the disk.
    pub fn recovered(&self, episode: EpisodeKey) {
        self.broken().remove(&episode);
    }

    fn broken(&self) -> StdMutexGuard<'_, HashSet<EpisodeKey>> {
        self.broken.lock().expect("nothing panics while it holds this")
    }

    /// Whether a job continues the chain of an episode whose chain has a gap.
    fn continues_broken(&self, entries: &[Entry]) -> bool {
        let broken = self.broken();
        !broken.is_empty()
            && entries.iter().filter_map(Entry::chain).any(|episode| broken.contains(&episode))
    }

    fn note_refused(&self, entries: &[Entry]) {
        // Nothing comes after an opening before it was kept.
        let opens = entries.iter().any(|entry| matches!(entry, Entry::Open(_)));
        if !opens {
            self.broken().extend(entries.iter().filter_map(Entry::chain));
        }
    }

    fn add_backlog(&self, bytes: usize) {
        self.backlog_jobs.fetch_add(1, Ordering::Relaxed);
        self.backlog_bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    fn remove_backlog(&self, bytes: usize) {
        self.backlog_jobs.fetch_sub(1, Ordering::Relaxed);
        self.backlog_bytes.fetch_sub(bytes, Ordering::Relaxed);
    }

    fn fail(&self, error: &dyn std::fmt::Display) {
        if !self.has_failed() {
            self.failed.cancel();
            metrics::counter!("swarmbench_commit_failures_total").increment(1);
            tracing::error!(%error, "a commit failed: nothing is acknowledged until a restart");
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Writer {
    queue: mpsc::UnboundedSender<Job>,
    state: Arc<WriterState>,
    stop: CancellationToken,
    task: Arc<Mutex<Option<JoinHandle<()>>>>,
}

impl Writer {
    pub(super) fn spawn(connection: SqliteConnection, files: Files) -> Self {
        let (queue, jobs) = mpsc::unbounded_channel();
        let state = Arc::new(WriterState::default());
        let stop = CancellationToken::new();
        let task = tokio::spawn(run(connection, files, jobs, Arc::clone(&state), stop.clone()));
        Self { queue, state, stop, task: Arc::new(Mutex::new(Some(task))) }
    }

    /// A writer that refuses everything.
    pub(super) fn none() -> Self {
        let (queue, _) = mpsc::unbounded_channel();
        let (state, stop) = (Arc::default(), CancellationToken::new());
        Self { queue, state, stop, task: Arc::default() }
    }

    pub(super) fn state(&self) -> &WriterState {
        &self.state
    }

    pub(super) fn append(&self, entries: Vec<Entry>, committed: Committed) {
        let bytes = entries.iter().map(Entry::bytes).sum();
        self.state.add_backlog(bytes);
        if let Err(mpsc::error::SendError(job)) = self.queue.send(Job { entries, bytes, committed })
        {
            self.state.remove_backlog(bytes);
            (job.committed)(Err(StoreError::Stopped(Stopped::Server)));
        }
    }

    /// Commits what is queued and ends.
    pub(super) async fn stop(&self) {
        self.stop.cancel();
        if let Some(task) = self.task.lock().await.take() {
            // A panic of the writer was logged where it happened.
            drop(task.await);
        }
    }
}

async fn run(
    mut connection: SqliteConnection,
    files: Files,
    mut queue: mpsc::UnboundedReceiver<Job>,
    state: Arc<WriterState>,
    stop: CancellationToken,
) {
    let busy_timeout = format!("PRAGMA busy_timeout = {}", BUSY_TIMEOUT.as_millis());
    if let Err(error) =
        sqlx::query(sqlx::AssertSqlSafe(busy_timeout)).execute(&mut connection).await
    {
        tracing::warn!(%error, "a locked database is noticed late");
    }
    let mut jobs = Vec::with_capacity(GROUP_MAX);
    loop {
        let taken = tokio::select! {
            biased;
            taken = queue.recv_many(&mut jobs, GROUP_MAX) => taken,
            () = stop.cancelled() => {
                queue.close();
                queue.recv_many(&mut jobs, GROUP_MAX).await
            }
        };
        if taken == 0 {
            break;
        }
        let (jobs, receipts): (Vec<_>, Vec<_>) =
            jobs.drain(..).map(|job| (job.entries, (job.bytes, job.committed))).unzip();
        let outcomes = {
            let deadline = Instant::now() + BEGIN_PATIENCE;
            keep(&mut connection, &files, &state, &jobs, deadline).await
        };
        for (entries, outcome) in jobs.iter().zip(&outcomes) {
            if outcome.is_ok() {
                // Before the senders are notified: a client that knows of an end finds it on the board.
                state.changes.note(entries);
            }
        }
        for ((bytes, committed), outcome) in receipts.into_iter().zip(outcomes) {
            state.remove_backlog(bytes);
            committed(outcome);
        }
    }
    if let Err(error) = connection.close().await {
        tracing::warn!(%error, "the database was not closed cleanly");
    }
}

/// Writes jobs in one transaction, which begins by the deadline; the outcome of each, in their order.
async fn keep(
    connection: &mut SqliteConnection,
    files: &Files,
    state: &WriterState,
    jobs: &[Vec<Entry>],
    deadline: Instant,
) -> Vec<Outcome> {
    let all = |outcome: &Outcome| jobs.iter().map(|_| outcome.clone()).collect();
    if state.has_failed() {
        return all(&Err(StoreError::Failed));
    }
    let kept = if jobs.iter().any(|job| state.continues_broken(job)) {
        commit_each(connection, state, jobs, deadline).await
    } else {
        match commit_all(connection, state, jobs, deadline).await {
            Err(Failure::Refused(_)) => commit_each(connection, state, jobs, deadline).await,
            committed => committed.map(|()| all(&Ok(()))),
        }
    };
    // What went into a file that was removed is not kept, whatever SQLite says.
    let kept = kept.and_then(|outcomes| match files.check() {
        Ok(()) => Ok(outcomes),
        Err(lost) => Err(Failure::Fatal(sqlx::Error::Io(std::io::Error::other(lost)))),
    });
    match kept {
        Ok(outcomes) => outcomes,
        Err(Failure::Fatal(error)) => {
            state.fail(&error);
            all(&Err(error.into()))
        }
        // Nothing was written: all senders get the error, and may send again.
        Err(Failure::Refused(error)) => {
            let error = StoreError::from(error);
            jobs.iter().map(|job| refuse(state, job, error.clone())).collect()
        }
    }
}

/// Why a transaction, or a part of it, was not written.
enum Failure {
    /// What the file holds, or will hold, is not known.
    Fatal(sqlx::Error),
    /// A statement was refused; the transaction can be rolled back.
    Refused(sqlx::Error),
}

impl Failure {
    fn of(error: sqlx::Error) -> Self {
        let is_refusal = match &error {
            sqlx::Error::Database(_) => !has_code(&error, &FATAL_CODES),
            sqlx::Error::Encode(_) | sqlx::Error::Decode(_) => true,
            _ => false,
        };
        if is_refusal { Self::Refused(error) } else { Self::Fatal(error) }
    }
}

/// Whether SQLite gave one of these primary result codes; the code that is given may be an extended one.
fn has_code(error: &sqlx::Error, codes: &[u32]) -> bool {
    let code = error.as_database_error().and_then(|error| error.code()?.parse::<u32>().ok());
    code.is_some_and(|code| codes.contains(&(code & 0xff)))
}

/// Writes all entries of all jobs, or nothing where a statement is refused.
async fn commit_all(
    connection: &mut SqliteConnection,
    state: &WriterState,
    jobs: &[Vec<Entry>],
    deadline: Instant,
) -> Result<(), Failure> {
    let started = Instant::now();
    let entries = || jobs.iter().flatten();
    let count = entries().count();
    if count == 0 {
        // A barrier: what was queued before is durable by now.
        return Ok(());
    }
    begin(connection, state, deadline).await?;
    if let Err(error) = write(connection, entries()).await {
        return Err(roll_back(connection, Failure::of(error)).await);
    }
    commit(connection, count, started).await
}

/// Writes jobs one by one: those that are refused leave no trace, and the others are committed.
async fn commit_each(
    connection: &mut SqliteConnection,
    state: &WriterState,
    jobs: &[Vec<Entry>],
    deadline: Instant,
) -> Result<Vec<Outcome>, Failure> {
    let started = Instant::now();
    begin(connection, state, deadline).await?;
    let mut outcomes = Vec::with_capacity(jobs.len());
    for job in jobs {
        if state.continues_broken(job) {
            outcomes.push(refuse(state, job, StoreError::Gap));
            continue;
        }
        match write_one(connection, job).await {
            Ok(()) => outcomes.push(Ok(())),
            Err(Failure::Refused(error)) => {
                metrics::counter!("swarmbench_jobs_refused_total").increment(1);
                tracing::error!(%error, "the database rejected an entry: it is not stored, all others are");
                outcomes.push(refuse(state, job, error.into()));
            }
            Err(fatal) => return Err(roll_back(connection, fatal).await),
        }
    }
    let count = jobs.iter().map(Vec::len).sum();
    commit(connection, count, started).await?;
    Ok(outcomes)
}

fn refuse(state: &WriterState, job: &[Entry], error: StoreError) -> Outcome {
    state.note_refused(job);
    if job.is_empty() { Ok(()) } else { Err(error) }
}

/// Writes the entries of one job behind a savepoint.
async fn write_one(connection: &mut SqliteConnection, entries: &[Entry]) -> Result<(), Failure> {
    execute(connection, "SAVEPOINT job").await?;
    let written = write(connection, entries.iter()).await.map_err(Failure::of);
    if let Err(Failure::Refused(_)) = written {
        execute(connection, "ROLLBACK TO job").await?;
    }
    execute(connection, "RELEASE job").await?;
    written
}

/// Runs a statement that the transaction needs.
async fn execute(
    connection: &mut SqliteConnection,
    statement: &'static str,
) -> Result<(), Failure> {
    sqlx::query(statement).execute(connection).await.map(|_| ()).map_err(Failure::Fatal)
}

/// Begins a transaction; tries again by the deadline where another program holds the lock.
async fn begin(
    connection: &mut SqliteConnection,
    state: &WriterState,
    deadline: Instant,
) -> Result<(), Failure> {
    let started = Instant::now();
    let (mut pause, longest) = BEGIN_PAUSES;
    let begun = loop {
        let Err(error) = sqlx::query("BEGIN IMMEDIATE").execute(&mut *connection).await else {
            break Ok(());
        };
        if !has_code(&error, &BUSY_CODES) {
            break Err(Failure::of(error));
        }
        metrics::counter!("swarmbench_begin_retries_total").increment(1);
        if !state.locked_out.swap(true, Ordering::AcqRel) {
            tracing::warn!(%error, "another program has locked the database: nothing can be written");
        }
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            break Err(Failure::Refused(error));
        }
        tokio::time::sleep(pause.min(left)).await;
        pause = (pause * 2).min(longest);
    };
    if begun.is_ok() && state.locked_out.swap(false, Ordering::AcqRel) {
        tracing::info!(
            waited_ms = swarmbench_clock::millis(started.elapsed()),
            "writing continues"
        );
    }
    begun
}

/// Ends a transaction of which nothing is to stay.
async fn roll_back(connection: &mut SqliteConnection, failure: Failure) -> Failure {
    match execute(connection, "ROLLBACK").await {
        Ok(()) => failure,
        // SQLite has rolled back by itself, or cannot: nothing is written any more.
        Err(fatal) => match failure {
            Failure::Fatal(_) => failure,
            Failure::Refused(_) => fatal,
        },
    }
}

async fn commit(
    connection: &mut SqliteConnection,
    entries: usize,
    started: Instant,
) -> Result<(), Failure> {
    if let Err(fatal) = execute(connection, "COMMIT").await {
        return Err(roll_back(connection, fatal).await);
    }
    let frequent = telemetry::frequent();
    frequent.commits.increment(1);
    frequent.commit_seconds.record(started.elapsed());
    frequent.commit_entries.increment(entries as u64);
    Ok(())
}

/// Writes entries into the open transaction.
async fn write(
    connection: &mut SqliteConnection,
    entries: impl Iterator<Item = &Entry>,
) -> Result<(), sqlx::Error> {
    let mut acts = Vec::new();
    let mut rounds = Vec::new();
    for entry in entries {
        match entry {
            Entry::Open(row) => open(connection, row).await?,
            Entry::BeginForks(episodes) => super::forks::begin(connection, episodes).await?,
            Entry::Start { episode, at } => start(connection, *episode, *at).await?,
            Entry::Act(row) => acts.push(row),
            Entry::Round(row) => rounds.push(row),
            Entry::End(row) => end(connection, row).await?,
            Entry::Claim(row) => {
                super::seats::claim(connection, row).await?;
                insert_tokens(connection, row.episode, &row.tokens).await?;
            }
            Entry::Seat(row) => super::seats::seat(connection, row).await?,
            Entry::ReplaceTokens { episode, holder, tokens } => {
                sqlx::query(
                    "DELETE FROM tokens WHERE episode = ? AND holder IS NOT DISTINCT FROM ?",
                )
                .bind(episode.0)
                .bind(holder)
                .execute(&mut *connection)
                .await?;
                insert_tokens(connection, *episode, tokens).await?;
            }
            Entry::AddKey(row) => add_key(connection, row).await?,
            Entry::RevokeKey { id, at } => revoke_key(connection, id, *at).await?,
            Entry::Import { game, at } => super::imports::keep(connection, game, *at).await?,
            Entry::OpenRun(row) => super::runs::open(connection, row).await?,
            Entry::EndRun { run, status, at } => {
                super::runs::end(connection, *run, status, *at).await?;
            }
            Entry::ReplaceRunToken { run, hash } => {
                super::runs::replace_token(connection, *run, *hash).await?;
            }
            Entry::VoidEpisode { episode, reason, at } => {
                void(connection, *episode, reason, *at).await?;
            }
            Entry::VoidRun { run, reason, at } => {
                super::runs::void(connection, *run, reason, *at).await?;
            }
            Entry::AddCompetition(row) => competitions::add(connection, row).await?,
            Entry::AddEntrant(row) => competitions::add_entrant(connection, row).await?,
            Entry::SetEntrant { entry, status, reason, vouched } => {
                let reason = reason.as_deref();
                competitions::set_entrant(connection, *entry, status, reason, *vouched).await?;
            }
            Entry::DescribeEntrant(facts) => competitions::describe(connection, facts).await?,
            Entry::RenameEntrant { entry, name } => {
                competitions::rename(connection, *entry, name).await?;
            }
            Entry::EraseEntrant { entry, name, at } => {
                competitions::erase(connection, *entry, name, *at).await?;
            }
            Entry::ReplaceKey { id, hash } => {
                sqlx::query("UPDATE keys SET hash = ? WHERE id = ?")
                    .bind(&hash.0[..])
                    .bind(id)
                    .execute(&mut *connection)
                    .await?;
            }
            Entry::ChangeCompetition { competition, definition, closes_at, hidden } => {
                competitions::change(connection, *competition, definition, *closes_at, *hidden)
                    .await?;
            }
            Entry::ExtendAttempts { competition, number, closes_at } => {
                super::runs::extend(connection, *competition, *number, *closes_at).await?;
            }
            Entry::CancelCompetition { competition, reason, at } => {
                competitions::cancel(connection, *competition, reason, *at).await?;
            }
            Entry::RevokeInvitations { hashes, at } => {
                competitions::revoke_invitations(connection, hashes, *at).await?;
            }
            Entry::AddInvitations { competition, codes, at } => {
                competitions::add_invitations(connection, *competition, codes, *at).await?;
            }
            Entry::Reveal { competition, at } => {
                competitions::reveal(connection, *competition, *at).await?;
            }
            Entry::Measured { number, metrics } => {
                if let Some(row) = metrics {
                    super::metrics::add(connection, row).await?;
                }
                if let Some(number) = number {
                    super::metrics::dequeue(connection, *number).await?;
                }
            }
            Entry::Audit(row) => super::audit::add(connection, row).await?,
        }
    }
    insert_acts(connection, &acts).await?;
    insert_rounds(connection, &rounds).await
}

async fn open(connection: &mut SqliteConnection, row: &OpeningRow) -> Result<(), sqlx::Error> {
    let cut = Cut::of(row.record.as_str());
    let template = match &cut {
        Some(cut) => Some(cut.keep(connection).await?),
        None => None,
    };
    sqlx::query(
        "INSERT INTO episodes (key, id, owner, run, slot, opening, task, model, visibility, status,
                               clocked, head, created_at, idempotency_key, idempotency_body,
                               fork_of, fork_round, template, template_at, open_seats, own_games)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
    )
    .bind(row.episode.0)
    .bind(row.id.as_str())
    .bind(row.owner.map(|owner| owner.0))
    .bind(row.run.map(|(run, _)| run.0))
    .bind(row.run.map(|(_, slot)| slot))
    .bind(cut.as_ref().map_or(row.record.as_str(), |cut| &cut.opening))
    .bind(row.task)
    .bind(&row.model)
    .bind(row.visibility)
    .bind(if row.waiting { "waiting" } else { "running" })
    .bind(row.clocked)
    .bind(&row.head.0[..])
    .bind(row.at.as_millisecond())
    .bind(row.idempotency.as_ref().map(|(key, _)| key))
    .bind(row.idempotency.as_ref().map(|(_, body)| &body[..]))
    .bind(row.fork.map(|(parent, _)| parent.0))
    .bind(row.fork.map(|(_, round)| round))
    .bind(template.map(|(key, _)| key))
    .bind(template.map(|(_, at)| at))
    .bind(row.has_open_seats)
    .bind(row.own_games.then_some(true))
    .execute(&mut *connection)
    .await?;
    if row.fork.is_some() {
        super::forks::complete(connection, row.episode).await?;
    }
    insert_tokens(connection, row.episode, &row.tokens).await
}

async fn start(
    connection: &mut SqliteConnection,
    episode: EpisodeKey,
    at: jiff::Timestamp,
) -> Result<(), sqlx::Error> {
    sqlx::query("UPDATE episodes SET status = 'running', started_at = ? WHERE key = ?")
        .bind(at.as_millisecond())
        .bind(episode.0)
        .execute(connection)
        .await?;
    Ok(())
}

async fn end(connection: &mut SqliteConnection, row: &EndRow) -> Result<(), sqlx::Error> {
    sqlx::query(
        "UPDATE episodes
         SET status = ?, reason = ?, ending = ?, head = ?, bytes = ?, ended_at = ? WHERE key = ?",
    )
    .bind(row.status)
    .bind(row.reason)
    .bind(row.record.as_str())
    .bind(&row.head.0[..])
    .bind(i64::try_from(row.bytes).unwrap_or(i64::MAX))
    .bind(row.at.as_millisecond())
    .bind(row.episode.0)
    .execute(&mut *connection)
    .await?;
    if row.rounds > 0 {
        super::metrics::queue(connection, row.episode).await?;
    }
    if row.counts {
        super::results::add(connection, row.episode, row.seed, row.score, row.rounds, row.tally)
            .await?;
    }
    Ok(())
}

async fn void(
    connection: &mut SqliteConnection,
    episode: EpisodeKey,
    reason: &str,
    at: jiff::Timestamp,
) -> Result<(), sqlx::Error> {
    sqlx::query(
        "UPDATE episodes SET voided_at = ?, void_reason = ? WHERE key = ? AND voided_at IS NULL",
    )
    .bind(at.as_millisecond())
    .bind(reason)
    .bind(episode.0)
    .execute(connection)
    .await?;
    Ok(())
}

async fn add_key(connection: &mut SqliteConnection, row: &KeyRow) -> Result<(), sqlx::Error> {
    let key = &row.key;
    sqlx::query(
        "INSERT INTO keys (id, hash, role, name, created_at, expires_at, acts_for) VALUES (?, ?, ?, ?, ?, ?, ?)",
    )
    .bind(&key.id)
    .bind(&row.hash.0[..])
    .bind(key.role.name())
    .bind(&key.name)
    .bind(key.created_at.as_millisecond())
    .bind(key.expires_at.map(jiff::Timestamp::as_millisecond))
    .bind(row.acts_for.map(|first| first.0))
    .execute(connection)
    .await?;
    Ok(())
}

/// Revokes a key; one that was revoked keeps its time.
async fn revoke_key(
    connection: &mut SqliteConnection,
    id: &str,
    at: jiff::Timestamp,
) -> Result<(), sqlx::Error> {
    sqlx::query("UPDATE keys SET revoked_at = coalesce(revoked_at, ?) WHERE id = ?")
        .bind(at.as_millisecond())
        .bind(id)
        .execute(connection)
        .await?;
    Ok(())
}

async fn insert_tokens(
    connection: &mut SqliteConnection,
    episode: EpisodeKey,
    tokens: &[TokenRow],
) -> Result<(), sqlx::Error> {
    for chunk in chunks(tokens) {
        let mut insert =
            QueryBuilder::<Sqlite>::new("INSERT INTO tokens (hash, episode, agent, holder) ");
        insert.push_values(chunk, |mut row, token| {
            row.push_bind(&token.hash.0[..])
                .push_bind(episode.0)
                .push_bind(token.agent.map(|agent| agent.0))
                .push_bind(token.holder);
        });
        insert.build().execute(&mut *connection).await?;
    }
    Ok(())
}

/// Who decided, as the table of acts has it.
const fn source_code(source: Source) -> u8 {
    match source {
        Source::Player => 0,
        Source::Clock => 1,
    }
}

async fn insert_acts(
    connection: &mut SqliteConnection,
    acts: &[&ActRow],
) -> Result<(), sqlx::Error> {
    static INSERT: Insert = Insert::new(
        "acts (episode, round, agent, waiting_for, source, at, record, brief)",
        "(?, ?, ?, ?, ?, ?, ?, ?)",
    );
    for (rows, statement) in INSERT.statements(acts) {
        let mut query = sqlx::query(statement);
        for act in rows {
            query = query
                .bind(act.episode.0)
                .bind(act.round)
                .bind(act.agent.0)
                .bind(act.waiting_for)
                .bind(source_code(act.source))
                .bind(act.at.as_millisecond())
                .bind(act.record.as_str())
                .bind(act.brief.as_ref().map(RawRecord::as_str));
        }
        query.execute(&mut *connection).await?;
    }
    Ok(())
}

async fn insert_rounds(
    connection: &mut SqliteConnection,
    rounds: &[&RoundRow],
) -> Result<(), sqlx::Error> {
    static INSERT: Insert =
        Insert::new("rounds (episode, round, digest, score, head, at)", "(?, ?, ?, ?, ?, ?)");
    for (rows, statement) in INSERT.statements(rounds) {
        let mut query = sqlx::query(statement);
        for round in rows {
            query = query
                .bind(round.episode.0)
                .bind(round.round)
                .bind(&round.digest[..])
                .bind(round.score)
                .bind(&round.head.0[..])
                .bind(round.at.as_millisecond());
        }
        query.execute(&mut *connection).await?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use futures::future::join_all;
    use swarmbench_engine::AgentId;

    use super::*;
    use crate::ids::RunKey;
    use crate::store::Store;
    use crate::store::port::EpisodeStore;
    use swarmbench_journal::record::Decision;

    fn act(episode: i64, round: u32) -> Entry {
        Entry::Act(ActRow {
            episode: EpisodeKey(episode),
            round,
            agent: AgentId(0),
            waiting_for: 0,
            source: Source::Clock,
            at: jiff::Timestamp::UNIX_EPOCH,
            record: RawRecord::write(&Decision::clock_ran_out().record(AgentId(0), 0)),
            brief: None,
        })
    }

    async fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::open(&folder.path().join("a.db")).await.expect("it opens");
        (folder, store)
    }

    /// Hands jobs over at once, and returns which were kept.
    async fn kept(store: &Store, jobs: Vec<Vec<Entry>>) -> Vec<bool> {
        let pending: Vec<_> = jobs.into_iter().map(|job| store.keep(job)).collect();
        join_all(pending).await.iter().map(Result::is_ok).collect()
    }

    /// The rounds of which an episode has acts.
    async fn rounds(store: &Store, episode: i64) -> Vec<u32> {
        let acts = store.acts(EpisodeKey(episode), 0, u32::MAX).await.expect("it can be read");
        acts.into_iter().map(|(round, _)| round).collect()
    }

    #[tokio::test]
    async fn a_refused_job_fails_alone_and_leaves_no_gap() {
        let (_folder, store) = store().await;
        // The second act of a seat in a round is refused; all are in one transaction.
        let jobs = vec![
            vec![act(1, 0)],
            vec![act(2, 0)],
            vec![act(1, 1), act(1, 0)],
            vec![act(1, 2)],
            vec![act(2, 1)],
            vec![],
            vec![act(2, 2), act(3, 0)],
        ];
        let expected = [true, true, false, false, true, true, true];
        assert_eq!(kept(&store, jobs).await, expected);
        assert!(!store.writer().has_failed());
        assert_eq!(store.writer().backlog_jobs() + store.writer().backlog_bytes(), 0);
        // Nor later, as long as nobody looked at what is on the disk.
        assert_eq!(kept(&store, vec![vec![act(1, 1)], vec![act(2, 3)]]).await, [false, true]);
        store.recovered(EpisodeKey(1));
        assert_eq!(kept(&store, vec![vec![act(1, 1)]]).await, [true]);
        assert_eq!(rounds(&store, 1).await, [0, 1]);
        assert_eq!(rounds(&store, 2).await, [0, 1, 2, 3]);
        store.close().await;
    }

    #[tokio::test]
    async fn a_group_with_many_refused_jobs_keeps_the_others() {
        let (_folder, store) = store().await;
        let jobs = (0..3_000).map(|n| vec![act(n % 100, u32::try_from(n / 200).expect("small"))]);
        let kept = kept(&store, jobs.collect()).await;
        // Of each episode the first act is kept; its second is of the same round, and nothing comes after that.
        assert!(
            kept.iter().take(100).all(|kept| *kept) && !kept.iter().skip(100).any(|kept| *kept)
        );
        store.close().await;
    }

    #[tokio::test]
    async fn jobs_are_refused_at_their_deadline_while_another_program_holds_the_lock() {
        let (folder, store) = store().await;
        store.close().await;
        let path = folder.path().join("a.db");
        let options = sqlx::sqlite::SqliteConnectOptions::new().filename(&path);
        let options = options.busy_timeout(Duration::ZERO);
        let mut other = SqliteConnection::connect_with(&options).await.expect("it opens");
        let mut own = SqliteConnection::connect_with(&options).await.expect("it opens");
        let files = Files::default();
        let state = WriterState::default();
        execute(&mut other, "BEGIN IMMEDIATE").await.unwrap_or_else(|_| panic!("it is free"));
        let (started, patience) = (Instant::now(), Duration::from_secs(1));
        let jobs = [vec![act(1, 0)], vec![act(2, 0)]];
        let kept = keep(&mut own, &files, &state, &jobs, started + patience).await;
        assert!(kept.iter().all(Result::is_err) && state.is_locked_out() && !state.has_failed());
        let waited = started.elapsed();
        assert!(patience <= waited && waited < patience * 19 / 10, "{waited:?}");
        execute(&mut other, "ROLLBACK").await.unwrap_or_else(|_| panic!("it was begun"));
        let jobs = [vec![act(3, 0)]];
        let kept = keep(&mut own, &files, &state, &jobs, Instant::now() + patience).await;
        assert!(kept.iter().all(Result::is_ok) && !state.is_locked_out());
    }

    #[tokio::test]
    async fn games_of_more_runs_than_a_statement_takes_are_read() {
        let (_folder, store) = store().await;
        let runs: Vec<RunKey> = (0..40_000).map(RunKey).collect();
        assert!(store.games_of_all(&runs).await.expect("any number").is_empty());
        store.close().await;
    }
}
