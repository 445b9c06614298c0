//! The writer: the one task that writes. It takes all queued jobs into one commit.
//!
//! Under load a commit carries the jobs that arrived during the previous one, so its cost is shared. Appended entries of
//! running games go first; a commit carries [`KEPT_ROWS_MAX`] rows of kept entries, such as tokens, registrations and new
//! games. Four failures are possible, and each costs as little as it can:
//!
//! - A statement is refused, for instance by a constraint. The transaction is rolled back and its jobs are written again, each
//!   behind a savepoint: only the refused job gets an error, the others are committed. Nothing was acknowledged yet, so this is
//!   safe, and a group without such a job costs nothing more.
//! - Another program holds the lock of a file of SQLite. The begin of the transaction is repeated for [`PATIENCE`].
//! - PostgreSQL is unreachable, or ends the transaction for its own reasons, such as a full disk. The group is repeated for
//!   [`PATIENCE`], or until it is known whether it was committed (`postgres::group`).
//! - The disk or a commit of SQLite fails, or another server has taken the database. The stored state is unknown then, so
//!   nothing is acknowledged any more: the writer refuses everything until the server is restarted.
//!
//! The records of an episode are a chain. After a refused job, later ones would leave a gap in the chain, so they are refused,
//! too, until the episode is recovered from the disk ([`WriterState::recovered`]).

use std::collections::HashSet;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex as StdMutex, MutexGuard as StdMutexGuard, OnceLock};
use std::time::{Duration, Instant};

use futures::future::FutureExt as _;
use tokio::sync::{Mutex, mpsc};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::results::Changes;
use super::sql::{Builder, Connection, chunks, query};
use super::sqlite::files::Files;
use super::templates::Cut;
use super::{Stopped, StoreError, competitions, postgres, sqlite};
use crate::fair::{FairQueue, Party, Rank, Shares};
use crate::ids::{EpisodeKey, TokenHash};
use crate::keys::KeyRow;
use crate::store::entries::{EndRow, Entry, OpeningRow, TokenRow};
use crate::store::port::Committed;

/// Maximum jobs of a transaction; it bounds the wait of the first one.
const GROUP_MAX: usize = 1024;

/// Maximum rows of a transaction for jobs for which no game waits; each KiB counts as a row. The last job may exceed it. It
/// bounds the delay of acts by such jobs.
const KEPT_ROWS_MAX: usize = 128;

/// Total time for which a commit is repeated while another program holds the lock or the database is unreachable.
const PATIENCE: Duration = Duration::from_mins(1);

/// Entries that are written together or not at all, and the callback for the outcome.
struct Job {
    entries: Vec<Entry>,
    /// Bytes in the queue; 0 for kept jobs.
    bytes: usize,
    /// Party and counted rows of a kept job; `None` for an appended one, for which running games wait.
    kept: Option<(Party, usize)>,
    committed: Committed,
}

/// Queue of jobs for which no game waits. Parties take turns, so that the many jobs of one do not delay those of others.
struct Kept(FairQueue<(usize, Job)>);

impl Kept {
    fn new() -> Self {
        Self(FairQueue::new(Shares::of(usize::MAX)))
    }

    /// Moves kept jobs from `jobs` into the queue.
    fn take(&mut self, jobs: &mut Vec<Job>) {
        for job in jobs.extract_if(.., |job| job.kept.is_some()) {
            let (party, rows) = job.kept.unwrap_or((Party::SERVER, 0));
            self.0.add(party, Rank::Urgent, (rows, job));
        }
    }

    /// Moves kept jobs of about `rows_max` rows into `jobs`. Parties are charged for rows instead of time: a pause of the
    /// database is nobody's fault.
    fn choose(&mut self, jobs: &mut Vec<Job>, rows_max: usize) {
        let mut rows = 0;
        while rows < rows_max
            && let Some((party, rank, (counted, job))) = self.0.pop()
        {
            self.0.done(party, rank, Duration::from_micros(counted as u64));
            rows += counted;
            jobs.push(job);
        }
    }
}

pub(super) type Outcome = Result<(), StoreError>;

