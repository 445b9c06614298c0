//! Rounds with all that is stored of them, for exports.

use sqlx::Row;
use sqlx::sqlite::SqliteRow;
use swarmbench_engine::AgentId;

use super::episodes::{hash, time};
use super::{Store, failure};
use crate::journal::record::RawRecord;
use crate::journal::{EpisodeKey, JournalError, LoggedAct, LoggedRound};

impl Store {
    /// The resolved rounds `from..to` of an episode with their acts, in order: all of the acts but the answers and
    /// the reasoning of language models, which may be large.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn logged_rounds(
        &self,
        episode: EpisodeKey,
        from: u32,
        to: u32,
    ) -> Result<Vec<LoggedRound>, JournalError> {
        let rows = sqlx::query(
            "SELECT round, digest, at FROM rounds
             WHERE episode = ? AND round >= ? AND round < ? ORDER BY round",
        )
        .bind(episode.0)
        .bind(from)
        .bind(to)
        .fetch_all(&mut *self.read().await?)
        .await
        .map_err(failure)?;
        let round = |row: &SqliteRow| {
            Ok(LoggedRound {
                round: row.try_get("round")?,
                digest: hash(&row.try_get::<Vec<u8>, _>("digest")?)?,
                at: time(row.try_get("at")?)?,
                acts: Vec::new(),
            })
        };
        let rounds: Result<Vec<LoggedRound>, sqlx::Error> = rows.iter().map(round).collect();
        let mut rounds = rounds.map_err(failure)?;
        let acts = sqlx::query(
            "SELECT round, agent, at, json_remove(record, '$.response', '$.reasoning') AS record
             FROM acts
             WHERE episode = ? AND round >= ? AND round < ? ORDER BY round, agent",
        )
        .bind(episode.0)
        .bind(from)
        .bind(to)
        .fetch_all(&mut *self.read().await?)
        .await
        .map_err(failure)?;
        for row in &acts {
            let (number, act) = logged(row).map_err(failure)?;
            // Acts of a round that is not resolved belong to none.
            if let Some(round) = rounds.iter_mut().find(|round| round.round == number) {
                round.acts.push(act);
            }
        }
        Ok(rounds)
    }
}

fn logged(row: &SqliteRow) -> Result<(u32, LoggedAct), sqlx::Error> {
    let decode = |error: serde_json::Error| sqlx::Error::Decode(error.into());
    let raw = RawRecord::from_stored(row.try_get("record")?).map_err(decode)?;
    let act = LoggedAct {
        agent: AgentId(row.try_get("agent")?),
        at: time(row.try_get("at")?)?,
        record: raw.read().map_err(decode)?,
    };
    Ok((row.try_get("round")?, act))
}
