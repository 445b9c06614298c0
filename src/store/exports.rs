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
