//! The tables `claims` and `seats`: holders of an episode's seats.

use jiff::Timestamp;
use swarmbench_engine::AgentId;

use crate::ids::EpisodeKey;
use crate::keys::OwnerKey;
use crate::store::Store;
use crate::store::StoreError;
use crate::store::entries::{ClaimRow, Held, Holder, SeatingRow};
use crate::store::sql::{Builder, Connection, from_row, query};
use swarmbench_boards::run::is_human;

/// A seat and its holder.
#[derive(Clone, Debug)]
pub struct HeldSeat {
    pub agent: AgentId,
    /// Number of the claim; 0 for the creator.
    pub holder: u32,
    /// Name of the holder's key; `None` on a server without keys.
    pub name: Option<String>,
    pub model: String,
    /// The built-in player that the server hosts in this seat.
    pub player: Option<String>,
    pub claimed_at: Timestamp,
}

impl Store {
    /// The recorded holders of an episode's seats, in order of seats; empty if the creator simply holds all.
    pub async fn held_seats(&self, episode: EpisodeKey) -> Result<Vec<HeldSeat>, StoreError> {
        let query = query(
            "SELECT s.agent, s.holder, k.name, s.model, s.player, s.claimed_at
             FROM seats s LEFT JOIN keys k ON k.number = s.owner WHERE s.episode = $1 ORDER BY s.agent",
        );
        self.fetch_all(query.bind(episode.0)).await
    }

    /// The claim made with an idempotency key: its number, and the hash of its request body.
    pub async fn claimed_with(&self, key: &str) -> Result<Option<(u32, Vec<u8>)>, StoreError> {
        let query = query("SELECT holder, idempotency_body FROM claims WHERE idempotency_key = $1");
        self.fetch_optional(query.bind(key)).await
    }

    /// The seats of a claim, in order.
    pub async fn seats_of(
        &self,
        episode: EpisodeKey,
        holder: u32,
    ) -> Result<Vec<AgentId>, StoreError> {
        let query =
            query("SELECT agent FROM seats WHERE episode = $1 AND holder = $2 ORDER BY agent");
        self.fetch_all(query.bind(episode.0).bind(holder)).await
    }

    /// The holders of an episode's seats, with their seats.
    pub(in crate::store) async fn read_holders(
        &self,
        episode: EpisodeKey,
    ) -> Result<Vec<Held>, StoreError> {
        let query = query("SELECT * FROM claims WHERE episode = $1 ORDER BY holder");
        let holders: Vec<Holder> = self.fetch_all(query.bind(episode.0)).await?;
        let mut all = Vec::with_capacity(holders.len());
        for holder in holders {
            let seats = self.seats_of(episode, holder.number).await?;
            all.push((holder, seats));
        }
        Ok(all)
    }

    /// The public id of a key.
    pub(in crate::store) async fn read_key_id(
        &self,
        owner: OwnerKey,
    ) -> Result<Option<String>, StoreError> {
        let query = query("SELECT id FROM keys WHERE number = $1");
        self.fetch_optional(query.bind(owner.0)).await
    }
}

from_row! {
    HeldSeat { agent, holder, name, model, player, claimed_at }
    Holder { number = "holder", owner, key, model, agent_meta, player, at = "claimed_at" }
}

/// Inserts a claim without its tokens.
pub(in crate::store) async fn claim(
    connection: &mut Connection,
    row: &ClaimRow,
) -> Result<(), sqlx::Error> {
    let Holder { number, owner, key, model, agent_meta, player, at } = &row.holder;
    query(
        "INSERT INTO claims (episode, holder, owner, key, model, agent_meta, player, claimed_at,
                             idempotency_key, idempotency_body)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10)",
    )
    .bind(row.episode.0)
    .bind(number)
    .bind(owner.map(|owner| owner.0))
    .bind(key)
    .bind(model)
    .bind(serde_json::to_string(agent_meta).expect("string keys"))
    .bind(player)
    .bind(at.as_millisecond())
    .bind(row.idempotency.as_ref().map(|(key, _)| key))
    .bind(row.idempotency.as_ref().map(|(_, body)| &body[..]))
    .execute(&mut *connection)
    .await?;
    if is_human(agent_meta) {
        let people = query("UPDATE episodes SET people = TRUE WHERE key = $1");
        people.bind(row.episode.0).execute(&mut *connection).await?;
    }
    for chunk in row.agents.chunks(SEATS_AT_ONCE) {
        let mut insert = Builder::new(
            "INSERT INTO seats (episode, agent, holder, owner, model, player, claimed_at) ",
        );
        insert.push_rows(chunk, |values, agent| {
            values
                .push_bind(row.episode.0)
                .push_bind(agent.0)
                .push_bind(number)
                .push_bind(owner.map(|owner| owner.0))
                .push_bind(model)
                .push_bind(player)
                .push_bind(at.as_millisecond());
        });
        insert.build().execute(&mut *connection).await?;
    }
    Ok(())
}

/// Rows of one insert statement.
const SEATS_AT_ONCE: usize = 256;

/// Stores the record of all seats' holders.
pub(in crate::store) async fn seat(
    connection: &mut Connection,
    row: &SeatingRow,
) -> Result<(), sqlx::Error> {
    query("UPDATE episodes SET seating = $1, head = $2 WHERE key = $3")
        .bind(row.record.as_str())
        .bind(&row.head.0[..])
        .bind(row.episode.0)
        .execute(connection)
        .await?;
    Ok(())
}
