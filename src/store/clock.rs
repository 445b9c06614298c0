//! The newest time in the database: a host clock behind it is wrong.

use jiff::Timestamp;

use super::Store;
use super::StoreError;

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
    /// The earliest time of day that is possible, as the newest entry came then; none without entries.
    /// Entries that an organizer knew when confirming an earlier time do not count.
    pub async fn newest_at(&self) -> Result<Option<Timestamp>, StoreError> {
        let query = sqlx::query(LAST_CONFIRMED).bind(CONFIRMED);
        let confirmed: Option<(Timestamp, Option<Timestamp>)> = self.fetch_optional(query).await?;
        let newest = self.newest_entry_at().await?;
        if let Some((at, known)) = confirmed
            && newest <= known
        {
            return Ok(Some(at));
        }
        Ok(newest)
    }

    /// When the newest entry came, but for confirmations of the time of day.
    pub async fn newest_entry_at(&self) -> Result<Option<Timestamp>, StoreError> {
        self.fetch_one(sqlx::query(NEWEST).bind(CONFIRMED)).await
    }
}
