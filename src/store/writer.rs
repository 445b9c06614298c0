//! The one task that writes: it takes everything that is queued into one transaction.
//!
//! Under load a commit carries what came in while the one before was on its way to the disk, so the
//! cost of a commit is shared. After a failed commit nothing is acknowledged any more, as nobody can
//! know what the disk still holds of it: the writer refuses everything until the server is restarted.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

use sqlx::sqlite::SqliteConnection;
use sqlx::{Connection, QueryBuilder, Sqlite};
use tokio::sync::{Mutex, mpsc};
use tokio::task::JoinHandle;

use super::files::Files;
use super::results::Changes;
use crate::journal::{
    ActRow, Committed, EndRow, Entry, EpisodeKey, JournalError, OpeningRow, RoundRow, TokenRow,
};
use crate::keys::KeyRow;

/// Jobs that one transaction takes at most, so that the first does not wait for ever.
const GROUP_MAX: usize = 1024;

/// Rows that one statement inserts: a few sizes, so that few statements need to be prepared.
const CHUNKS: [usize; 3] = [256, 16, 1];

/// Entries that stand or fall together, and who wants to know.
struct Job {
    entries: Vec<Entry>,
    committed: Committed,
}

/// How the writer does; shared with whoever asks.
#[derive(Debug, Default)]
pub struct WriterState {
    failed: AtomicBool,
    backlog: AtomicUsize,
    changes: Changes,
}

impl WriterState {
    /// Whether a commit failed: nothing is kept any more.
    #[must_use]
    pub fn has_failed(&self) -> bool {
        self.failed.load(Ordering::Acquire)
    }

    /// What boards have to read again.
    #[must_use]
    pub fn changes(&self) -> &Changes {
        &self.changes
    }

    /// How many jobs are queued.
    #[must_use]
    pub fn backlog(&self) -> usize {
        self.backlog.load(Ordering::Relaxed)
    }
}

/// The handle of the writer.
#[derive(Clone, Debug)]
pub(super) struct Writer {
    queue: mpsc::UnboundedSender<Job>,
    state: Arc<WriterState>,
    stop: tokio_util::sync::CancellationToken,
    task: Arc<Mutex<Option<JoinHandle<()>>>>,
}

impl Writer {
    pub(super) fn spawn(connection: SqliteConnection, files: Files) -> Self {
        let (queue, jobs) = mpsc::unbounded_channel();
        let state = Arc::new(WriterState::default());
        let stop = tokio_util::sync::CancellationToken::new();
        let task = tokio::spawn(run(connection, files, jobs, Arc::clone(&state), stop.clone()));
        Self { queue, state, stop, task: Arc::new(Mutex::new(Some(task))) }
    }

    /// A writer that refuses everything.
    pub(super) fn none() -> Self {
        let (queue, _) = mpsc::unbounded_channel();
        let (state, stop) = (Arc::default(), tokio_util::sync::CancellationToken::new());
        Self { queue, state, stop, task: Arc::default() }
    }

    pub(super) fn state(&self) -> &WriterState {
        &self.state
    }