/// Reason why a transaction, or a part of it, was not written.
pub(super) enum Failure {
    /// The stored state is unknown, or belongs to another server.
    Fatal(Box<dyn std::error::Error + Send + Sync>),
    /// A statement was refused; the transaction can be rolled back.
    Refused(sqlx::Error),
    /// The database is unreachable, or has ended the transaction; the transaction may be repeated.
    Away(sqlx::Error),
}

/// Reason why nothing can be written for a while.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Blocked {
    #[error("another program has locked the database: nothing can be written")]
    LockedOut,
    #[error(
        "the database is not reached, or ends what is written: nothing can be written until it is back"
    )]
    Away,
    #[error(
        "the database does not answer, as a commit that waits for a standby: nothing is acknowledged until it does"
    )]
    Late,
    #[error("the disk of the database is full: nothing can be written until there is room on it")]
    Full,
}

/// Minimum bytes that a queued job counts, so that the limit of bytes also bounds the number of jobs and their delay.
const JOB_BYTES_MIN: usize = 4096;

/// The state of the writer, shared with readers.
#[derive(Debug, Default)]
pub struct WriterState {
    failed: CancellationToken,
    excluded: CancellationToken,
    /// Why this server of a cluster cannot go on, where no other one has excluded it.
    fault: OnceLock<String>,
    blocked: StdMutex<Option<(Blocked, Instant)>>,
    backlog_jobs: AtomicUsize,
    backlog_bytes: AtomicUsize,
    changes: Changes,
    /// Episodes with a refused job that were not recovered since.
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

    /// Cancelled when other servers have taken over this server's places; it may join them again.
    pub fn excluded(&self) -> &CancellationToken {
        &self.excluded
    }

    /// Why this server of a cluster counts as excluded, where the reason is its own.
    pub fn fault(&self) -> Option<&str> {
        self.fault.get().map(String::as_str)
    }

    /// Reason why nothing can be written at the moment, if so.
    pub fn blocked(&self) -> Option<Blocked> {
        self.blocking().map(|(blocked, _)| blocked)
    }

    /// Changes that boards have to read again.
    pub fn changes(&self) -> &Changes {
        &self.changes
    }

    pub fn backlog_jobs(&self) -> usize {
        self.backlog_jobs.load(Ordering::Relaxed)
    }

    pub fn backlog_bytes(&self) -> usize {
        self.backlog_bytes.load(Ordering::Relaxed)
    }

    /// Accepts jobs of an episode again. The caller makes sure that the old actor has ended, all of its jobs were answered, and
    /// nobody has continued from the disk yet.
    pub fn recovered(&self, episode: EpisodeKey) {
        self.broken().remove(&episode);
    }

    fn broken(&self) -> StdMutexGuard<'_, HashSet<EpisodeKey>> {
        self.broken.lock().expect("nothing panics while it holds this")
    }

    fn blocking(&self) -> StdMutexGuard<'_, Option<(Blocked, Instant)>> {
        self.blocked.lock().expect("nothing panics while it holds this")
    }

    /// Whether a job continues the chain of an episode whose chain has a gap.
    pub(super) fn continues_broken(&self, entries: &[Entry]) -> bool {
        let broken = self.broken();
        !broken.is_empty()
            && entries.iter().filter_map(Entry::chain).any(|episode| broken.contains(&episode))
    }

    fn note_refused(&self, entries: &[Entry]) {
        // No entry follows an opening before it was kept, so a refused opening leaves no gap.
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

    /// Records that nothing can be written; logs it once.
    pub(super) fn set_blocked(&self, why: Blocked, error: &dyn std::fmt::Display) {
        let mut blocking = self.blocking();
        if let Some((earlier, _)) = &mut *blocking {
            *earlier = why;
        } else {
            *blocking = Some((why, Instant::now()));
            tracing::warn!(%error, "{why}");
        }
    }

    /// Records that writing works again.
    pub(super) fn set_unblocked(&self) {
        if let Some((_, since)) = self.blocking().take() {
            let waited_ms = swarmbench_clock::millis(since.elapsed());
            tracing::info!(waited_ms, "writing continues");
        }
    }

    /// Records that other servers have taken over this server's places.
    pub(super) fn exclude(&self, error: &dyn std::fmt::Display) {
        if !self.excluded.is_cancelled() {
            metrics::counter!("swarmbench_fenced_total").increment(1);
        }
        self.fail(error);
        self.excluded.cancel();
    }

    /// Records that this server of a cluster cannot go on: others take over its places, as if they had excluded it.
    pub(super) fn give_up(&self, error: &dyn std::fmt::Display) {
        // The first reason stands, as in the log.
        drop(self.fault.set(error.to_string()));
        self.exclude(error);
    }

    pub(super) fn fail(&self, error: &dyn std::fmt::Display) {
        if !self.has_failed() {
            self.failed.cancel();
            // A failed writer is not blocked any more.
            self.blocking().take();
            metrics::counter!("swarmbench_commit_failures_total").increment(1);
            tracing::error!(%error, "a commit failed: nothing is acknowledged until a restart");
        }
    }
}

