//! What tokens stand for: the table `tokens`, and keys.

use sqlx::Row;
use swarmbench_engine::AgentId;

use super::{Store, failure};
use crate::ids::{EpisodeId, TokenHash};
use crate::journal::JournalError;
use crate::keys::{Key, OwnerKey};

/// What a token stands for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Grant {
    /// Seats of an episode.
    Seats {
        /// The episode.
        episode: EpisodeId,
        /// The key with which it was created, if any.
        owner: Option<OwnerKey>,
        /// The seat; none for all seats.
        agent: Option<AgentId>,
    },
    /// A person.
    Key(Key),
}

impl Store {
    /// What the token with this hash stands for, if it is known.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn find_token(&self, hash: TokenHash) -> Result<Option<Grant>, JournalError> {
        let row = sqlx::query(
            "SELECT e.id, e.owner, t.agent FROM tokens t JOIN episodes e ON e.key = t.episode
             WHERE t.hash = ?",
        )
        .bind(&hash.0[..])
        .fetch_optional(&self.readers)
        .await
        .map_err(failure)?;
        row.map(|row| {
            Ok(Grant::Seats {
                episode: EpisodeId::from_text(row.try_get(0)?),
                owner: row.try_get::<Option<i64>, _>(1)?.map(OwnerKey),
                agent: row.try_get::<Option<u16>, _>(2)?.map(AgentId),
            })
        })
        .transpose()
        .map_err(failure)
    }
}
