//! The writer of PostgreSQL: a group of jobs is one commit, which counts up the row of this server in `nodes`.
//!
//! A server that takes the database over deletes that row, so nothing that was queued before can be written afterwards. And where the
//! connection breaks while a commit is under way, the number in the row says whether it was done: nothing is guessed, and
//! nothing is written twice. So PostgreSQL may be restarted, or fail over, and it is a pause.

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

/// How often the row of this server is looked at while nothing is written.
pub(in crate::store) const WATCH: Duration = Duration::from_secs(1);

/// The first and the longest pause between two tries to connect.
const PAUSES: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(1));

/// A database that takes longer to answer is not reached, as far as anybody can tell.
const ANSWER_USUAL: Duration = Duration::from_secs(5);

/// How long an answer of the database is waited for. Then its connection is given up, and what was sent is settled.
const ANSWER_PATIENCE: Duration = Duration::from_secs(30);

/// How long a server that is told to stop waits for a database that is not reached.
const STOP_PATIENCE: Duration = Duration::from_secs(5);

/// How long an old session of this server is waited for after it was told to end.
const TERMINATE_PATIENCE: Duration = Duration::from_secs(5);

/// The right to write to a database of PostgreSQL.
pub(in crate::store) struct Node {
    server: Server,
    /// None while the database is not reached.
    connection: Option<Connection>,
    /// The number of this server in `nodes`, which no other server ever gets.
    incarnation: i64,
    /// How many commits of this server are known to be done.
    committed: i64,
    /// Of one of several servers.
    cluster: Option<Arc<Cluster>>,
}

/// A commit that was sent, and whose answer is not known.
struct Sent {
    outcomes: Vec<Outcome>,
    /// Whether the row of this server said since that it is not done: the database may have failed over meanwhile, and back.
    is_undone: bool,
}

/// Why the row of this server is not as it was left: nothing may be acknowledged any more.
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

/// Excludes all servers that had the database before and are not connected now: none of them commits anything any more. Waits
/// for a commit that one of them has under way.
pub(in crate::store) async fn exclude_others(
    connection: &mut Connection,
) -> Result<(), sqlx::Error> {
    query("DELETE FROM nodes").execute(connection).await.map(drop)
}

/// What an error means for the transaction in which it came, by the class of its code.
pub(in crate::store) fn failure(error: sqlx::Error) -> Failure {
    let Some(code) = session::sqlstate(&error) else {
        return match error {
            sqlx::Error::Encode(_)
            | sqlx::Error::Decode(_)
            | sqlx::Error::ColumnDecode { .. }
            // A row that an entry changes is not there.
            | sqlx::Error::RowNotFound => Failure::Refused(error),
            _ => Failure::Away(error),
        };
    };
    match &code[..2] {
        // A value, a constraint, a limit, or a statement that is wrong for this one job.
        "21" | "22" | "23" | "42" | "54" => Failure::Refused(error),
        // A lost connection, a full disk, no memory, a server that ends or starts, and all else: the transaction is not done.
        _ => Failure::Away(error),
    }
}

/// Waits for an answer of the database, for a limited time. That it takes long is noted before that.
async fn answered<T>(
    state: &WriterState,
    asked: impl Future<Output = Result<T, Failure>>,
) -> Result<T, Failure> {
    let mut asked = std::pin::pin!(asked);
    if let Ok(answer) = tokio::time::timeout(ANSWER_USUAL, &mut asked).await {
        return answer;
    }
    let late = || sqlx::Error::Io(std::io::ErrorKind::TimedOut.into());
    state.set_blocked(Blocked::Away, &late());
    let left = ANSWER_PATIENCE.saturating_sub(ANSWER_USUAL);
    tokio::time::timeout(left, asked).await.unwrap_or_else(|_| Err(Failure::Away(late())))
}

/// The code of an error that comes from a full disk.
const DISK_FULL: &str = "53100";

fn blocked_by(error: &sqlx::Error) -> Blocked {
    if session::sqlstate(error).as_deref() == Some(DISK_FULL) {
        Blocked::Full
    } else {
        Blocked::Away
    }
}

impl Node {
    /// Gets a number for a process that has the lock of the database, alone or together with others.
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