/// Committer of groups of jobs, by engine.
pub(super) enum Group {
    Sqlite(Connection, Files),
    Postgres(Box<postgres::group::Committer>),
}

impl Group {
    async fn set_up(&mut self) {
        match self {
            Self::Sqlite(connection, _) => sqlite::group::set_up(connection).await,
            Self::Postgres(_) => {}
        }
    }

    /// Writes jobs in one commit, and repeats it until the deadline, but not for long after `stop`. Returns the outcomes in the
    /// order of the jobs.
    async fn keep(
        &mut self,
        state: &WriterState,
        jobs: &[Vec<Entry>],
        deadline: Instant,
        stop: &CancellationToken,
    ) -> Vec<Outcome> {
        match self {
            Self::Sqlite(connection, files) => {
                sqlite::group::keep(connection, files, state, jobs, deadline).await
            }
            Self::Postgres(committer) => committer.keep(state, jobs, deadline, stop).await,
        }
    }

    /// Waits until the next check of the database. The file of SQLite is checked elsewhere.
    async fn watch_pause(&self) {
        match self {
            Self::Sqlite(..) => std::future::pending().await,
            Self::Postgres(_) => tokio::time::sleep(postgres::group::WATCH).await,
        }
    }

    /// Tells the cluster about durable entries.
    fn note(&self, entries: &[Entry]) {
        if let Self::Postgres(committer) = self
            && let Some(cluster) = committer.cluster()
        {
            cluster.note(entries);
        }
    }

    /// Pause after a commit that took `took`, for the commits of other servers.
    fn pause(&self, took: Duration) -> Duration {
        match self {
            Self::Postgres(node) if let Some(cluster) = node.cluster() => {
                let servers = cluster.servers();
                let playing = servers.iter().filter(|row| row.episodes > 0).count();
                crate::cluster::commit_pause(took, playing)
            }
            Self::Sqlite(..) | Self::Postgres(_) => Duration::ZERO,
        }
    }

    async fn watch(&mut self, state: &WriterState) {
        match self {
            Self::Sqlite(..) => {}
            Self::Postgres(committer) => committer.watch(state).await,
        }
    }

