//! Complete rounds for exports.

use jiff::Timestamp;
use serde::Deserialize;
use swarmbench_engine::AgentId;

use crate::ids::EpisodeKey;
use crate::store::Store;
use crate::store::StoreError;
use crate::store::sql::{FromRow, SqlRow, from_row, get, query};
use swarmbench_journal::record::ActRecord;

#[derive(Clone, Debug)]
pub struct LoggedRound {
    pub round: u32,
    /// Digest of the state after the round.
    pub digest: [u8; 32],
    pub at: Timestamp,
    /// Acts by seat.
    pub acts: Vec<LoggedAct>,
}

/// An act with its time.
#[derive(Clone, Debug)]
pub struct LoggedAct {
    pub agent: AgentId,
    pub at: Timestamp,
    pub record: ActRecord,
}

impl Store {
    /// Start of an episode: its creation, its manual start, or the claim of its last seat; `None` if it has not started.
    pub async fn started_at(&self, episode: EpisodeKey) -> Result<Option<Timestamp>, StoreError> {
        let query = query(
            "SELECT e.opening, e.created_at, e.started_at,
                    e.seating IS NOT NULL OR NOT EXISTS (SELECT 1 FROM claims c WHERE c.episode = e.key) AS is_seated,
                    (SELECT max(s.claimed_at) FROM seats s WHERE s.episode = e.key) AS claimed_at
             FROM episodes e WHERE e.key = $1",
        );
        let found: Option<Start> = self.fetch_optional(query.bind(episode.0)).await?;
        found.map_or(Ok(None), Start::at)
    }

    /// The resolved rounds `from..to` of an episode with their acts, in order. Acts come without the answers and the
    /// reasoning of language models, which may be large.
    pub async fn logged_rounds(
        &self,
        episode: EpisodeKey,
        from: u32,
        to: u32,
    ) -> Result<Vec<LoggedRound>, StoreError> {
        let rounds = query(
            "SELECT round, digest, at FROM rounds
             WHERE episode = $1 AND round >= $2 AND round < $3 ORDER BY round",
        );
        let mut rounds: Vec<LoggedRound> =
            self.fetch_all(rounds.bind(episode.0).bind(from).bind(to)).await?;
        let acts = query(
            "SELECT round, agent, at, coalesce(brief, record) AS record FROM acts
             WHERE episode = $1 AND round >= $2 AND round < $3 ORDER BY round, agent",
        );
        let acts: Vec<(u32, _, _, ActRecord)> =
            self.fetch_all(acts.bind(episode.0).bind(from).bind(to)).await?;
        for (number, agent, at, record) in acts {
            // Acts of early versions have no brief record and are read with their texts.
            let record = record.without_texts();
            // Acts of the open round have no resolved round.
            if let Some(round) = rounds.iter_mut().find(|round| round.round == number) {
                round.acts.push(LoggedAct { agent, at, record });
            }
        }
        Ok(rounds)
    }
}

/// The facts that determine an episode's start.
struct Start {
    opening: String,
    created_at: Timestamp,
    started_at: Option<Timestamp>,
    /// Whether all seats are held.
    is_seated: bool,
    claimed_at: Option<Timestamp>,
}

impl Start {
    fn at(self) -> Result<Option<Timestamp>, StoreError> {
        #[derive(Deserialize)]
        struct Opening {
            config: Config,
        }
        #[derive(Deserialize)]
        struct Config {
            start: String,
        }
        let Self { opening, created_at, started_at, is_seated, claimed_at } = self;
        let Opening { config } = serde_json::from_str(&opening).map_err(StoreError::decode)?;
        let has_started = is_seated && (started_at.is_some() || config.start != "manual");
        Ok(has_started.then(|| created_at.max(started_at.max(claimed_at).unwrap_or(created_at))))
    }
}

from_row! {
    Start { opening, created_at, started_at, is_seated, claimed_at }
}

impl FromRow for LoggedRound {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            round: get(row, "round")?,
            digest: get(row, "digest")?,
            at: get(row, "at")?,
            acts: Vec::new(),
        })
    }
}
