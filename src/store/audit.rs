//! The table `audit`: what organizers did.

use jiff::Timestamp;
use serde_json::Value;
use sqlx::Row;
use sqlx::sqlite::{SqliteConnection, SqliteRow};

use super::episodes::time;
use super::{Store, failure};
use crate::journal::{AuditRow, JournalError};

pub(super) async fn add(
    connection: &mut SqliteConnection,
    row: &AuditRow,
) -> Result<(), sqlx::Error> {
    sqlx::query("INSERT INTO audit (at, who, action, subject, detail) VALUES (?, ?, ?, ?, ?)")
        .bind(row.at.as_millisecond())
        .bind(&row.who)
        .bind(row.action)
        .bind(&row.subject)
        .bind(row.detail.to_string())
        .execute(connection)
        .await?;
    Ok(())
}

/// What an organizer did, as it is stored.
#[derive(Clone, Debug)]
pub struct StoredAuditEntry {
    /// Its number; it grows with time.
    pub number: i64,
    /// When.
    pub at: Timestamp,
    /// The id of the key, or `local` for work on the server's own machine.
    pub who: String,
    /// What was done.
    pub action: String,
    /// The id of what it was done to.
    pub subject: String,
    /// What else is to be known.
    pub detail: Value,
}

impl Store {
    /// Lists what organizers did, newest first, from the one after `before` on.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn audit(
        &self,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<StoredAuditEntry>, JournalError> {
        let rows = sqlx::query(
            "SELECT number, at, who, action, subject, detail FROM audit
             WHERE number < ? ORDER BY number DESC LIMIT ?",
        )
        .bind(before.unwrap_or(i64::MAX))
        .bind(limit)
        .fetch_all(&mut *self.read().await?)
        .await
        .map_err(failure)?;
        let read = |row: &SqliteRow| {
            let detail: String = row.try_get("detail")?;
            Ok(StoredAuditEntry {
                number: row.try_get("number")?,
                at: time(row.try_get("at")?)?,
                who: row.try_get("who")?,
                action: row.try_get("action")?,
                subject: row.try_get("subject")?,
                detail: serde_json::from_str(&detail)
                    .map_err(|error| sqlx::Error::Decode(error.into()))?,
            })
        };
        rows.iter().map(read).collect::<Result<_, _>>().map_err(failure)
    }
}
