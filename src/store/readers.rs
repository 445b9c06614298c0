//! Reader connections: one lane for games, one for all others, each shared fairly between parties.

use std::ops::{Deref, DerefMut};
use std::time::Duration;

use sqlx::Connection as _;
use sqlx::postgres::{PgConnectOptions, PgPool, PgPoolOptions};
use sqlx::sqlite::{SqliteConnectOptions, SqlitePool, SqlitePoolOptions};

use super::StoreError;
use super::postgres::session::set_up_reader;
use super::sql::Connection;
use crate::fair::{FairLimit, HEAVY_AT_ONCE_MAX, Party, Permit, Rank, Shares};

/// Connections of the lane for games: players, runs and the server itself.
const GAMES: usize = 3;

/// KiB of page cache of each connection: enough for the upper index pages of a million episodes.
const CACHE_KIB: u32 = 8 * 1024;

/// Rows buffered between a connection's thread and the task that reads them. A query's rows are all collected anyway; with a
/// smaller buffer the two threads wake each other for every row.
const ROWS_BUFFERED_MAX: usize = 4096;

/// A connection that was idle for longer may be broken and is tested before use.
const IDLE_WHOLE: Duration = Duration::from_millis(500);

/// A request that waits longer for a reader connection is refused.
const PATIENCE: Duration = Duration::from_secs(5);

tokio::task_local! {
    static PATIENT: ();
}

/// Runs a future whose reads wait for a connection without a timeout: a refusal would break off an answer that is already
/// being sent. The caller bounds the number of such futures.
pub async fn patiently<F: Future>(read: F) -> F::Output {
    PATIENT.scope((), read).await
}

/// [`patiently`] for blocking work.
pub fn patiently_blocking<T>(read: impl FnOnce() -> T) -> T {
    PATIENT.sync_scope((), read)
}

/// The pools of both lanes. Clones share them.
#[derive(Clone, Debug)]
pub(super) struct Readers {
    games: Lane,
    others: Lane,
}

/// A pool of connections with permits that are shared fairly.
#[derive(Clone, Debug)]
struct Lane {
    pool: Pool,
    permits: FairLimit,
}

#[derive(Clone, Debug)]
enum Pool {
    Sqlite(SqlitePool),
    Postgres(PgPool),
}

#[derive(Clone)]
pub(super) enum ReaderOptions {
    Sqlite(SqliteConnectOptions),
    Postgres(PgConnectOptions),
}

/// A borrowed connection with its permit; both are returned on drop.
pub(super) struct Reading {
    // Declared first, so that it is dropped before the permit.
    connection: Connection,
    _permit: Permit,
}

impl Deref for Reading {
    type Target = Connection;

    fn deref(&self) -> &Connection {
        &self.connection
    }
}

impl DerefMut for Reading {
    fn deref_mut(&mut self) -> &mut Connection {
        &mut self.connection
    }
}

/// Sets the page cache to [`CACHE_KIB`].
pub(super) fn cached(options: SqliteConnectOptions) -> SqliteConnectOptions {
    // Negative values are KiB, positive ones pages.
    options.pragma("cache_size", format!("-{CACHE_KIB}"))
}

impl Pool {
    async fn open(options: ReaderOptions, slots: usize) -> Result<Self, sqlx::Error> {
        let slots = u32::try_from(slots).unwrap_or(u32::MAX);
        Ok(match options {
            ReaderOptions::Sqlite(options) => {
                let pool =
                    SqlitePoolOptions::new().max_connections(slots).acquire_timeout(PATIENCE);
                let options = options.row_buffer_size(ROWS_BUFFERED_MAX);
                Self::Sqlite(pool.connect_with(options).await?)
            }
            ReaderOptions::Postgres(options) => {
                let pool = PgPoolOptions::new()
                    .max_connections(slots)
                    .acquire_timeout(PATIENCE)
                    // A connection used a moment ago is whole, and a ping costs as much as a short query.
                    .test_before_acquire(false)
                    .after_connect(|connection, _| Box::pin(set_up_reader(connection)))
                    .before_acquire(|connection, last| {
                        Box::pin(async move {
                            // The pool closes a connection that fails the ping, and tries the next one.
                            Ok(last.idle_for <= IDLE_WHOLE || connection.ping().await.is_ok())
                        })
                    })
                    .idle_timeout(None)
                    .max_lifetime(None);
                Self::Postgres(pool.connect_with(options).await?)
            }
        })
    }

