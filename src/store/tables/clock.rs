//! The newest time in the database: a host clock behind it is wrong.

use jiff::Timestamp;
use serde::Deserialize;

use crate::store::Store;
use crate::store::StoreError;
use crate::store::sql::query;

/// The action of the audit log by which an organizer confirmed the time of day.
pub const CONFIRMED: &str = "clock.confirm";

/// When the newest entries came. Each table is looked at from its end, so that this takes no longer the more there is.
///
/// Acts have no number that grows with time, and no index of their times, which every act would have to pay for. The newest
/// one is of an episode that is played, or of one that has ended since, at the same time or later. Those that are played are
/// few and found by their status, and their newest acts are in their last rounds; those that have ended are found among the
/// newest episodes and runs. Rounds come with acts.
const NEWEST: &str = "
    SELECT max(at) FROM (
        SELECT max(at) AS at FROM (
            SELECT (SELECT max(a.at) FROM acts a WHERE a.episode = e.key AND a.round = (
                        SELECT max(l.round) FROM acts l WHERE l.episode = e.key)) AS at
            FROM episodes e WHERE e.status = 'running' ORDER BY e.key DESC LIMIT 10000) AS played
        UNION ALL
        SELECT max(at) FROM (SELECT coalesce(ended_at, created_at) AS at FROM episodes
                             ORDER BY key DESC LIMIT 1000) AS opened
        UNION ALL
        SELECT max(at) FROM (SELECT coalesce(ended_at, created_at) AS at FROM runs
                             ORDER BY key DESC LIMIT 1000) AS started
        UNION ALL
        SELECT max(at) FROM (SELECT registered_at AS at FROM entries ORDER BY key DESC LIMIT 100) AS entered
        UNION ALL
        SELECT max(at) FROM (SELECT coalesce(revealed_at, created_at) AS at FROM competitions) AS decided
        UNION ALL
        SELECT max(at) FROM (SELECT at FROM audit WHERE action <> $1 ORDER BY number DESC LIMIT 100) AS done
    ) AS newest";

/// The last time at which an organizer confirmed the time of day, and what was noted of it.
const LAST_CONFIRMED: &str = "
    SELECT at, detail FROM audit WHERE action = $1 ORDER BY number DESC LIMIT 1";

/// What is noted where an organizer confirms the time of day.
#[derive(Deserialize)]
struct Detail {
    /// When the newest entry before that came.
    newest_ms: Option<i64>,
}

impl Store {
    /// The earliest time of day that is possible, as the newest entry came then; none without entries.
    /// Entries that an organizer knew when confirming an earlier time do not count.
    pub async fn newest_at(&self) -> Result<Option<Timestamp>, StoreError> {
        let query = query(LAST_CONFIRMED).bind(CONFIRMED);
        let confirmed: Option<(Timestamp, String)> = self.fetch_optional(query).await?;
        let newest = self.newest_entry_at().await?;
        if let Some((at, detail)) = confirmed {
            let detail: Detail = serde_json::from_str(&detail).map_err(StoreError::decode)?;
            if newest.map(Timestamp::as_millisecond) <= detail.newest_ms {
                return Ok(Some(at));
            }
        }
        Ok(newest)
    }

    /// When the newest entry came, but for confirmations of the time of day.
    pub async fn newest_entry_at(&self) -> Result<Option<Timestamp>, StoreError> {
        self.fetch_one(query(NEWEST).bind(CONFIRMED)).await
    }
}
