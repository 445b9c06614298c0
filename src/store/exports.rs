//! Rounds with all that is stored of them, for exports.

use jiff::Timestamp;
use sqlx::sqlite::SqliteRow;
use swarmbench_engine::AgentId;

use super::Store;
use super::StoreError;
use super::rows::{FromRow, get};
use crate::ids::EpisodeKey;
use swarmbench_journal::record::ActRecord;

/// A resolved round with all that is stored of it.
#[derive(Clone, Debug)]
pub struct LoggedRound {
    pub round: u32,
    /// The digest of the state after it.
    pub digest: [u8; 32],
    pub at: Timestamp,
    /// Its acts, in order of their seats.
    pub acts: Vec<LoggedAct>,
}

/// An act with the time at which it came.
#[derive(Clone, Debug)]
pub struct LoggedAct {
    pub agent: AgentId,
    pub at: Timestamp,
    pub record: ActRecord,
}

impl Store {
    /// When an episode started, if it has: when it was created or started by hand, or when its last seat was taken.
    pub async fn started_at(&self, episode: EpisodeKey) -> Result<Option<Timestamp>, StoreError> {
        let query = sqlx::query(
            "SELECT CASE WHEN (e.seating IS NOT NULL
                               OR NOT EXISTS (SELECT 1 FROM claims c WHERE c.episode = e.key))
                          AND (e.started_at IS NOT NULL
                               OR json_extract(e.opening, '$.config.start') <> 'manual')
                    THEN max(e.created_at, coalesce(e.started_at, 0), coalesce(
                             (SELECT max(s.claimed_at) FROM seats s WHERE s.episode = e.key), 0)) END
             FROM episodes e WHERE e.key = ?",
        );
        let found: Option<Option<Timestamp>> = self.fetch_optional(query.bind(episode.0)).await?;
        Ok(found.flatten())
    }

    /// The different messages of the rounds before `end`.
    pub async fn messages_of(
        &self,
        episode: EpisodeKey,
        end: u32,
    ) -> Result<Vec<String>, StoreError> {
        let query = sqlx::query(
            "SELECT DISTINCT record ->> 'message' AS message FROM acts
             WHERE episode = ? AND round < ? AND message IS NOT NULL ORDER BY message",
        );
        self.fetch_all(query.bind(episode.0).bind(end)).await
    }

    /// The resolved rounds `from..to` of an episode with their acts, in order: all of the acts but the answers and
    /// the reasoning of language models, which may be large.
    pub async fn logged_rounds(
        &self,
        episode: EpisodeKey,
        from: u32,
        to: u32,
    ) -> Result<Vec<LoggedRound>, StoreError> {
        let query = sqlx::query(
            "SELECT round, digest, at FROM rounds
             WHERE episode = ? AND round >= ? AND round < ? ORDER BY round",
        );
        let mut rounds: Vec<LoggedRound> =
            self.fetch_all(query.bind(episode.0).bind(from).bind(to)).await?;
        let query = sqlx::query(
            "SELECT round, agent, at, json_remove(record, '$.response', '$.reasoning') AS record
             FROM acts
             WHERE episode = ? AND round >= ? AND round < ? ORDER BY round, agent",
        );
        let acts: Vec<(u32, _, _, ActRecord)> =
            self.fetch_all(query.bind(episode.0).bind(from).bind(to)).await?;
        for (number, agent, at, record) in acts {
            // Acts of a round that is not resolved belong to none.
            if let Some(round) = rounds.iter_mut().find(|round| round.round == number) {
                round.acts.push(LoggedAct { agent, at, record });
            }
        }
        Ok(rounds)
    }
}

impl FromRow for LoggedRound {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            round: get(row, "round")?,
            digest: get(row, "digest")?,
            at: get(row, "at")?,
            acts: Vec::new(),
        })
    }
}
