//! A bare writer of SQLite with the server's tables, in its own folder.

use std::path::{Path, PathBuf};

use sqlx::migrate::Migrator;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqliteSynchronous};
use sqlx::{AssertSqlSafe, ConnectOptions, Connection};

use super::{AT_MS, DIGEST, Group, HEAD, SCORE};
use crate::load::LoadError;

/// Rows per statement: each binds six values, and SQLite allows some thousands.
const ROWS_MAX: usize = 1000;

pub(super) struct Writer {
    pub(super) connection: SqliteConnection,
    folder: Folder,
}

struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        // A folder that cannot be removed stays behind.
        drop(std::fs::remove_dir_all(&self.0));
    }
}

impl Writer {
    pub(super) async fn open(dir: &Path, tables: &Migrator) -> Result<Self, LoadError> {
        let failed = LoadError::of("the database of the bare writer cannot be created");
        let folder = Folder(dir.join(format!("swarmbench-loadtest-{}", std::process::id())));
        std::fs::create_dir_all(&folder.0).map_err(|error| failed(&error))?;
        let options = SqliteConnectOptions::new()
            .filename(folder.0.join("bare.db"))
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .disable_statement_logging();
        let mut connection = options.connect().await.map_err(|error| failed(&error))?;
        tables.run(&mut connection).await.map_err(|error| failed(&error))?;
        Ok(Self { connection, folder })
    }

    pub(super) async fn commit(&mut self, group: Group<'_>) -> Result<(), sqlx::Error> {
        let connection = &mut self.connection;
        sqlx::query("BEGIN IMMEDIATE").execute(&mut *connection).await?;
        let acts: Vec<_> = group.acts().collect();
        for rows in acts.chunks(ROWS_MAX) {
            let text = insert("acts (episode, round, agent, waiting_for, at, record)", rows.len());
            let mut query = sqlx::query(AssertSqlSafe(text));
            for act in rows {
                query = query
                    .bind(act.episode)
                    .bind(act.round)
                    .bind(act.agent)
                    .bind(act.waiting_for)
                    .bind(AT_MS)
                    .bind(group.record);
            }
            query.execute(&mut *connection).await?;
        }
        let rounds: Vec<_> = group.rounds().collect();
        for rows in rounds.chunks(ROWS_MAX) {
            let text = insert("rounds (episode, round, digest, score, head, at)", rows.len());
            let mut query = sqlx::query(AssertSqlSafe(text));
            for round in rows {
                query = query
                    .bind(round.episode)
                    .bind(round.round)
                    .bind(DIGEST)
                    .bind(SCORE)
                    .bind(HEAD)
                    .bind(AT_MS);
            }
            query.execute(&mut *connection).await?;
        }
        sqlx::query("COMMIT").execute(connection).await?;
        Ok(())
    }

    pub(super) async fn close(self) -> Result<(), sqlx::Error> {
        let closed = self.connection.close().await;
        drop(self.folder);
        closed
    }

    #[cfg(test)]
    pub(super) fn folder(&self) -> &Path {
        &self.folder.0
    }
}

/// An `INSERT` of `rows` rows of six values.
fn insert(into: &str, rows: usize) -> String {
    let values = vec!["(?, ?, ?, ?, ?, ?)"; rows].join(", ");
    format!("INSERT INTO {into} VALUES {values}")
}
