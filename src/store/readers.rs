//! Connections that read: some for games, some for spectators and other readers, shared fairly.

use std::ops::{Deref, DerefMut};
use std::time::Duration;

use sqlx::Connection as _;
use sqlx::postgres::{PgConnectOptions, PgPool, PgPoolOptions};
use sqlx::sqlite::{SqliteConnectOptions, SqlitePool, SqlitePoolOptions};

use super::StoreError;
use super::sql::Connection;
use crate::fair::{FairLimit, HEAVY_AT_ONCE_MAX, Party, Permit, Rank, Shares};

/// Connections that read for running games, for players and entries, and for the server itself.
const GAMES: usize = 3;

/// Pages that each of these connections caches: the upper pages of the indexes of a million episodes.
const CACHE_KIB: u32 = 8 * 1024;

/// Rows between the thread of a connection and who reads them. All rows of a query are kept anyway; with a smaller
/// buffer the two threads wake each other for each row.
const ROWS_BUFFERED_MAX: usize = 4096;

/// A connection that was idle for longer may have broken.
const IDLE_WHOLE: Duration = Duration::from_millis(500);

/// How long a request waits for a connection to read.
const PATIENCE: Duration = Duration::from_secs(5);

tokio::task_local! {
    static PATIENT: ();
}

/// Runs a future whose reads wait for a connection however long that takes: an answer that is being sent would
/// break off. The caller bounds how many there are.
pub async fn patiently<F: Future>(read: F) -> F::Output {
    PATIENT.scope((), read).await
}

/// The same for work that keeps a thread busy.
pub fn patiently_blocking<T>(read: impl FnOnce() -> T) -> T {
    PATIENT.sync_scope((), read)
}

/// Connections that read. Cloning shares them.
#[derive(Clone, Debug)]
pub(super) struct Readers {
    games: Lane,
    others: Lane,
}

/// Connections for one purpose, shared fairly.
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

/// How readers connect.
#[derive(Clone)]
pub(super) enum ReaderOptions {
    Sqlite(SqliteConnectOptions),
    Postgres(PgConnectOptions),
}

/// A connection that reads until this is dropped.
pub(super) struct Reading {
    // Dropped before the permit.
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

/// Gives a connection that reads [`CACHE_KIB`] of pages.
pub(super) fn cached(options: SqliteConnectOptions) -> SqliteConnectOptions {
    // Negative: KiB, not pages.
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
                    // One that is in use was whole a moment ago; asking costs as much as a short query.
                    .test_before_acquire(false)
                    .before_acquire(|connection, last| {
                        Box::pin(async move {
                            // A broken one is closed, and the next one is asked.
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
            // A request with a permit finds a connection, unless none can be made.
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
        // One is left for the next caller.
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

    /// Waits for a connection for the party of this task.
    pub(super) async fn get(&self) -> Result<Reading, StoreError> {
        let (party, rank) = (Party::current(), Rank::current());
        let lane = match rank {
            Rank::Urgent => &self.games,
            Rank::Normal => &self.others,
        };
        let is_patient = PATIENT.try_with(|()| ()).is_ok();
        let permit = if party == Party::SERVER || is_patient {
            // The server itself reads little, and always waits, however many others read.
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
        // Games, and the server itself, have their own.
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
