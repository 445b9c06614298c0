//! A connection to a database of either engine.

use sqlx::pool::PoolConnection;
use sqlx::postgres::PgConnection;
use sqlx::sqlite::SqliteConnection;
use sqlx::{Connection as _, Postgres, Sqlite};

use super::query;

/// A connection of its own, or one of a pool until it is dropped.
pub(in crate::store) enum Connection {
    Sqlite(SqliteConnection),
    Postgres(PgConnection),
    PooledSqlite(PoolConnection<Sqlite>),
    PooledPostgres(PoolConnection<Postgres>),
}

/// The engine of a connection, for what only one of them has.
pub(in crate::store) enum Engine<'c> {
    Sqlite(&'c mut SqliteConnection),
    Postgres(&'c mut PgConnection),
}

/// What a transaction is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::store) enum Begin {
    /// All its queries see the database at one moment.
    Read,
    Write,
}

impl Connection {
    pub(in crate::store) fn engine(&mut self) -> Engine<'_> {
        match self {
            Self::Sqlite(connection) => Engine::Sqlite(connection),
            Self::PooledSqlite(connection) => Engine::Sqlite(&mut *connection),
            Self::Postgres(connection) => Engine::Postgres(connection),
            Self::PooledPostgres(connection) => Engine::Postgres(&mut *connection),
        }
    }

    pub(in crate::store) const fn is_postgres(&self) -> bool {
        match self {
            Self::Sqlite(_) | Self::PooledSqlite(_) => false,
            Self::Postgres(_) | Self::PooledPostgres(_) => true,
        }
    }

    /// Does something in a transaction, which is rolled back where that fails. Not for connections of a pool: one that was
    /// given back while this waits would keep the transaction open.
    pub(in crate::store) async fn transaction<T, E: From<sqlx::Error>>(
        &mut self,
        begin: Begin,
        work: impl AsyncFnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<T, E> {
        let first = match (begin, self.is_postgres()) {
            (Begin::Read, false) | (Begin::Write, true) => "BEGIN",
            (Begin::Write, false) => "BEGIN IMMEDIATE",
            (Begin::Read, true) => "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY",
        };
        query(first).execute(self).await?;
        let done = work(self).await;
        let last = if done.is_ok() { "COMMIT" } else { "ROLLBACK" };
        let ended = query(last).execute(self).await;
        // Why the work failed says more than that its transaction could not be rolled back.
        let done = done?;
        ended?;
        Ok(done)
    }

    /// Closes a connection of its own; one of a pool is given back.
    pub(in crate::store) async fn close(self) -> Result<(), sqlx::Error> {
        match self {
            Self::Sqlite(connection) => connection.close().await,
            Self::Postgres(connection) => connection.close().await,
            Self::PooledSqlite(_) | Self::PooledPostgres(_) => Ok(()),
        }
    }
}