    pub(super) fn append(&self, entries: Vec<Entry>, committed: Committed) {
        self.state.backlog.fetch_add(1, Ordering::Relaxed);
        if let Err(mpsc::error::SendError(job)) = self.queue.send(Job { entries, committed }) {
            self.state.backlog.fetch_sub(1, Ordering::Relaxed);
            (job.committed)(Err(JournalError("the server is stopping".into())));
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
    stop: tokio_util::sync::CancellationToken,
) {
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
        let (entries, told): (Vec<_>, Vec<_>) =
            jobs.drain(..).map(|job| (job.entries, job.committed)).unzip();
        let entries: Vec<Entry> = entries.into_iter().flatten().collect();
        let result = if state.has_failed() {
            Err(JournalError("an earlier commit failed; restart the server".into()))
        } else {
            // What went into a file that was removed is not kept, whatever SQLite says.
            let committed = commit(&mut connection, &entries).await;
            committed
                .and_then(|()| files.check().map_err(|lost| JournalError(lost.to_string().into())))
        };
        if result.is_ok() {
            // Before anybody is told: whoever knows of an end finds it on the board.
            state.changes.note(&entries);
        }
        if let Err(error) = &result
            && !state.failed.swap(true, Ordering::AcqRel)
        {
            metrics::counter!("swarmbench_commit_failures_total").increment(1);
            tracing::error!(%error, "a commit failed: nothing is acknowledged until a restart");
        }
        state.backlog.fetch_sub(taken, Ordering::Relaxed);
        for committed in told {
            committed(result.clone());
        }
    }
    if let Err(error) = connection.close().await {
        tracing::warn!(%error, "the database was not closed cleanly");
    }
}

/// Writes all entries in one transaction.
async fn commit(connection: &mut SqliteConnection, entries: &[Entry]) -> Result<(), JournalError> {
    let started = Instant::now();
    if entries.is_empty() {
        // A barrier: what was queued before is durable by now.
        return Ok(());
    }
    let written = write(connection, entries).await;
    if let Err(error) = written {
        // Whether the roll-back works makes no difference: nothing is written any more.
        drop(sqlx::query("ROLLBACK").execute(connection).await);
        return Err(super::failure(error));
    }
    metrics::counter!("swarmbench_commits_total").increment(1);
    metrics::histogram!("swarmbench_commit_seconds").record(started.elapsed());
    metrics::counter!("swarmbench_commit_entries_total").increment(entries.len() as u64);
    Ok(())
}

async fn write(connection: &mut SqliteConnection, entries: &[Entry]) -> Result<(), sqlx::Error> {
    sqlx::query("BEGIN IMMEDIATE").execute(&mut *connection).await?;
    let mut acts = Vec::new();
    let mut rounds = Vec::new();
    for entry in entries {
        match entry {
            Entry::Open(row) => open(connection, row).await?,
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
                sqlx::query("DELETE FROM tokens WHERE episode = ? AND holder IS ?")
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
            Entry::AddCompetition(row) => super::competitions::add(connection, row).await?,
            Entry::AddEntrant(row) => super::competitions::add_entrant(connection, row).await?,
            Entry::SetEntrant { entry, status, reason, vouched } => {
                let reason = reason.as_deref();
                super::competitions::set_entrant(connection, *entry, status, reason, *vouched)
                    .await?;
            }
            Entry::AddInvitations { competition, codes, at } => {
                super::competitions::add_invitations(connection, *competition, codes, *at).await?;
            }
            Entry::Reveal { competition, at } => {
                super::competitions::reveal(connection, *competition, *at).await?;
            }
            Entry::Audit(row) => super::audit::add(connection, row).await?,
        }
    }
    insert_acts(connection, &acts).await?;
    insert_rounds(connection, &rounds).await?;
    sqlx::query("COMMIT").execute(connection).await?;
    Ok(())
}

async fn open(connection: &mut SqliteConnection, row: &OpeningRow) -> Result<(), sqlx::Error> {
    sqlx::query(
        "INSERT INTO episodes (key, id, owner, run, slot, opening, task, model, visibility, status,
                               clocked, head, created_at, idempotency_key, idempotency_body)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
    )
    .bind(row.episode.0)
    .bind(row.id.as_str())
    .bind(row.owner.map(|owner| owner.0))
    .bind(row.run.map(|(run, _)| run.0))
    .bind(row.run.map(|(_, slot)| slot))
    .bind(row.record.as_str())
    .bind(row.task)
    .bind(&row.model)
    .bind(row.visibility)
    .bind(if row.waiting { "waiting" } else { "running" })
    .bind(row.clocked)
    .bind(&row.head.0[..])
    .bind(row.at.as_millisecond())
    .bind(row.idempotency.as_ref().map(|(key, _)| key))
    .bind(row.idempotency.as_ref().map(|(_, body)| &body[..]))
    .execute(&mut *connection)
    .await?;
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
    if row.counts {
        super::results::add(connection, row.episode, row.score, row.rounds, row.tally).await?;
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
        "INSERT INTO keys (id, hash, role, name, created_at, expires_at) VALUES (?, ?, ?, ?, ?, ?)",
    )
    .bind(&key.id)
    .bind(&row.hash.0[..])
    .bind(key.role.name())
    .bind(&key.name)
    .bind(key.created_at.as_millisecond())
    .bind(key.expires_at.map(jiff::Timestamp::as_millisecond))
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

async fn insert_acts(
    connection: &mut SqliteConnection,
    acts: &[&ActRow],
) -> Result<(), sqlx::Error> {
    for chunk in chunks(acts) {
        let mut insert = QueryBuilder::<Sqlite>::new(
            "INSERT INTO acts (episode, round, agent, waiting_for, at, record) ",
        );
        insert.push_values(chunk, |mut row, act| {
            row.push_bind(act.episode.0)
                .push_bind(act.round)
                .push_bind(act.agent.0)
                .push_bind(act.waiting_for)
                .push_bind(act.at.as_millisecond())
                .push_bind(act.record.as_str());
        });
        insert.build().execute(&mut *connection).await?;
    }
    Ok(())
}

async fn insert_rounds(
    connection: &mut SqliteConnection,
    rounds: &[&RoundRow],
) -> Result<(), sqlx::Error> {
    for chunk in chunks(rounds) {
        let mut insert = QueryBuilder::<Sqlite>::new(
            "INSERT INTO rounds (episode, round, digest, score, head, at) ",
        );
        insert.push_values(chunk, |mut row, round| {
            row.push_bind(round.episode.0)
                .push_bind(round.round)
                .push_bind(&round.digest[..])
                .push_bind(round.score)
                .push_bind(&round.head.0[..])
                .push_bind(round.at.as_millisecond());
        });
        insert.build().execute(&mut *connection).await?;
    }
    Ok(())
}

/// Cuts rows into pieces of few different lengths.
pub(super) fn chunks<T>(rows: &[T]) -> impl Iterator<Item = &[T]> {
    let mut rest = rows;
    std::iter::from_fn(move || {
        let size = CHUNKS.into_iter().find(|&size| size <= rest.len())?;
        let (chunk, after) = rest.split_at(size);
        rest = after;
        Some(chunk)
    })
}
