//! A connection to a database of either engine.

use sqlx::pool::PoolConnection;
use sqlx::postgres::PgConnection;
use sqlx::sqlite::SqliteConnection;
use sqlx::{Connection as _, Postgres, Sqlite};

use super::query;

/// A connection to either engine, owned or from a pool.
pub(in crate::store) enum Connection {
    Sqlite(SqliteConnection),
    Postgres(PgConnection),
    PooledSqlite(PoolConnection<Sqlite>),
    PooledPostgres(PoolConnection<Postgres>),
}

/// The connection of the engine, for engine-specific calls.
pub(in crate::store) enum Engine<'c> {
    Sqlite(&'c mut SqliteConnection),
    Postgres(&'c mut PgConnection),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::store) enum Begin {
    /// All queries of the transaction see one snapshot.
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

    /// Runs `work` in a transaction and rolls back if it fails. Not for pooled connections: if this future were dropped, the
    /// connection would return to its pool with an open transaction.
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
        // The error of the work says more than that of the rollback.
        let done = done?;
        ended?;
        Ok(done)
    }

    /// Closes an owned connection; returns a pooled one to its pool.
    pub(in crate::store) async fn close(self) -> Result<(), sqlx::Error> {
        match self {
            Self::Sqlite(connection) => connection.close().await,
            Self::Postgres(connection) => connection.close().await,
            Self::PooledSqlite(_) | Self::PooledPostgres(_) => Ok(()),
        }
    }
}
