//! The tables `imports` and `import_rounds`: games that were read from files.

use jiff::Timestamp;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{QueryBuilder, Row, Sqlite};
use swarmbench_protocol::import::ImportConfig;

use super::episodes::time;
use super::writer::chunks;
use super::{Store, failure};
use crate::journal::{
    ImportKey, ImportRow, ImportedGame, ImportedRound, JournalError, StoredImport,
};

/// What a list of imported games is filtered by.
#[derive(Clone, Debug, Default)]
pub struct ImportFilter {
    /// A task's name.
    pub task: Option<String>,
    /// A model's name.
    pub model: Option<String>,
}

const SELECT: &str =
    "SELECT key, id, run_id, meta, model, task, seed, settings, score, rounds, acts,
                             imported_at FROM imports WHERE ";

impl Store {
    /// Lists imported games, newest first, from the one after `before` on.
    ///
    /// # Errors
    /// Where the database cannot be read; so for all functions here.
    pub async fn list_imports(
        &self,
        filter: &ImportFilter,
        before: Option<ImportKey>,
        limit: u32,
    ) -> Result<Vec<StoredImport>, JournalError> {
        let mut query = QueryBuilder::<Sqlite>::new(SELECT);
        query.push("key < ").push_bind(before.map_or(i64::MAX, |key| key.0));
        for (column, value) in [("task", &filter.task), ("model", &filter.model)] {
            if let Some(value) = value {
                query.push(" AND ").push(column).push(" = ").push_bind(value);
            }
        }
        query.push(" ORDER BY key DESC LIMIT ").push_bind(limit);
        let rows = query.build().fetch_all(&mut *self.read().await?).await.map_err(failure)?;
        rows.iter().map(import).collect::<Result<_, _>>().map_err(failure)
    }

    /// Finds an imported game.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn find_import(&self, id: &str) -> Result<Option<StoredImport>, JournalError> {
        let mut query = QueryBuilder::<Sqlite>::new(SELECT);
        query.push("id = ").push_bind(id);
        let row = query.build().fetch_optional(&mut *self.read().await?).await.map_err(failure)?;
        row.as_ref().map(import).transpose().map_err(failure)
    }

    /// The states `from..to` of an imported game, each with the acts that were given in it.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn imported_rounds(
        &self,
        key: ImportKey,
        from: u32,
        to: u32,
    ) -> Result<Vec<ImportedRound>, JournalError> {
        let rows = sqlx::query(
            "SELECT round, score, state, acts FROM import_rounds
             WHERE import = ? AND round >= ? AND round < ? ORDER BY round",
        )
        .bind(key.0)
        .bind(from)
        .bind(to)
        .fetch_all(&mut *self.read().await?)
        .await
        .map_err(failure)?;
        let round = |row: &SqliteRow| {
            Ok(ImportedRound {
                round: row.try_get("round")?,
                score: row.try_get("score")?,
                state: row.try_get("state")?,
                acts: row.try_get("acts")?,
            })
        };
        rows.iter().map(round).collect::<Result<_, sqlx::Error>>().map_err(failure)
    }

    /// All imported games, as far as results are compared; the oldest first.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn imported_games(&self) -> Result<Vec<ImportedGame>, JournalError> {
        let rows = sqlx::query(
            "SELECT id, model, task, seed, settings, score, rounds FROM imports ORDER BY key",
        )
        .fetch_all(&mut *self.read().await?)
        .await
        .map_err(failure)?;
        let game = |row: &SqliteRow| {
            Ok(ImportedGame {
                id: row.try_get("id")?,
                model: row.try_get("model")?,
                task: row.try_get("task")?,
                seed: seed(row)?,
                settings: settings(row)?,
                score: row.try_get("score")?,
                rounds: row.try_get("rounds")?,
            })
        };
        rows.iter().map(game).collect::<Result<_, sqlx::Error>>().map_err(failure)
    }
}

fn import(row: &SqliteRow) -> Result<StoredImport, sqlx::Error> {
    Ok(StoredImport {
        key: ImportKey(row.try_get("key")?),
        id: row.try_get("id")?,
        run_id: row.try_get("run_id")?,
        meta: row.try_get("meta")?,
        model: row.try_get("model")?,
        task: row.try_get("task")?,
        seed: seed(row)?,
        settings: settings(row)?,
        score: row.try_get("score")?,
        rounds: row.try_get("rounds")?,
        acts: row.try_get::<i64, _>("acts")?.unsigned_abs(),
        imported_at: time(row.try_get("imported_at")?)?,
    })
}

fn seed(row: &SqliteRow) -> Result<u64, sqlx::Error> {
    row.try_get::<i64, _>("seed").map(i64::unsigned_abs)
}

fn settings(row: &SqliteRow) -> Result<ImportConfig, sqlx::Error> {
    let text: String = row.try_get("settings")?;
    serde_json::from_str(&text).map_err(|error| sqlx::Error::Decode(error.into()))
}

/// Keeps a game. One that is there already gets acts where it has none; else nothing changes.
pub(super) async fn keep(
    connection: &mut SqliteConnection,
    row: &ImportRow,
    at: Timestamp,
) -> Result<(), sqlx::Error> {
    let acts = i64::try_from(row.acts).unwrap_or(i64::MAX);
    let found = sqlx::query("SELECT key, acts FROM imports WHERE digest = ?")
        .bind(&row.digest[..])
        .fetch_optional(&mut *connection)
        .await?;
    if let Some(found) = found {
        let (key, old): (i64, i64) = (found.try_get(0)?, found.try_get(1)?);
        if old > 0 || acts == 0 {
            return Ok(());
        }
        sqlx::query("UPDATE imports SET acts = ? WHERE key = ?")
            .bind(acts)
            .bind(key)
            .execute(&mut *connection)
            .await?;
        sqlx::query("DELETE FROM import_rounds WHERE import = ?")
            .bind(key)
            .execute(&mut *connection)
            .await?;
        return insert_rounds(connection, key, &row.rounds).await;
    }
    let settings =
        serde_json::to_string(&row.settings).map_err(|e| sqlx::Error::Encode(e.into()))?;
    let inserted = sqlx::query(
        "INSERT INTO imports (id, digest, run_id, meta, model, task, seed, settings, score, rounds,
                              acts, imported_at)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
    )
    .bind(&row.id)
    .bind(&row.digest[..])
    .bind(&row.run_id)
    .bind(&row.meta)
    .bind(&row.model)
    .bind(&row.task)
    .bind(i64::try_from(row.seed).unwrap_or(i64::MAX))
    .bind(settings)
    .bind(row.score)
    .bind(row.resolved)
    .bind(acts)
    .bind(at.as_millisecond())
    .execute(&mut *connection)
    .await?;
    insert_rounds(connection, inserted.last_insert_rowid(), &row.rounds).await
}

async fn insert_rounds(
    connection: &mut SqliteConnection,
    key: i64,
    rounds: &[ImportedRound],
) -> Result<(), sqlx::Error> {
    for chunk in chunks(rounds) {
        let mut insert = QueryBuilder::<Sqlite>::new(
            "INSERT INTO import_rounds (import, round, score, state, acts) ",
        );
        insert.push_values(chunk, |mut row, round| {
            row.push_bind(key)
                .push_bind(round.round)
                .push_bind(round.score)
                .push_bind(&round.state)
                .push_bind(round.acts.as_deref());
        });
        insert.build().execute(&mut *connection).await?;
    }
    Ok(())
}
