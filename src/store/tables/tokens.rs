//! Permissions of tokens: the table `tokens`, and keys.

use std::sync::Arc;

use swarmbench_engine::AgentId;

use crate::ids::{CompetitionKey, EpisodeId, EpisodeKey, RunKey, TokenHash};
use crate::keys::{Key, OwnerKey};
use crate::store::entries::{Entry, TokenRow};
use crate::store::sql::{Connection, from_row, query};
use crate::store::{Store, StoreError};

/// The permissions of a token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Grant {
    Seat {
        episode: EpisodeId,
        /// Key of the seat's holder.
        owner: Option<OwnerKey>,
        agent: AgentId,
    },
    /// Some or all seats of an episode.
    Swarm {
        episode: EpisodeId,
        /// Key of the seats' holder.
        owner: Option<OwnerKey>,
        seats: Seats,
    },
    /// Seats of all episodes of a run.
    Run {
        run: RunKey,
        /// All seats, or those of one holder of the run's team.
        seats: Seats,
        /// Key that created the run.
        owner: Option<OwnerKey>,
        /// Set for attempts in a competition, and for practice with a key made for one.
        competition: Option<CompetitionKey>,
    },
    Key(Key),
}

/// The seats of an episode that a token authorizes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Seats {
    /// All seats except those open to claims and those hosted by the server.
    Creators,
    Claimed(Arc<[AgentId]>),
    /// Seats of a holder of a run's team, by its number.
    OfTeam(u32),
}

/// Tokens replaced by one commit.
const REPLACED_AT_ONCE: usize = 64;

impl Store {
    /// Replaces all tokens of a holder (of the creator where `holder` is `None`), in several commits, so that acts are
    /// committed in between. After an interruption the same request replaces all of them again.
    pub async fn replace_tokens(
        &self,
        episode: EpisodeKey,
        holder: Option<u32>,
        mut tokens: Vec<TokenRow>,
    ) -> Result<(), StoreError> {
        let number = |token: &TokenRow| token.agent.map_or(-1, |agent| i64::from(agent.0));
        tokens.sort_unstable_by_key(number);
        let mut first = -1;
        while !tokens.is_empty() {
            let rest = tokens.split_off(tokens.len().min(REPLACED_AT_ONCE));
            let last = rest.first().map_or(i64::MAX, |next| number(next) - 1);
            let agents = (first, last);
            self.keep(vec![Entry::ReplaceTokens { episode, holder, agents, tokens }]).await?;
            (tokens, first) = (rest, last.saturating_add(1));
        }
        Ok(())
    }

    /// Finds the permissions of a token by its hash.
    pub async fn find_token(&self, hash: TokenHash) -> Result<Option<Grant>, StoreError> {
        let query = query(concat!(
            "SELECT e.id, CASE WHEN t.holder IS NULL OR t.run IS NOT NULL THEN coalesce(e.owner, r.owner) ELSE c.owner END AS owner,
                    t.agent, t.holder, t.run, t.episode,
                    ",
            competition_of_run!(),
            " AS competition
             FROM tokens t LEFT JOIN episodes e ON e.key = t.episode LEFT JOIN runs r ON r.key = t.run
             LEFT JOIN claims c ON c.episode = t.episode AND c.holder = t.holder
             WHERE t.hash = $1",
        ));
        let Some(found) = self.fetch_optional(query.bind(&hash.0[..])).await? else {
            return Ok(None);
        };
        let TokenColumns { run, competition, id, episode: key, agent, holder, owner } = found;
        if let Some(run) = run {
            let seats = holder.map_or(Seats::Creators, Seats::OfTeam);
            return Ok(Some(Grant::Run { run, seats, owner, competition }));
        }
        let no_subject = || StoreError::broken("a token of no episode and no run");
        let (episode, key) = id.zip(key).ok_or_else(no_subject)?;
        if let Some(agent) = agent {
            return Ok(Some(Grant::Seat { episode, owner, agent }));
        }
        let seats = match holder {
            None => Seats::Creators,
            Some(holder) => Seats::Claimed(self.seats_of(key, holder).await?.into()),
        };
        Ok(Some(Grant::Swarm { episode, owner, seats }))
    }
}

/// Whether a token or a key has rights. The updates lock its row until the end of the transaction, so that a revocation by another
/// server comes before or after it.
pub(in crate::store) async fn has_rights(
    connection: &mut Connection,
    hash: TokenHash,
) -> Result<bool, sqlx::Error> {
    for lock in [
        "UPDATE keys SET hash = hash WHERE hash = $1 AND revoked_at IS NULL",
        "UPDATE tokens SET hash = hash WHERE hash = $1",
    ] {
        if query(lock).bind(&hash.0[..]).execute(connection).await? > 0 {
            return Ok(true);
        }
    }
    Ok(false)
}

struct TokenColumns {
    run: Option<RunKey>,
    competition: Option<CompetitionKey>,
    id: Option<EpisodeId>,
    episode: Option<EpisodeKey>,
    agent: Option<AgentId>,
    holder: Option<u32>,
    owner: Option<OwnerKey>,
}

from_row! {
    TokenColumns { run, competition, id, episode, agent, holder, owner }
}