    async fn acquire(&self) -> Result<Connection, StoreError> {
        match self {
            Self::Sqlite(pool) => Ok(Connection::PooledSqlite(pool.acquire().await?)),
            // Permits are as many as connections, so an error means that the database cannot be reached.
            Self::Postgres(pool) => {
                let connection = Box::pin(pool.acquire()).await.map_err(|_| StoreError::Away)?;
                Ok(Connection::PooledPostgres(connection))
            }
        }
    }

    async fn close(&self) {
        match self {
            Self::Sqlite(pool) => pool.close().await,
            Self::Postgres(pool) => pool.close().await,
        }
    }
}

impl Lane {
    async fn open(options: ReaderOptions, slots: usize) -> Result<Self, sqlx::Error> {
        let pool = Pool::open(options, slots).await?;
        // One slot stays free for the next caller.
        let shares = Shares { slots, ..Shares::of(slots - 1) };
        Ok(Self { pool, permits: FairLimit::heavy(shares, PATIENCE) })
    }
}

impl Readers {
    pub(super) async fn open(options: ReaderOptions) -> Result<Self, sqlx::Error> {
        Ok(Self {
            games: Lane::open(options.clone(), GAMES).await?,
            others: Lane::open(options, HEAVY_AT_ONCE_MAX).await?,
        })
    }

    /// Waits for a connection, on behalf of the current party.
    pub(super) async fn get(&self) -> Result<Reading, StoreError> {
        let (party, rank) = (Party::current(), Rank::current());
        let lane = match rank {
            Rank::Urgent => &self.games,
            Rank::Normal => &self.others,
        };
        let is_patient = PATIENT.try_with(|()| ()).is_ok();
        let permit = if party == Party::SERVER || is_patient {
            // The server itself reads little, and waits without a timeout.
            lane.permits.acquire_always(party, rank).await
        } else {
            lane.permits.acquire(party, rank).await.map_err(|_| StoreError::Busy)?
        };
        let connection = lane.pool.acquire().await?;
        Ok(Reading { connection, _permit: permit })
    }

    pub(super) async fn close(&self) {
        self.games.pool.close().await;
        self.others.pool.close().await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fair::{Group, WAITING_PER_GROUP_MAX};
    use crate::keys::OwnerKey;

    #[tokio::test]
    async fn readers_leave_connections_to_each_other_and_to_games() {
        let directory = tempfile::tempdir().expect("a directory");
        let options = SqliteConnectOptions::new()
            .filename(directory.path().join("test.db"))
            .create_if_missing(true);
        let readers = Readers::open(ReaderOptions::Sqlite(options)).await.expect("a database");
        let party = |number| Party::of(Group::Owner(OwnerKey(number)));
        let look = |number| Rank::Normal.scope(party(number).scope(readers.get()));
        let mut held = Vec::new();
        for _ in 1..HEAVY_AT_ONCE_MAX {
            held.push(look(1).await.expect("a connection"));
        }
        let mut fourth = Box::pin(look(1));
        assert!(futures::poll!(&mut fourth).is_pending(), "the last one is kept for another group");
        drop(look(2).await.expect("a connection"));
        // Games and the server itself have the other lane.
        let play = Rank::Urgent.scope(party(1).scope(readers.get()));
        drop(play.await.expect("a connection"));
        drop(readers.get().await.expect("a connection"));
        held.pop();
        drop(fourth.await.expect("its turn"));
    }

    #[tokio::test]
    async fn an_answer_that_is_being_sent_waits_where_others_are_refused() {
        let directory = tempfile::tempdir().expect("a directory");
        let options = SqliteConnectOptions::new()
            .filename(directory.path().join("test.db"))
            .create_if_missing(true);
        let readers = Readers::open(ReaderOptions::Sqlite(options)).await.expect("a database");
        let party = Party::of(Group::Owner(OwnerKey(1)));
        let look = || Rank::Normal.scope(party.scope(readers.get()));
        let mut held = Vec::new();
        for _ in 1..HEAVY_AT_ONCE_MAX {
            held.push(look().await.expect("a connection"));
        }
        let mut waits: Vec<_> = (0..WAITING_PER_GROUP_MAX).map(|_| Box::pin(look())).collect();
        for wait in &mut waits {
            assert!(futures::poll!(wait).is_pending());
        }
        assert!(look().await.is_err_and(|error| matches!(error, StoreError::Busy)));
        let mut patient = Box::pin(patiently(look()));
        assert!(futures::poll!(&mut patient).is_pending());
        drop((held, waits));
        drop(patient.await.expect("its turn"));
    }
}