    /// Notes that this server cannot go on. One of several leaves its games to the others: it ends, and is started again.
    fn note_fatal(
        &self,
        state: &WriterState,
        error: &(dyn std::error::Error + Send + Sync + 'static),
    ) {
        match error.downcast_ref::<Excluded>() {
            Some(Excluded::TakenOver) => state.exclude(&error),
            Some(Excluded::Lost { .. }) | None if self.cluster.is_some() => state.exclude(&error),
            Some(Excluded::Lost { .. }) | None => state.fail(&error),
        }
    }

    /// This server as one of several, if it is.
    pub(in crate::store) fn cluster(&self) -> Option<&Arc<Cluster>> {
        self.cluster.as_ref()
    }

    /// Writes jobs in one commit; the outcome of each, in their order. While the database is not reached it tries again: until
    /// the deadline, or without end where a commit was sent and nobody knows yet whether it is done; but not for long after
    /// `stop`.
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
            // A barrier: what was queued before is durable by now.
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
                // No job alone is at fault.
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

    /// Whether this server still has the database. To be asked now and then while nothing is written.
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

    /// Gives the database back.
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
        let place = Place {
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

    /// Finds out whether a commit that was sent is done; its outcomes if it is. The commit stays `sent`, and uncounted, until a
    /// witness of it was acknowledged: before that a standby without it may still take over, and its row then says that it is not done.
    async fn settle(&mut self, sent: &mut Option<Sent>) -> Result<Option<Vec<Outcome>>, Failure> {
        if self.connection.is_some() && sent.is_none() {
            return Ok(None);
        }
        let is_sent = sent.is_some();
        // What is refused here says nothing of the jobs, of which some may be stored.
        let in_doubt = |failure| match failure {
            Failure::Refused(error) if is_sent => Failure::Away(error),
            failure => failure,
        };
        let is_done = self.reach().await.map_err(in_doubt)?;
        match (is_sent, is_done) {
            (true, true) => {
                self.witness().await.map_err(in_doubt)?;
                tracing::info!("a commit whose answer was lost is done");
                self.committed += 1;
                Ok(sent.take().map(|sent| sent.outcomes))
            }
            (false, true) => {
                let (found, known) = (self.committed + 1, self.committed);
                Err(Excluded::Lost { found, known }.into())
            }
            (true, false) => {
                tracing::info!("a commit whose answer was lost is not done, and made again");
                if let Some(sent) = sent {
                    sent.is_undone = true;
                }
                Ok(None)
            }
            (false, false) => Ok(None),
        }
    }

    /// Connects where there is no connection, and reads the row of this server: whether there is a commit more than the known ones.
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

    /// Commits something after a commit whose answer was lost. That one may still have waited for a standby when its session
    /// ended; when this one is acknowledged, the standby has both.
    async fn witness(&mut self) -> Result<(), Failure> {
        let connection = self.connection.as_mut().expect("it was reached");
        let touch = query("UPDATE nodes SET name = name WHERE incarnation = $1");
        match touch.bind(self.incarnation).execute(connection).await.map_err(failure)? {
            1 => Ok(()),
            _ => Err(Excluded::TakenOver.into()),
        }
    }

    /// Ends the sessions by which this server has written so far, and waits until they are gone. PostgreSQL may not have noticed
    /// that a connection broke, and a commit that waits for a standby shows in no row before its session ends.
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
            // Another server has the lock, or takes it at this moment: then the row of this one is gone.
            if holder.is_some() && Instant::now() >= until {
                return Err(Excluded::TakenOver.into());
            }
            tokio::time::sleep(PAUSES.0).await;
        }
        Ok(())
    }
}

/// Where a commit belongs: behind the commits of this server that are known to be done.
#[derive(Clone, Copy)]
pub(in crate::store) struct Place {
    pub(in crate::store) incarnation: i64,
    pub(in crate::store) before: i64,
    /// Whether other servers play on the database, too.
    is_shared: bool,
}

/// Writes all entries of all jobs, or nothing where a statement is refused.
async fn commit_all(
    connection: &mut Connection,
    jobs: &[Vec<Entry>],
    place: Place,
    sent: &mut Option<Sent>,
) -> Result<Vec<Outcome>, Failure> {
    let outcomes: Vec<Outcome> = jobs.iter().map(|_| Ok(())).collect();
    let only_rows =
        jobs.iter().flatten().all(|entry| matches!(entry, Entry::Act(_) | Entry::Round(_)));
    if only_rows {
        // One statement, which commits by itself: no transaction of this process is ever open while it sleeps.
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

/// Writes jobs one by one: those that are refused leave no trace, and the others are committed.
async fn commit_each(
    connection: &mut Connection,
    state: &WriterState,
    jobs: &[Vec<Entry>],
    place: Place,
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

/// Begins a transaction at its place behind all earlier ones of this server.
async fn begin(connection: &mut Connection, place: Place) -> Result<(), Failure> {
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

/// A commit that was answered with an error is not done, and one that was not answered may be.
fn settled(failure: Failure, sent: &mut Option<Sent>) -> Failure {
    match &failure {
        Failure::Refused(_) | Failure::Fatal(_) => *sent = None,
        Failure::Away(_) => {}
    }
    failure
}

/// The row of this server is not at the place of this commit: it was taken over, or an earlier try was done after all. What
/// it is tells the row, which is read next.
fn not_ours() -> Failure {
    Failure::Away(sqlx::Error::Protocol("the row of this server in `nodes` has changed".to_owned()))
}

async fn roll_back(connection: &mut Connection, failure: Failure) -> Failure {
    match query("ROLLBACK").execute(connection).await {
        Ok(_) => failure,
        Err(error) => Failure::Away(error),
    }
}

/// What the session of a server calls itself.
pub(super) fn session_name(incarnation: i64) -> String {
    format!("swarmbench/{incarnation}")
}

/// The time of day by the database's clock.
async fn now_ms(connection: &mut Connection) -> Result<i64, sqlx::Error> {
    query("SELECT CAST(extract(epoch FROM clock_timestamp()) * 1000 AS bigint)")
        .one(connection)
        .await
}
