//! The tables `claims` and `seats`: who holds which seat of an episode.

use jiff::Timestamp;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{Row, sqlite::Sqlite};
use swarmbench_engine::AgentId;

use super::episodes::time;
use super::{Store, failure};
use crate::journal::{ClaimRow, EpisodeKey, Held, Holder, JournalError, SeatingRow};
use crate::keys::OwnerKey;

/// A seat that has a holder, as it is shown.
#[derive(Clone, Debug)]
pub struct HeldSeat {
    /// The seat.
    pub agent: AgentId,
    /// The number of the claim; 0 for the creator.
    pub holder: u32,
    /// The name on the holder's key; none where nobody had to show one.
    pub name: Option<String>,
    /// Who plays.
    pub model: String,
    /// The built-in player that the server hosts here.
    pub player: Option<String>,
    /// Since when.
    pub claimed_at: Timestamp,
}

impl Store {
    /// All seats of an episode that have holders and were noted, in order; nothing where the creator
    /// simply holds all.
    ///
    /// # Errors
    /// Where the database cannot be read; so for all functions here.
    pub async fn held_seats(&self, episode: EpisodeKey) -> Result<Vec<HeldSeat>, JournalError> {
        let rows = sqlx::query(
            "SELECT s.agent, s.holder, k.name, s.model, s.player, s.claimed_at
             FROM seats s LEFT JOIN keys k ON k.number = s.owner WHERE s.episode = ? ORDER BY s.agent",
        )
        .bind(episode.0)
        .fetch_all(&mut *self.read().await?)
        .await
        .map_err(failure)?;
        let read = |row: &SqliteRow| {
            Ok(HeldSeat {
                agent: AgentId(row.try_get("agent")?),
                holder: row.try_get("holder")?,
                name: row.try_get("name")?,
                model: row.try_get("model")?,
                player: row.try_get("player")?,
                claimed_at: time(row.try_get("claimed_at")?)?,
            })
        };
        rows.iter().map(read).collect::<Result<_, _>>().map_err(failure)
    }

    /// The number of the claim that was made with an idempotency key, and the hash of the body sent then.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn claimed_with(&self, key: &str) -> Result<Option<(u32, Vec<u8>)>, JournalError> {
        let row =
            sqlx::query("SELECT holder, idempotency_body FROM claims WHERE idempotency_key = ?")
                .bind(key)
                .fetch_optional(&mut *self.read().await?)
                .await
                .map_err(failure)?;
        let read = |row: SqliteRow| Ok((row.try_get(0)?, row.try_get(1)?));
        row.map(read).transpose().map_err(failure)
    }

    /// The seats of one claim, in order.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn seats_of(
        &self,
        episode: EpisodeKey,
        holder: u32,
    ) -> Result<Vec<AgentId>, JournalError> {
        let rows =
            sqlx::query("SELECT agent FROM seats WHERE episode = ? AND holder = ? ORDER BY agent")
                .bind(episode.0)
                .bind(holder)
                .fetch_all(&mut *self.read().await?)
                .await
                .map_err(failure)?;
        let seats = rows.iter().map(|row| row.try_get(0).map(AgentId));
        seats.collect::<Result<_, _>>().map_err(failure)
    }

    /// Everybody who holds seats of an episode, with the seats.
    pub(super) async fn read_holders(
        &self,
        episode: EpisodeKey,
    ) -> Result<Vec<Held>, JournalError> {
        let rows = sqlx::query("SELECT * FROM claims WHERE episode = ? ORDER BY holder")
            .bind(episode.0)
            .fetch_all(&mut *self.read().await?)
            .await
            .map_err(failure)?;
        let mut all = Vec::with_capacity(rows.len());
        for row in &rows {
            let holder = holder(row).map_err(failure)?;
            let seats = self.seats_of(episode, holder.number).await?;
            all.push((holder, seats));
        }
        Ok(all)
    }

    /// The public id of a key.
    pub(super) async fn read_key_id(
        &self,
        owner: OwnerKey,
    ) -> Result<Option<String>, JournalError> {
        sqlx::query_scalar("SELECT id FROM keys WHERE number = ?")
            .bind(owner.0)
            .fetch_optional(&mut *self.read().await?)
            .await
            .map_err(failure)
    }
}

fn holder(row: &SqliteRow) -> Result<Holder, sqlx::Error> {
    let meta: String = row.try_get("agent_meta")?;
    Ok(Holder {
        number: row.try_get("holder")?,
        owner: row.try_get::<Option<i64>, _>("owner")?.map(OwnerKey),
        key: row.try_get("key")?,
        model: row.try_get("model")?,
        agent_meta: serde_json::from_str(&meta)
            .map_err(|error| sqlx::Error::Decode(error.into()))?,
        player: row.try_get("player")?,
        at: time(row.try_get("claimed_at")?)?,
    })
}

/// Notes a claim, without its tokens.
pub(super) async fn claim(
    connection: &mut SqliteConnection,
    row: &ClaimRow,
) -> Result<(), sqlx::Error> {
    let Holder { number, owner, key, model, agent_meta, player, at } = &row.holder;
    sqlx::query(
        "INSERT INTO claims (episode, holder, owner, key, model, agent_meta, player, claimed_at,
                             idempotency_key, idempotency_body)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
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
    for chunk in row.agents.chunks(SEATS_AT_ONCE) {
        let mut insert = sqlx::QueryBuilder::<Sqlite>::new(
            "INSERT INTO seats (episode, agent, holder, owner, model, player, claimed_at) ",
        );
        insert.push_values(chunk, |mut values, agent| {
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

/// Rows that one statement inserts at most.
const SEATS_AT_ONCE: usize = 256;

/// Keeps the record of who holds which seat.
pub(super) async fn seat(
    connection: &mut SqliteConnection,
    row: &SeatingRow,
) -> Result<(), sqlx::Error> {
    sqlx::query("UPDATE episodes SET seating = ?, head = ? WHERE key = ?")
        .bind(row.record.as_str())
        .bind(&row.head.0[..])
        .bind(row.episode.0)
        .execute(connection)
        .await?;
    Ok(())
}
