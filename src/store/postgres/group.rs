//! The writer of PostgreSQL: a group of jobs is one commit, which increments the counter in this server's row of `nodes`.
//!
//! A server that takes the database over deletes that row, so nothing queued before can be committed afterwards. If the
//! connection breaks during a commit, the counter tells whether the commit is done: nothing is guessed, and nothing is
//! written twice. So a restart or failover of PostgreSQL is only a pause.

use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;

use super::cluster::{self, Cluster, Joining};
use super::session::{self, Server};
use crate::store::entries::Entry;
use crate::store::sql::{Connection, query};
use crate::store::writer::{self, Blocked, Failure, Outcome, WriterState};
use crate::store::{OpenError, Stopped, StoreError};
use crate::telemetry;

/// Interval of checks of this server's row while nothing is written.
pub(in crate::store) const WATCH: Duration = Duration::from_secs(1);

/// First and longest pause between attempts to connect.
const PAUSES: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(1));

/// A commit that waits for longer makes the server not ready: a standby is missing, or the database is unreachable.
const ANSWER_USUAL: Duration = Duration::from_secs(2);

/// Time without an answer after which the connection is dropped and the fate of the commit is looked up.
const ANSWER_PATIENCE: Duration = Duration::from_secs(30);

/// Time that a stopping server waits for an unreachable database.
const STOP_PATIENCE: Duration = Duration::from_secs(5);

/// Time to wait for the end of an old session of this server after its termination.
const TERMINATE_PATIENCE: Duration = Duration::from_secs(5);

pub(in crate::store) struct Committer {
    server: Server,
    /// `None` while the database is unreachable.
    connection: Option<Connection>,
    /// Number of this server in `nodes`, unique for all time.
    incarnation: i64,
    /// Number of commits of this server that are known to be done.
    committed: i64,
    /// Set in a cluster of servers.
    cluster: Option<Arc<Cluster>>,
}

/// A commit that was sent without a known outcome.
struct Sent {
    outcomes: Vec<Outcome>,
    /// Whether this server's row has since shown that the commit is not done. The database may have failed over, and back.
    is_undone: bool,
}

/// Reasons why this server's row is missing or unexpected: nothing may be acknowledged any more.
#[derive(Debug, thiserror::Error)]
enum Excluded {
    #[error("another server has taken the database over")]
    TakenOver,
    #[error(
        "the database has {found} commits of this server, and {known} were acknowledged: it was restored from a backup, or a \
         standby without the last commits took over"
    )]
    Lost { found: i64, known: i64 },
}

impl From<Excluded> for Failure {
    fn from(excluded: Excluded) -> Self {
        Self::Fatal(excluded.into())
    }
}

/// Excludes all earlier servers that are not connected now: they can commit nothing more. Waits for a commit under way.
pub(in crate::store) async fn exclude_others(
    connection: &mut Connection,
) -> Result<(), sqlx::Error> {
    query("DELETE FROM nodes").execute(connection).await.map(drop)
}

/// Classifies an error by what it means for its transaction, according to the class of its SQLSTATE.
pub(in crate::store) fn failure(error: sqlx::Error) -> Failure {
    let Some(code) = session::sqlstate(&error) else {
        return match error {
            sqlx::Error::Encode(_)
            | sqlx::Error::Decode(_)
            | sqlx::Error::ColumnDecode { .. }
            // The row that an entry changes does not exist.
            | sqlx::Error::RowNotFound => Failure::Refused(error),
            _ => Failure::Away(error),
        };
    };
    match &code[..2] {
        // A value, a constraint, a limit or a statement: the fault of one job.
        "21" | "22" | "23" | "42" | "54" => Failure::Refused(error),
        // A lost connection, a full disk, no memory, a restart, and all else: the transaction is not done.
        _ => Failure::Away(error),
    }
}

