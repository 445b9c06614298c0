//! The rights of tokens: the table `tokens`, and keys.

use std::sync::Arc;

use sqlx::Row;
use swarmbench_engine::AgentId;

use super::{Store, failure};
use crate::ids::{EpisodeId, TokenHash};
use crate::journal::{CompetitionKey, EpisodeKey, JournalError, RunKey};
use crate::keys::{Key, OwnerKey};

/// The rights of a token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Grant {
    /// One seat of an episode.
    Seat {
        /// The episode.
        episode: EpisodeId,
        /// The key of the seat's holder, if any.
        owner: Option<OwnerKey>,
        /// The seat.
        agent: AgentId,
    },
    /// Several seats of an episode.
    Swarm {
        /// The episode.
        episode: EpisodeId,
        /// The key of the seats' holder, if any.
        owner: Option<OwnerKey>,
        /// Which seats.
        seats: Seats,
    },
    /// All seats of all episodes of a run.
    Run {
        /// The number of the run.
        run: RunKey,
        /// The key with which it was created, if any.
        owner: Option<OwnerKey>,
        /// The competition, where it is an attempt in one.
        competition: Option<CompetitionKey>,
    },
    /// A person.
    Key(Key),
}

/// The seats of an episode that a swarm token authorizes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Seats {
    /// All that were not open to claims, and that the server does not play.
    Creators,
    /// Those of one claim.
    Claimed(Arc<[AgentId]>),
}

impl Store {
    /// The rights of the token with this hash, if it is known.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn find_token(&self, hash: TokenHash) -> Result<Option<Grant>, JournalError> {
        let row = sqlx::query(
            "SELECT e.id, CASE WHEN t.holder IS NULL THEN coalesce(e.owner, r.owner) ELSE c.owner END AS owner,
                    t.agent, t.holder, t.run, t.episode,
                    (SELECT n.competition FROM entries n WHERE n.key = r.entry) AS competition
             FROM tokens t LEFT JOIN episodes e ON e.key = t.episode LEFT JOIN runs r ON r.key = t.run
             LEFT JOIN claims c ON c.episode = t.episode AND c.holder = t.holder
             WHERE t.hash = ?",
        )
        .bind(&hash.0[..])
        .fetch_optional(&mut *self.read().await?)
        .await
        .map_err(failure)?;
        let Some(row) = row else { return Ok(None) };
        let owner = row.try_get::<Option<i64>, _>("owner").map_err(failure)?.map(OwnerKey);
        if let Some(run) = row.try_get::<Option<i64>, _>("run").map_err(failure)? {
            let competition = row.try_get::<Option<i64>, _>("competition").map_err(failure)?;
            let competition = competition.map(CompetitionKey);
            return Ok(Some(Grant::Run { run: RunKey(run), owner, competition }));
        }
        let episode = EpisodeId::from_text(row.try_get("id").map_err(failure)?);
        if let Some(agent) = row.try_get::<Option<u16>, _>("agent").map_err(failure)? {
            return Ok(Some(Grant::Seat { episode, owner, agent: AgentId(agent) }));
        }
        let holder = row.try_get::<Option<u32>, _>("holder").map_err(failure)?;
        let seats = match holder {
            None => Seats::Creators,
            Some(holder) => {
                let key = row.try_get::<i64, _>("episode").map_err(failure)?;
                Seats::Claimed(self.seats_of(EpisodeKey(key), holder).await?.into())
            }
        };
        Ok(Some(Grant::Swarm { episode, owner, seats }))
    }
}
