//! The table `audit`: actions of organizers.

use jiff::Timestamp;
use serde_json::Value;

use crate::ids::CompetitionKey;
use crate::store::Store;
use crate::store::StoreError;
use crate::store::entries::AuditRow;
use crate::store::sql::{Connection, from_row, query};

pub(in crate::store) async fn add(
    connection: &mut Connection,
    row: &AuditRow,
) -> Result<(), sqlx::Error> {
    query(
        "INSERT INTO audit (at, who, action, subject, detail, competition, shown)
         VALUES ($1, $2, $3, $4, $5, $6, $7)",
    )
    .bind(row.at.as_millisecond())
    .bind(&row.who)
    .bind(row.action)
    .bind(&row.subject)
    .bind(row.detail.to_string())
    .bind(row.shown.as_ref().map(|(competition, _)| competition.0))
    .bind(row.shown.as_ref().map(|(_, shown)| shown.to_string()))
    .execute(connection)
    .await?;
    Ok(())
}

#[derive(Clone, Debug)]
pub struct StoredAuditEntry {
    /// Number of the entry; grows with time.
    pub number: i64,
    pub at: Timestamp,
    /// The id of the key, or `local` for work on the server's own machine.
    pub who: String,
    pub action: String,
    /// Id of the object of the action.
    pub subject: String,
    pub detail: Value,
}

/// An action of an organizer in a competition, in its public form.
#[derive(Clone, Debug)]
pub struct ShownAction {
    /// Number of the entry; grows with time.
    pub number: i64,
    pub at: Timestamp,
    pub action: String,
    /// Id of the object of the action.
    pub subject: String,
    /// The public part of the details.
    pub shown: Value,
}

impl Store {
    /// Lists entries, newest first, starting after the entry `before`.
    pub async fn audit(
        &self,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<StoredAuditEntry>, StoreError> {
        let query = query(
            "SELECT number, at, who, action, subject, detail FROM audit
             WHERE number < $1 ORDER BY number DESC LIMIT $2",
        );
        self.fetch_all(query.bind(before.unwrap_or(i64::MAX)).bind(limit)).await
    }

    /// Lists the actions in a competition in their public form, newest first, starting after the entry `before`; with `only`,
    /// those of one kind.
    pub async fn actions_in(
        &self,
        competition: CompetitionKey,
        only: Option<&str>,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<ShownAction>, StoreError> {
        let query = query(
            "SELECT number, at, action, subject, shown FROM audit
             WHERE competition = $1 AND number < $2 AND (CAST($3 AS TEXT) IS NULL OR action = $3)
             ORDER BY number DESC LIMIT $4",
        );
        let before = before.unwrap_or(i64::MAX);
        let query = query.bind(competition.0).bind(before).bind(only).bind(limit);
        self.fetch_all(query).await
    }
}

from_row! {
    StoredAuditEntry { number, at, who, action, subject, detail }
    ShownAction { number, at, action, subject, shown }
}