/// Waits for an answer up to [`ANSWER_PATIENCE`], and reports the database as blocked after [`ANSWER_USUAL`].
async fn answered<T>(
    state: &WriterState,
    asked: impl Future<Output = Result<T, Failure>>,
) -> Result<T, Failure> {
    let mut asked = std::pin::pin!(asked);
    if let Ok(answer) = tokio::time::timeout(ANSWER_USUAL, &mut asked).await {
        return answer;
    }
    let late = || sqlx::Error::Io(std::io::ErrorKind::TimedOut.into());
    state.set_blocked(Blocked::Late, &late());
    let left = ANSWER_PATIENCE.saturating_sub(ANSWER_USUAL);
    tokio::time::timeout(left, asked).await.unwrap_or_else(|_| Err(Failure::Away(late())))
}

/// SQLSTATE of a full disk.
const DISK_FULL: &str = "53100";

fn blocked_by(error: &sqlx::Error) -> Blocked {
    if session::sqlstate(error).as_deref() == Some(DISK_FULL) {
        Blocked::Full
    } else {
        Blocked::Away
    }
}

impl Committer {
    /// Registers a process that holds the lock of the database, alone or shared.
    pub(in crate::store) async fn join(
        server: Server,
        mut connection: Connection,
        joining: Option<&Joining>,
    ) -> Result<Self, OpenError> {
        let failed = |error| server.failed(error);
        let at = now_ms(&mut connection).await.map_err(failed)?;
        let joined =
            query("INSERT INTO nodes (name, started_at) VALUES ($1, $2) RETURNING incarnation");
        let name = crate::host::process_name();
        let incarnation = joined.bind(&name).bind(at).one(&mut connection).await.map_err(failed)?;
        session::set_name(&mut connection, &session_name(incarnation)).await.map_err(failed)?;
        let cluster = match joining {
            Some(joining) => {
                match Cluster::join(&server, &mut connection, incarnation, joining).await {
                    Ok(cluster) => Some(cluster),
                    Err(refused) => {
                        let row =
                            query("DELETE FROM nodes WHERE incarnation = $1").bind(incarnation);
                        row.execute(&mut connection).await.map_err(failed)?;
                        return Err(refused);
                    }
                }
            }
            None => None,
        };
        Ok(Self { server, connection: Some(connection), incarnation, committed: 0, cluster })
    }

