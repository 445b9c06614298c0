//! The newest time in the database. A host clock behind it is wrong.

use jiff::Timestamp;
use serde::Deserialize;

use crate::store::Store;
use crate::store::StoreError;
use crate::store::sql::query;

/// Audit action by which an organizer confirms the time of day.
pub const CONFIRMED: &str = "clock.confirm";

/// The time of the newest entry. Each table is read from its end, so that the query does not become slower with more rows.
///
/// Acts have no number that grows with time, and an index of their times would make every act dearer. The newest act belongs
/// to an unfinished episode, or to one that has ended at that time or later. Unfinished episodes are few and found by their
/// status, and their newest acts are in their last rounds; ended ones are among the newest episodes and runs. Rounds come
/// with acts.
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

/// The last confirmation of the time of day, with its details.
const LAST_CONFIRMED: &str = "
    SELECT at, detail FROM audit WHERE action = $1 ORDER BY number DESC LIMIT 1";

/// Details of a confirmation.
#[derive(Deserialize)]
struct Detail {
    /// Time of the newest entry before the confirmation.
    newest_ms: Option<i64>,
}

impl Store {
    /// Lower bound of the time of day: the time of the newest entry; `None` without entries. Entries known to an organizer
    /// who then confirmed an earlier time do not count.
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

    /// Time of the newest entry, confirmations of the time of day excluded.
    pub async fn newest_entry_at(&self) -> Result<Option<Timestamp>, StoreError> {
        self.fetch_one(query(NEWEST).bind(CONFIRMED)).await
    }
}
