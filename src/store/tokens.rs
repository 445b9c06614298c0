//! The table `tokens`.

use sqlx::Row;
use swarmbench_engine::AgentId;

use super::{Store, failure};
use crate::ids::{EpisodeId, TokenHash};
use crate::journal::JournalError;

/// What a token stands for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Grant {
    /// The episode.
    pub episode: EpisodeId,
    /// The seat; none for all seats.
    pub agent: Option<AgentId>,
}

impl Store {
    /// What the token with this hash stands for, if it is known.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn find_token(&self, hash: TokenHash) -> Result<Option<Grant>, JournalError> {
        let row = sqlx::query(
            "SELECT e.id, t.agent FROM tokens t JOIN episodes e ON e.key = t.episode
             WHERE t.hash = ?",
        )
        .bind(&hash.0[..])
        .fetch_optional(&self.readers)
        .await
        .map_err(failure)?;
        row.map(|row| {
            Ok(Grant {
                episode: EpisodeId::from_text(row.try_get(0)?),
                agent: row.try_get::<Option<u16>, _>(1)?.map(AgentId),
            })
        })
        .transpose()
        .map_err(failure)
    }
}