    /// Stops all writes after a fatal error. A server of a cluster counts as excluded: it ends, its games go to the others,
    /// and it is started again.
    fn note_fatal(
        &self,
        state: &WriterState,
        error: &(dyn std::error::Error + Send + Sync + 'static),
    ) {
        match error.downcast_ref::<Excluded>() {
            Some(Excluded::TakenOver) => state.exclude(&error),
            Some(Excluded::Lost { .. }) | None if self.cluster.is_some() => state.give_up(&error),
            Some(Excluded::Lost { .. }) | None => state.fail(&error),
        }
    }

    /// The state of the cluster; `None` for a single server.
    pub(in crate::store) fn cluster(&self) -> Option<&Arc<Cluster>> {
        self.cluster.as_ref()
    }

    /// Writes jobs in one commit; returns their outcomes in order. Retries while the database is unreachable: until the
    /// deadline, or without limit while the outcome of a sent commit is unknown; at most [`STOP_PATIENCE`] after `stop`.
    pub(in crate::store) async fn keep(
        &mut self,
        state: &WriterState,
        jobs: &[Vec<Entry>],
        deadline: Instant,
        stop: &CancellationToken,
    ) -> Vec<Outcome> {
        let all = |outcome: Outcome| jobs.iter().map(|_| outcome.clone()).collect();
        let refuse = |error: StoreError| {
            jobs.iter().map(|job| writer::refuse(state, job, error.clone())).collect()
        };
        if state.has_failed() {
            return all(Err(StoreError::Failed));
        }
        if jobs.iter().all(Vec::is_empty) {
            // A barrier: everything queued before is durable by now.
            return all(Ok(()));
        }
        let mut one_by_one = jobs.iter().any(|job| state.continues_broken(job));
        let mut sent = None;
        let (mut pause, longest) = PAUSES;
        let mut given_up = std::pin::pin!(async {
            stop.cancelled().await;
            tokio::time::sleep(STOP_PATIENCE).await;
        });
        loop {
            let attempt = self.attempt(state, jobs, one_by_one, &mut sent);
            let attempted = tokio::select! {
                attempted = answered(state, attempt) => attempted,
                () = &mut given_up => {
                    self.connection = None;
                    return refuse(StoreError::Stopped(Stopped::Server));
                }
            };
            match attempted {
                Ok(outcomes) => {
                    state.set_unblocked();
                    return outcomes;
                }
                Err(Failure::Refused(_)) if !one_by_one => one_by_one = true,
                // No single job is at fault.
                Err(Failure::Refused(error)) => return refuse(error.into()),
                Err(Failure::Fatal(error)) => {
                    self.note_fatal(state, &*error);
                    return all(Err(StoreError::Failed));
                }
                Err(Failure::Away(error)) => {
                    self.connection = None;
                    state.set_blocked(blocked_by(&error), &error);
                    let is_in_doubt = sent.as_ref().is_some_and(|sent: &Sent| !sent.is_undone);
                    if !is_in_doubt && Instant::now() >= deadline {
                        return refuse(StoreError::Away);
                    }
                    tokio::select! {
                        () = tokio::time::sleep(pause) => {}
                        () = &mut given_up => return refuse(StoreError::Stopped(Stopped::Server)),
                    }
                    pause = (pause * 2).min(longest);
                }
            }
        }
    }

    /// Checks that this server still has the database; called every [`WATCH`] while nothing is written.
    pub(in crate::store) async fn watch(&mut self, state: &WriterState) {
        if state.has_failed() {
            return;
        }
        match answered(state, self.reach()).await {
            Ok(_) => state.set_unblocked(),
            Err(Failure::Fatal(error)) => self.note_fatal(state, &*error),
            Err(Failure::Away(error) | Failure::Refused(error)) => {
                self.connection = None;
                state.set_blocked(blocked_by(&error), &error);
            }
        }
    }

    /// Deletes this server's row and disconnects.
    pub(in crate::store) async fn leave(mut self) -> Result<(), sqlx::Error> {
        let Some(mut connection) = self.connection.take() else { return Ok(()) };
        let row = query("DELETE FROM nodes WHERE incarnation = $1").bind(self.incarnation);
        row.execute(&mut connection).await?;
        if let Some(cluster) = &self.cluster {
            cluster.close().await;
        }
        connection.close().await
    }

    async fn attempt(
        &mut self,
        state: &WriterState,
        jobs: &[Vec<Entry>],
        one_by_one: bool,
        sent: &mut Option<Sent>,
    ) -> Result<Vec<Outcome>, Failure> {
        if let Some(outcomes) = self.settle(sent).await? {
            return Ok(outcomes);
        }
        let started = Instant::now();
        let connection = self.connection.as_mut().expect("it was reached");
        let place = CommitPosition {
            incarnation: self.incarnation,
            before: self.committed,
            is_shared: self.cluster.is_some(),
        };
        let outcomes = if one_by_one {
            commit_each(connection, state, jobs, place, sent).await?
        } else {
            commit_all(connection, jobs, place, sent).await?
        };
        *sent = None;
        self.committed += 1;
        telemetry::note_commit(jobs.iter().map(Vec::len).sum(), started.elapsed());
        Ok(outcomes)
    }

    /// Finds out whether a sent commit is done, and returns its outcomes if so. The commit stays `sent` and uncounted until a
    /// witness is acknowledged: before that a standby without it may still take over, and its row would say "not done".
    async fn settle(&mut self, sent: &mut Option<Sent>) -> Result<Option<Vec<Outcome>>, Failure> {
        if self.connection.is_some() && sent.is_none() {
            return Ok(None);
        }
        let is_sent = sent.is_some();
        // An error here says nothing about the jobs, some of which may be stored.
        let in_doubt = |failure| match failure {
            Failure::Refused(error) if is_sent => Failure::Away(error),
            failure => failure,
        };
        let is_done = self.reach().await.map_err(in_doubt)?;
        match (is_sent, is_done) {
            (true, true) => {
                self.witness().await.map_err(in_doubt)?;
                tracing::info!("the answer to a commit was lost: the commit was done");
                self.committed += 1;
                Ok(sent.take().map(|sent| sent.outcomes))
            }
            (false, true) => {
                let (found, known) = (self.committed + 1, self.committed);
                Err(Excluded::Lost { found, known }.into())
            }
            (true, false) => {
                tracing::info!(
                    "the answer to a commit was lost: the commit was not done, and is repeated"
                );
                if let Some(sent) = sent {
                    sent.is_undone = true;
                }
                Ok(None)
            }
            (false, false) => Ok(None),
        }
    }

    /// Connects if necessary and reads this server's row; true if it counts one commit more than the known ones.
    async fn reach(&mut self) -> Result<bool, Failure> {
        if self.connection.is_none() {
            let connection = self.server.try_connect().await.map_err(Failure::Away)?;
            let mut connection = Connection::Postgres(connection);
            self.server.set_up_writer(&mut connection).await.map_err(failure)?;
            let name = session_name(self.incarnation);
            session::set_name(&mut connection, &name).await.map_err(failure)?;
            self.end_old_sessions(&mut connection).await?;
            self.lock_again(&mut connection).await?;
            self.connection = Some(connection);
        }
        let connection = self.connection.as_mut().expect("it is connected");
        let row =
            query("SELECT committed FROM nodes WHERE incarnation = $1").bind(self.incarnation);
        let found: Option<i64> = row.optional(connection).await.map_err(failure)?;
        let known = self.committed;
        match found.ok_or(Excluded::TakenOver)? {
            found if found == known => Ok(false),
            found if found == known + 1 => Ok(true),
            found => Err(Excluded::Lost { found, known }.into()),
        }
    }

    /// Commits a no-op after a commit whose answer was lost. That commit may still have waited for a standby when its session
    /// ended; once the no-op is acknowledged, the standby has both.
    async fn witness(&mut self) -> Result<(), Failure> {
        let connection = self.connection.as_mut().expect("it was reached");
        let touch = query("UPDATE nodes SET name = name WHERE incarnation = $1");
        match touch.bind(self.incarnation).execute(connection).await.map_err(failure)? {
            1 => Ok(()),
            _ => Err(Excluded::TakenOver.into()),
        }
    }

    /// Terminates the old sessions of this server and waits for their end. PostgreSQL may not have noticed a broken
    /// connection, and a commit that waits for a standby is visible in no row before its session ends.
    async fn end_old_sessions(&self, connection: &mut Connection) -> Result<(), Failure> {
        let until = Instant::now() + TERMINATE_PATIENCE;
        let own = session_name(self.incarnation);
        loop {
            let old = session::others_called(connection, &own).await.map_err(failure)?;
            if old.is_empty() {
                return Ok(());
            }
            if Instant::now() >= until {
                let stays = "an old session of this server does not end".to_owned();
                return Err(Failure::Away(sqlx::Error::Protocol(stays)));
            }
            for pid in old {
                session::terminate(connection, pid).await.map_err(failure)?;
            }
            tokio::time::sleep(PAUSES.0).await;
        }
    }

    /// Takes the lock of the database for a new session.
    async fn lock_again(&self, connection: &mut Connection) -> Result<(), Failure> {
        let until = Instant::now() + TERMINATE_PATIENCE;
        let is_shared = self.cluster.is_some();
        while !session::try_lock(connection, is_shared).await.map_err(failure)? {
            let holder = session::lock_holder(connection).await.map_err(failure)?;
            // Another server has the lock or is taking it, so this server's row is gone.
            if holder.is_some() && Instant::now() >= until {
                return Err(Excluded::TakenOver.into());
            }
            tokio::time::sleep(PAUSES.0).await;
        }
        Ok(())
    }
}

/// Position of a commit: after `before` earlier commits of this server.
#[derive(Clone, Copy)]
pub(in crate::store) struct CommitPosition {
    pub(in crate::store) incarnation: i64,
    pub(in crate::store) before: i64,
    /// Whether the database belongs to a cluster.
    is_shared: bool,
}

/// Writes all jobs, or nothing if a statement is refused.
async fn commit_all(
    connection: &mut Connection,
    jobs: &[Vec<Entry>],
    place: CommitPosition,
    sent: &mut Option<Sent>,
) -> Result<Vec<Outcome>, Failure> {
    let outcomes: Vec<Outcome> = jobs.iter().map(|_| Ok(())).collect();
    let only_rows =
        jobs.iter().flatten().all(|entry| matches!(entry, Entry::Act(_) | Entry::Round(_)));
    if only_rows {
        // A single statement commits by itself: no transaction stays open while this process is suspended.
        *sent = Some(Sent { outcomes: outcomes.clone(), is_undone: false });
        let written = super::rows::append(connection, place, jobs.iter().flatten()).await;
        let is_ours = written.map_err(|error| settled(failure(error), sent))?;
        return if is_ours { Ok(outcomes) } else { Err(not_ours()) };
    }
    begin(connection, place).await?;
    let written = async {
        writer::write(connection, jobs.iter().flatten()).await?;
        if place.is_shared {
            cluster::write(connection, place.incarnation, jobs.iter().flatten()).await?;
        }
        Ok(())
    };
    if let Err(error) = written.await {
        return Err(roll_back(connection, failure(error)).await);
    }
    commit(connection, outcomes, sent).await
}

/// Writes jobs one by one behind savepoints: refused jobs leave no trace, the others are committed.
async fn commit_each(
    connection: &mut Connection,
    state: &WriterState,
    jobs: &[Vec<Entry>],
    place: CommitPosition,
    sent: &mut Option<Sent>,
) -> Result<Vec<Outcome>, Failure> {
    begin(connection, place).await?;
    let mut outcomes = Vec::with_capacity(jobs.len());
    for job in jobs {
        let outcome = writer::write_alone(connection, state, job, failure).await?;
        if place.is_shared && outcome.is_ok() {
            let written = cluster::write(connection, place.incarnation, job.iter()).await;
            written.map_err(failure)?;
        }
        outcomes.push(outcome);
    }
    commit(connection, outcomes, sent).await
}

/// Begins a transaction and counts its commit; fails unless `place` is next.
async fn begin(connection: &mut Connection, place: CommitPosition) -> Result<(), Failure> {
    query("BEGIN").execute(connection).await.map_err(failure)?;
    let counted = query(
        "UPDATE nodes SET committed = committed + 1 WHERE incarnation = $1 AND committed = $2",
    );
    let counted = counted.bind(place.incarnation).bind(place.before).execute(connection).await;
    match counted.map_err(failure)? {
        1 => Ok(()),
        _ => Err(roll_back(connection, not_ours()).await),
    }
}

async fn commit(
    connection: &mut Connection,
    outcomes: Vec<Outcome>,
    sent: &mut Option<Sent>,
) -> Result<Vec<Outcome>, Failure> {
    *sent = Some(Sent { outcomes: outcomes.clone(), is_undone: false });
    match query("COMMIT").execute(connection).await {
        Ok(_) => Ok(outcomes),
        Err(error) => Err(settled(failure(error), sent)),
    }
}

/// A commit answered with an error is not done; one without an answer may be.
fn settled(failure: Failure, sent: &mut Option<Sent>) -> Failure {
    match &failure {
        Failure::Refused(_) | Failure::Fatal(_) => *sent = None,
        Failure::Away(_) => {}
    }
    failure
}

/// This server's row does not have the expected counter: the server was excluded, or an earlier attempt is done after all.
/// The next read of the row tells which.
fn not_ours() -> Failure {
    Failure::Away(sqlx::Error::Protocol("the row of this server in `nodes` has changed".to_owned()))
}

async fn roll_back(connection: &mut Connection, failure: Failure) -> Failure {
    match query("ROLLBACK").execute(connection).await {
        Ok(_) => failure,
        Err(error) => Failure::Away(error),
    }
}

/// `application_name` of this server's sessions.
pub(super) fn session_name(incarnation: i64) -> String {
    format!("swarmbench/{incarnation}")
}

/// The time of day by the database's clock.
async fn now_ms(connection: &mut Connection) -> Result<i64, sqlx::Error> {
    query("SELECT CAST(extract(epoch FROM clock_timestamp()) * 1000 AS bigint)")
        .one(connection)
        .await
}
