//! The tables `imports` and `import_rounds`: games imported from files.

use std::collections::BTreeSet;

use jiff::Timestamp;
use sha2::{Digest, Sha256};
use swarmbench_protocol::import::ImportConfig;

use crate::ids::ImportKey;
use crate::store::Store;
use crate::store::StoreError;
use crate::store::entries::{ImportRow, ImportedRound};
use crate::store::sql::{Builder, Connection, LISTED_AT_ONCE, chunks, from_row, query};

/// Incremental digest of an imported game: name and settings, then each state.
#[derive(Debug)]
pub struct ImportHash(Sha256);

impl ImportHash {
    /// Hashes the name and the settings.
    pub fn new(run_id: &str, meta: &str) -> Self {
        let mut hash = Sha256::new();
        for part in [run_id, meta] {
            hash.update((part.len() as u64).to_be_bytes());
            hash.update(part);
        }
        Self(hash)
    }

    /// Hashes the next state.
    pub fn add(&mut self, score: f64, state: &str) {
        self.0.update(score.to_bits().to_be_bytes());
        self.0.update((state.len() as u64).to_be_bytes());
        self.0.update(state);
    }

    pub fn finish(self) -> [u8; 32] {
        self.0.finalize().into()
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct StoredImport {
    pub key: ImportKey,
    pub id: String,
    /// Name in the files.
    pub run_id: String,
    /// Model name in the files.
    pub model: String,
    pub task: String,
    pub seed: u64,
    /// Known settings.
    pub settings: ImportConfig,
    /// Score of the last state.
    pub score: f64,
    pub rounds: u32,
    pub acts: u64,
    pub imported_at: Timestamp,
}

#[derive(Clone, Debug, Default)]
pub struct ImportFilter {
    pub task: Option<String>,
    pub model: Option<String>,
}

const SELECT: &str =
    "SELECT key, id, run_id, model, task, seed, settings, score, rounds, acts, imported_at
                             FROM imports WHERE ";

impl Store {
    /// Lists imported games, newest first, starting after the game `before`.
    pub async fn list_imports(
        &self,
        filter: &ImportFilter,
        before: Option<ImportKey>,
        limit: u32,
    ) -> Result<Vec<StoredImport>, StoreError> {
        let mut query = Builder::new(SELECT);
        query.push("key < ").push_bind(before.map_or(i64::MAX, |key| key.0));
        for (column, value) in [("task", &filter.task), ("model", &filter.model)] {
            if let Some(value) = value {
                query.push(" AND ").push(column).push(" = ").push_bind(value);
            }
        }
        query.push(" ORDER BY key DESC LIMIT ").push_bind(limit);
        self.fetch_all(query.build()).await
    }

    pub async fn find_import(&self, id: &str) -> Result<Option<StoredImport>, StoreError> {
        let mut query = Builder::new(SELECT);
        query.push("id = ").push_bind(id);
        self.fetch_optional(query.build()).await
    }

    /// The game's entry in the index of the imported files, as JSON.
    pub async fn imported_meta(&self, key: ImportKey) -> Result<Option<String>, StoreError> {
        let query = query("SELECT meta FROM imports WHERE key = $1");
        self.fetch_optional(query.bind(key.0)).await
    }

    /// Sizes in bytes of the states `from..to`, each with its acts.
    pub async fn imported_bytes(
        &self,
        key: ImportKey,
        from: u32,
        to: u32,
    ) -> Result<Vec<u64>, StoreError> {
        let query = query(
            "SELECT CAST(octet_length(state) + COALESCE(octet_length(acts), 0) AS BIGINT) FROM import_rounds
             WHERE import = $1 AND round >= $2 AND round < $3 ORDER BY round",
        );
        self.fetch_all(query.bind(key.0).bind(from).bind(to)).await
    }

    /// The states `from..to`, each with the acts submitted in it.
    pub async fn imported_rounds(
        &self,
        key: ImportKey,
        from: u32,
        to: u32,
    ) -> Result<Vec<ImportedRound>, StoreError> {
        let query = query(
            "SELECT round, score, state, acts FROM import_rounds
             WHERE import = $1 AND round >= $2 AND round < $3 ORDER BY round",
        );
        self.fetch_all(query.bind(key.0).bind(from).bind(to)).await
    }

    /// The scores of the given states, in order of their rounds.
    pub async fn imported_scores(
        &self,
        key: ImportKey,
        states: &[u32],
    ) -> Result<Vec<f64>, StoreError> {
        let states: BTreeSet<u32> = states.iter().copied().collect();
        let states: Vec<u32> = states.into_iter().collect();
        let mut scores = Vec::with_capacity(states.len());
        for some in states.chunks(LISTED_AT_ONCE) {
            let mut query = Builder::new("SELECT score FROM import_rounds WHERE import = ");
            query.push_bind(key.0).push(" AND round IN ");
            query.push_list(some.iter().copied());
            query.push(" ORDER BY round");
            scores.extend(self.fetch_all::<f64>(query.build()).await?);
        }
        Ok(scores)
    }

    /// All imported games, oldest first.
    pub async fn imported_games(&self) -> Result<Vec<StoredImport>, StoreError> {
        let mut query = Builder::new(SELECT);
        query.push("TRUE ORDER BY key");
        self.fetch_all(query.build()).await
    }
}

from_row! {
    ImportedRound { round, score, state, acts }
    StoredImport {
        key, id, run_id, model, task, seed, settings, score, rounds, acts, imported_at,
    }
}

/// Stores a game. An existing game without acts gets those of `row`; otherwise it stays unchanged.
pub(in crate::store) async fn keep(
    connection: &mut Connection,
    row: &ImportRow,
    at: Timestamp,
) -> Result<(), sqlx::Error> {
    let acts = i64::try_from(row.acts).unwrap_or(i64::MAX);
    let found = query("SELECT key, acts FROM imports WHERE digest = $1")
        .bind(&row.digest[..])
        .fetch_optional(&mut *connection)
        .await?;
    if let Some(found) = found {
        let (key, old): (i64, i64) = (found.try_get(0)?, found.try_get(1)?);
        if old > 0 || acts == 0 {
            return Ok(());
        }
        query("UPDATE imports SET acts = $1 WHERE key = $2")
            .bind(acts)
            .bind(key)
            .execute(&mut *connection)
            .await?;
        query("DELETE FROM import_rounds WHERE import = $1")
            .bind(key)
            .execute(&mut *connection)
            .await?;
        return insert_rounds(connection, key, &row.rounds).await;
    }
    let settings =
        serde_json::to_string(&row.settings).map_err(|e| sqlx::Error::Encode(e.into()))?;
    let inserted: i64 = query(
        "INSERT INTO imports (id, digest, run_id, meta, model, task, seed, settings, score, rounds,
                              acts, imported_at)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12) RETURNING key",
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
    .one(connection)
    .await?;
    insert_rounds(connection, inserted, &row.rounds).await
}

async fn insert_rounds(
    connection: &mut Connection,
    key: i64,
    rounds: &[ImportedRound],
) -> Result<(), sqlx::Error> {
    for chunk in chunks(rounds) {
        let mut insert =
            Builder::new("INSERT INTO import_rounds (import, round, score, state, acts) ");
        insert.push_rows(chunk, |row, round| {
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
