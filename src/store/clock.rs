//! The newest time in the database: a host clock behind it is wrong.

use jiff::Timestamp;

use super::episodes::time;
use super::{Store, failure};
use crate::journal::JournalError;

/// The action of the audit log by which an organizer confirmed the time of day.
pub const CONFIRMED: &str = "clock.confirm";

/// When the newest entries came. Each table is looked at from its end, so that this takes no longer the
/// more there is; rounds come with acts.
const NEWEST: &str = "
    SELECT max(at) FROM (
        SELECT max(at) AS at FROM (SELECT at FROM acts ORDER BY rowid DESC LIMIT 100)
        UNION ALL
        SELECT max(at) FROM (SELECT coalesce(ended_at, created_at) AS at FROM episodes
                             ORDER BY key DESC LIMIT 1000)
        UNION ALL
        SELECT max(at) FROM (SELECT coalesce(ended_at, created_at) AS at FROM runs
                             ORDER BY key DESC LIMIT 1000)
        UNION ALL
        SELECT max(at) FROM (SELECT registered_at AS at FROM entries ORDER BY key DESC LIMIT 100)
        UNION ALL
        SELECT max(at) FROM (SELECT coalesce(revealed_at, created_at) AS at FROM competitions)
        UNION ALL
        SELECT max(at) FROM (SELECT at FROM audit WHERE action <> ?1 ORDER BY number DESC LIMIT 100)
    )";

/// The last time at which an organizer confirmed the time of day, and the newest entry before that.
const LAST_CONFIRMED: &str = "
    SELECT at, json_extract(detail, '$.newest_ms') FROM audit WHERE action = ?1
    ORDER BY number DESC LIMIT 1";

impl Store {
    /// The moment before which no time of day can be, as something happened then; none where nothing did.
    /// What an organizer knew of who confirmed an earlier time is not counted.
    ///
    /// # Errors
    /// Where the database cannot be read; so for all functions here.
    pub async fn newest_at(&self) -> Result<Option<Timestamp>, JournalError> {
        let confirmed: Option<(i64, Option<i64>)> = sqlx::query_as(LAST_CONFIRMED)
            .bind(CONFIRMED)
            .fetch_optional(&mut *self.read().await?)
            .await
            .map_err(failure)?;
        let newest = self.newest_entry_at().await?;
        let Some((at, known)) = confirmed else { return Ok(newest) };
        let known = known.map(time).transpose().map_err(failure)?;
        if newest <= known {
            return Ok(Some(time(at).map_err(failure)?));
        }
        Ok(newest)
    }

    /// When the newest entry came, but for confirmations of the time of day.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn newest_entry_at(&self) -> Result<Option<Timestamp>, JournalError> {
        let newest: Option<i64> = sqlx::query_scalar(NEWEST)
            .bind(CONFIRMED)
            .fetch_one(&mut *self.read().await?)
            .await
            .map_err(failure)?;
        newest.map(time).transpose().map_err(failure)
    }
}