    async fn close(self) -> Result<(), sqlx::Error> {
        match self {
            Self::Sqlite(connection, _) => connection.close().await,
            Self::Postgres(committer) => committer.leave().await,
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
    pub(super) fn spawn(group: Group) -> Self {
        let (queue, jobs) = mpsc::unbounded_channel();
        let state = Arc::new(WriterState::default());
        let stop = CancellationToken::new();
        let task = tokio::spawn(run(group, jobs, Arc::clone(&state), stop.clone()).boxed());
        Self { queue, state, stop, task: Arc::new(Mutex::new(Some(task))) }
    }

    /// Writer that refuses everything.
    pub(super) fn none() -> Self {
        let (queue, _) = mpsc::unbounded_channel();
        let (state, stop) = (Arc::default(), CancellationToken::new());
        Self { queue, state, stop, task: Arc::default() }
    }

    pub(super) fn state(&self) -> &WriterState {
        &self.state
    }

    /// Queues a job of running games, or one that is kept for a party.
    pub(super) fn append(
        &self,
        entries: Vec<Entry>,
        kept_for: Option<Party>,
        committed: Committed,
    ) {
        let bytes = entries.iter().map(Entry::bytes).sum::<usize>();
        let kept = kept_for
            .map(|party| (party, entries.iter().map(Entry::rows).sum::<usize>() + bytes / 1024));
        // Kept jobs count no bytes, so that acts are never refused because of them.
        let bytes = if kept.is_some() { 0 } else { bytes.max(JOB_BYTES_MIN) };
        self.state.add_backlog(bytes);
        let job = Job { entries, bytes, kept, committed };
        if let Err(mpsc::error::SendError(job)) = self.queue.send(job) {
            self.state.remove_backlog(bytes);
            (job.committed)(Err(StoreError::Stopped(Stopped::Server)));
        }
    }

    /// Commits all queued jobs and ends.
    pub(super) async fn stop(&self) {
        self.stop.cancel();
        if let Some(task) = self.task.lock().await.take() {
            // A panic of the writer was logged where it happened.
            drop(task.await);
        }
    }
}

async fn run(
    mut group: Group,
    mut queue: mpsc::UnboundedReceiver<Job>,
    state: Arc<WriterState>,
    stop: CancellationToken,
) {
    group.set_up().await;
    let (mut jobs, mut kept) = (Vec::with_capacity(GROUP_MAX), Kept::new());
    loop {
        let taken = tokio::select! {
            biased;
            taken = queue.recv_many(&mut jobs, GROUP_MAX) => taken,
            () = stop.cancelled() => {
                queue.close();
                queue.recv_many(&mut jobs, GROUP_MAX).await
            }
            () = std::future::ready(()), if kept.0.waiting() > 0 => 0,
            () = group.watch_pause() => {
                group.watch(&state).await;
                continue;
            }
        };
        kept.take(&mut jobs);
        // Acts overtake all kept jobs that arrived before them.
        while jobs.len() < GROUP_MAX
            && let Ok(job) = queue.try_recv()
        {
            jobs.push(job);
            kept.take(&mut jobs);
        }
        // While writing is blocked, or when the server stops, all kept jobs share one transaction and its patience.
        let is_urgent = stop.is_cancelled() || state.blocked().is_some();
        kept.choose(&mut jobs, if is_urgent { usize::MAX } else { KEPT_ROWS_MAX });
        if taken == 0 && jobs.is_empty() {
            break;
        }
        let (jobs, receipts): (Vec<_>, Vec<_>) =
            jobs.drain(..).map(|job| (job.entries, (job.bytes, job.committed))).unzip();
        let begun = Instant::now();
        let outcomes = group.keep(&state, &jobs, begun + PATIENCE, &stop).await;
        let pause = group.pause(begun.elapsed());
        for (entries, outcome) in jobs.iter().zip(&outcomes) {
            if outcome.is_ok() {
                // Changes are noted before senders are notified, so that a client that knows of an end finds it on the board.
                state.changes.note(entries);
                group.note(entries);
            }
        }
        for ((bytes, committed), outcome) in receipts.into_iter().zip(outcomes) {
            state.remove_backlog(bytes);
            committed(outcome);
        }
        if !pause.is_zero() {
            drop(tokio::time::timeout(pause, stop.cancelled()).await);
        }
    }
    // Closing often fails after a failure: other servers end the sessions of a server that they exclude.
    if let Err(error) = group.close().await
        && !state.has_failed()
    {
        tracing::warn!(%error, "the database was not closed cleanly");
    }
}

/// Outcome of a job that is not written.
pub(super) fn refuse(state: &WriterState, job: &[Entry], error: StoreError) -> Outcome {
    state.note_refused(job);
    if job.is_empty() { Ok(()) } else { Err(error) }
}

/// Writes the entries of one job behind a savepoint of the open transaction; a refused job leaves no trace.
pub(super) async fn write_alone(
    connection: &mut Connection,
    state: &WriterState,
    job: &[Entry],
    failure: fn(sqlx::Error) -> Failure,
) -> Result<Outcome, Failure> {
    if state.continues_broken(job) {
        return Ok(refuse(state, job, StoreError::Gap));
    }
    let fatal = |error| match failure(error) {
        // A failure of these statements breaks the whole transaction.
        Failure::Refused(error) => Failure::Fatal(error.into()),
        other => other,
    };
    if let Some(Entry::CheckToken(hash)) = job.first()
        && !super::tokens::has_rights(connection, *hash).await.map_err(fatal)?
    {
        return Ok(refuse(state, job, StoreError::NoRights));
    }
    query("SAVEPOINT job").execute(connection).await.map_err(fatal)?;
    let written = write(connection, job.iter()).await.map_err(failure);
    if let Err(Failure::Refused(_)) = written {
        query("ROLLBACK TO job").execute(connection).await.map_err(fatal)?;
    }
    if let Err(lost @ (Failure::Fatal(_) | Failure::Away(_))) = written {
        return Err(lost);
    }
    query("RELEASE job").execute(connection).await.map_err(fatal)?;
    let Err(Failure::Refused(error)) = written else { return Ok(Ok(())) };
    metrics::counter!("swarmbench_jobs_refused_total").increment(1);
    tracing::error!(%error, "the database rejected an entry: it is not stored, all others are");
    Ok(refuse(state, job, error.into()))
}

pub(super) async fn write(
    connection: &mut Connection,
    entries: impl Iterator<Item = &Entry>,
) -> Result<(), sqlx::Error> {
    let mut acts = Vec::new();
    let mut rounds = Vec::new();
    let mut ended = Vec::new();
    for entry in entries {
        match entry {
            Entry::CheckToken(hash) => {
                if !super::tokens::has_rights(connection, *hash).await? {
                    return Err(sqlx::Error::RowNotFound);
                }
            }
            Entry::Open(row) => open(connection, row).await?,
            Entry::BeginForks(episodes) => super::forks::begin(connection, episodes).await?,
            Entry::Start { episode, at } => start(connection, *episode, *at).await?,
            Entry::Act(row) => acts.push(row),
            Entry::Round(row) => rounds.push(row),
            Entry::End(row) => ended.push(end(connection, row).await?),
            Entry::Claim(row) => {
                super::seats::claim(connection, row).await?;
                insert_tokens(connection, row.episode, &row.tokens).await?;
            }
            Entry::Seat(row) => super::seats::seat(connection, row).await?,
            Entry::ReplaceTokens { episode, holder, agents, tokens } => {
                delete_tokens(connection, *episode, *holder, *agents).await?;
                insert_tokens(connection, *episode, tokens).await?;
            }
            Entry::AddKey(row) => add_key(connection, row).await?,
            Entry::RevokeKey { id, at } => revoke_key(connection, id, *at).await?,
            Entry::Import { game, at } => super::imports::keep(connection, game, *at).await?,
            Entry::OpenRun(row) => super::runs::open(connection, row).await?,
            Entry::EndRun { run, status, at } => {
                super::runs::end(connection, *run, status, *at).await?;
            }
            Entry::ReopenRun { run } => super::runs::reopen(connection, *run).await?,
            Entry::ReplaceRunToken { run, holder, hash } => {
                super::runs::replace_token(connection, *run, *holder, *hash).await?;
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
            Entry::RenameEntrant { entry, name, by_itself } => {
                competitions::rename(connection, *entry, name, *by_itself).await?;
            }
            Entry::EraseEntrant { entry, name, at } => {
                competitions::erase(connection, *entry, name, *at).await?;
            }
            Entry::ReplaceKey { id, hash } => {
                replace_key(connection, id, *hash).await?;
                delete_tokens_of_entrant(connection, id).await?;
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
    if connection.is_postgres() {
        postgres::rows::insert(connection, &acts, &rounds).await?;
    } else {
        sqlite::rows::insert(connection, &acts, &rounds).await?;
    }
    // The last rounds are among those of this commit.
    super::episodes::add_curves(connection, &ended).await
}

async fn open(connection: &mut Connection, row: &OpeningRow) -> Result<(), sqlx::Error> {
    let cut = Cut::of(row.record.as_str());
    let template = match &cut {
        Some(cut) => Some(cut.keep(connection).await?),
        None => None,
    };
    query(
        "INSERT INTO episodes (key, id, owner, run, slot, opening, task, model, visibility, status,
                               clocked, head, created_at, idempotency_key, idempotency_body,
                               fork_of, fork_round, template, template_at, open_seats, own_games, people)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15, $16, $17, $18, $19, $20, $21, $22)",
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
    .bind(row.is_mixed)
    .bind(row.own_games.then_some(true))
    .bind(row.has_people)
    .execute(&mut *connection)
    .await?;
    if row.fork.is_some() {
        super::forks::complete(connection, row.episode).await?;
    }
    insert_tokens(connection, row.episode, &row.tokens).await
}

async fn start(
    connection: &mut Connection,
    episode: EpisodeKey,
    at: jiff::Timestamp,
) -> Result<(), sqlx::Error> {
    query("UPDATE episodes SET status = 'running', started_at = $1 WHERE key = $2")
        .bind(at.as_millisecond())
        .bind(episode.0)
        .execute(connection)
        .await?;
    Ok(())
}

/// Ends an episode; returns it with its rounds.
async fn end(connection: &mut Connection, row: &EndRow) -> Result<(EpisodeKey, u32), sqlx::Error> {
    query(
        "UPDATE episodes
         SET status = $1, reason = $2, ending = $3, head = $4, bytes = $5, ended_at = $6, score = $7, rounds = $8, seed = $9
         WHERE key = $10",
    )
    .bind(row.status)
    .bind(row.reason)
    .bind(row.record.as_str())
    .bind(&row.head.0[..])
    .bind(i64::try_from(row.bytes).unwrap_or(i64::MAX))
    .bind(row.at.as_millisecond())
    // A layout may have a score, but none is shown before the first round.
    .bind(if row.rounds > 0 { row.score } else { 0.0 })
    .bind(row.rounds)
    .bind(i64::from(row.seed))
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
    Ok((row.episode, row.rounds))
}

async fn void(
    connection: &mut Connection,
    episode: EpisodeKey,
    reason: &str,
    at: jiff::Timestamp,
) -> Result<(), sqlx::Error> {
    query(
        "UPDATE episodes SET voided_at = $1, void_reason = $2 WHERE key = $3 AND voided_at IS NULL",
    )
    .bind(at.as_millisecond())
    .bind(reason)
    .bind(episode.0)
    .execute(connection)
    .await?;
    Ok(())
}

async fn add_key(connection: &mut Connection, row: &KeyRow) -> Result<(), sqlx::Error> {
    let key = &row.key;
    query(
        "INSERT INTO keys (id, hash, role, name, created_at, expires_at, acts_for) VALUES ($1, $2, $3, $4, $5, $6, $7)",
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

/// Revokes a key; a revoked key keeps its time.
async fn replace_key(
    connection: &mut Connection,
    id: &str,
    hash: TokenHash,
) -> Result<(), sqlx::Error> {
    query("UPDATE keys SET hash = $1 WHERE id = $2")
        .bind(&hash.0[..])
        .bind(id)
        .execute(connection)
        .await?;
    Ok(())
}

async fn revoke_key(
    connection: &mut Connection,
    id: &str,
    at: jiff::Timestamp,
) -> Result<(), sqlx::Error> {
    query("UPDATE keys SET revoked_at = coalesce(revoked_at, $1) WHERE id = $2")
        .bind(at.as_millisecond())
        .bind(id)
        .execute(&mut *connection)
        .await?;
    delete_tokens_of_entrant(connection, id).await
}

/// Deletes the tokens of attempts and practice that a key plays: whoever had the key, a removed member or a thief, knows them.
async fn delete_tokens_of_entrant(
    connection: &mut Connection,
    id: &str,
) -> Result<(), sqlx::Error> {
    let delete = "DELETE FROM tokens WHERE run IN (
                      SELECT r.key FROM keys k JOIN runs r ON r.owner = coalesce(k.acts_for, k.number)
                      WHERE k.id = $1 AND r.status = 'running' AND (k.role = 'entrant' OR r.competition IS NOT NULL))";
    query(delete).bind(id).execute(connection).await?;
    Ok(())
}

/// Deletes the tokens of a holder for a range of agents, first to last; agent -1 is all seats.
async fn delete_tokens(
    connection: &mut Connection,
    episode: EpisodeKey,
    holder: Option<u32>,
    (first, last): (i64, i64),
) -> Result<(), sqlx::Error> {
    let delete = query(
        "DELETE FROM tokens WHERE episode = $1 AND holder IS NOT DISTINCT FROM $2
         AND coalesce(agent, -1) BETWEEN $3 AND $4",
    );
    let delete = delete.bind(episode.0).bind(holder).bind(first).bind(last);
    delete.execute(connection).await?;
    Ok(())
}

async fn insert_tokens(
    connection: &mut Connection,
    episode: EpisodeKey,
    tokens: &[TokenRow],
) -> Result<(), sqlx::Error> {
    for chunk in chunks(tokens) {
        let mut insert = Builder::new("INSERT INTO tokens (hash, episode, agent, holder) ");
        insert.push_rows(chunk, |row, token| {
            row.push_bind(&token.hash.0[..])
                .push_bind(episode.0)
                .push_bind(token.agent.map(|agent| agent.0))
                .push_bind(token.holder);
        });
        insert.build().execute(&mut *connection).await?;
    }
    Ok(())
}

#[cfg(test)]
pub(super) mod tests {
    use futures::future::join_all;
    use swarmbench_engine::AgentId;

    use super::*;
    use crate::fair::Group;
    use crate::ids::RunKey;
    use crate::keys::OwnerKey;
    use crate::store::Store;
    use crate::store::entries::ActRow;
    use crate::store::port::EpisodeStore;
    use swarmbench_journal::record::{Decision, RawRecord, Source};

    pub(in crate::store) fn act(episode: i64, round: u32) -> Entry {
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
        let store = Store::open(folder.path().join("a.db")).await.expect("it opens");
        (folder, store)
    }

    /// Queues jobs at once; returns for each whether it was kept.
    async fn kept(store: &Store, jobs: Vec<Vec<Entry>>) -> Vec<bool> {
        let pending: Vec<_> = jobs.into_iter().map(|job| store.keep(job)).collect();
        join_all(pending).await.iter().map(Result::is_ok).collect()
    }

    /// Rounds with acts of an episode.
    async fn rounds(store: &Store, episode: i64) -> Vec<u32> {
        let acts = store.acts(EpisodeKey(episode), 0, u32::MAX).await.expect("it can be read");
        acts.into_iter().map(|(round, _)| round).collect()
    }

    #[tokio::test]
    async fn a_refused_job_fails_alone_and_leaves_no_gap() {
        let (_folder, store) = store().await;
        // The second act of a seat in a round is refused; all jobs are in one transaction.
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
        // Later jobs are refused, too, until the episode is recovered.
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
        // The first act of each episode is kept; the second is of the same round, and nothing may follow it.
        assert!(
            kept.iter().take(100).all(|kept| *kept) && !kept.iter().skip(100).any(|kept| *kept)
        );
        store.close().await;
    }

    #[test]
    fn kept_jobs_of_parties_take_turns_and_acts_pass_them() {
        let job = |kept| Job { entries: Vec::new(), bytes: 0, kept, committed: Box::new(|_| ()) };
        let party = |number| Party::of(Group::Owner(OwnerKey(number)));
        let of = |number, rows| job(Some((party(number), rows)));
        let mut jobs: Vec<_> = (0..9).map(|_| of(1, KEPT_ROWS_MAX / 2)).collect();
        jobs.extend([of(2, KEPT_ROWS_MAX), job(None), of(2, 1)]);
        let mut kept = Kept::new();
        kept.take(&mut jobs);
        assert_eq!(jobs.len(), 1, "the act");
        let mut chosen = |rows_max| {
            let mut jobs = Vec::new();
            kept.choose(&mut jobs, rows_max);
            jobs.iter().filter_map(|job| Some(job.kept?.0 == party(1))).collect::<Vec<_>>()
        };
        assert_eq!(chosen(KEPT_ROWS_MAX), [true, false]);
        assert_eq!(chosen(KEPT_ROWS_MAX), [true, true], "it has had as much as the other one now");
        assert_eq!(chosen(usize::MAX).len(), 7, "all that is left, when nothing can be written");
        assert!(chosen(usize::MAX).is_empty());
    }

    #[tokio::test]
    async fn games_of_more_runs_than_a_statement_takes_are_read() {
        let (_folder, store) = store().await;
        let runs: Vec<RunKey> = (0..40_000).map(RunKey).collect();
        assert!(store.games_of_all(&runs).await.expect("any number").is_empty());
        store.close().await;
    }
}
