//! Changes that all servers must know: revoked tokens and keys, and the effects of commits on boards and lists.

use std::collections::HashSet;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use sqlx::Arguments as _;
use sqlx::postgres::PgArguments;

use super::places::{take, taken_by};
use super::{Cluster, Purpose};
use crate::cluster::TAKEN_OVER_AFTER;
use crate::ids::Place;
use crate::store::StoreError;
use crate::store::entries::Entry;
use crate::store::results::Effect;
use crate::store::sql::{Connection, Engine, query};

/// Age at which changes are deleted. A server that has not read them by then reads everything again.
const CHANGES_KEPT: Duration = Duration::from_mins(30);

#[derive(Default)]
pub(super) struct ChangesRead {
    /// All transactions with lower ids have been read.
    horizon: i64,
    /// Changes already read of transactions from the horizon on.
    newer: HashSet<(i64, i16, i64)>,
    at: Option<Instant>,
    /// Number of the last completed read.
    complete: u64,
}

impl Cluster {
    /// The revision of tokens and keys that this server has applied.
    pub fn seen(&self) -> i64 {
        i64::try_from(self.seen.load(Ordering::Acquire)).unwrap_or(i64::MAX)
    }

    /// Announces revoked tokens or keys; returns the revision that all servers must apply.
    pub async fn announce(&self) -> Result<i64, StoreError> {
        self.on(&self.takes, Purpose::Takes, async |connection| {
            let count = query("UPDATE cluster SET revision = revision + 1 RETURNING revision");
            count.one(connection).await
        })
        .await
    }

    /// Records that this server has applied a revision.
    pub async fn act_by(&self, revision: i64) -> Result<(), StoreError> {
        self.on(&self.beats, Purpose::Beats, async |connection| {
            let update = query("UPDATE members SET seen = $2 WHERE incarnation = $1 AND seen < $2");
            update.bind(self.incarnation).bind(revision).execute(connection).await
        })
        .await?;
        self.seen.fetch_max(revision.unsigned_abs(), Ordering::AcqRel);
        Ok(())
    }

    /// Whether all servers have applied a revision.
    pub async fn all_act_by(&self, revision: i64) -> Result<bool, StoreError> {
        self.on(&self.beats, Purpose::Beats, async |connection| {
            // A starting server has cached no token, and sends its first beat before it answers requests.
            let behind = query(
                "SELECT NOT EXISTS (SELECT 1 FROM members WHERE seen < $1 AND beat_at <= now_ms() + $2)",
            );
            let starts = i64::try_from(TAKEN_OVER_AFTER.as_millis()).unwrap_or(i64::MAX);
            behind.bind(revision).bind(starts).one(connection).await
        })
        .await
    }

    /// Reads the other servers' changes since the last read and passes them to `note`; calls `forget` where some are lost.
    /// Concurrent callers share a read.
    pub(in crate::store) async fn read_changes(
        &self,
        note: impl Fn(Effect),
        forget: impl FnOnce(),
    ) -> Result<(), StoreError> {
        let wanted = self.reads.fetch_add(1, Ordering::AcqRel) + 1;
        let mut read = self.changes.lock().await;
        if read.complete >= wanted {
            return Ok(());
        }
        // This read serves every caller that has asked by now.
        let serves = self.reads.load(Ordering::Acquire);
        let horizon = read.horizon;
        let rows = self
            .on(&self.takes, Purpose::Takes, async |connection| {
                let rows = query(
                    "SELECT CAST(CAST(pg_snapshot_xmin(pg_current_snapshot()) AS text) AS bigint),
                            CAST(CAST(c.xid AS text) AS bigint), CAST(c.kind AS bigint), c.key
                     FROM (VALUES (1)) AS one LEFT JOIN changes c
                         ON c.xid >= CAST(CAST($1 AS text) AS xid8) AND c.owner <> $2",
                );
                let rows = rows.bind(horizon.to_string()).bind(self.incarnation);
                rows.all::<(i64, Option<i64>, Option<i64>, Option<i64>)>(connection).await
            })
            .await?;
        let is_first = read.at.is_none();
        // Data read from the database before the first read of changes may be older than these changes.
        if read.at.is_none_or(|at| at.elapsed() > CHANGES_KEPT / 2) {
            forget();
        }
        let mut newer = HashSet::new();
        for (next, xid, kind, key) in rows {
            read.horizon = read.horizon.max(next);
            let (Some(xid), Some(kind), Some(key)) = (xid, kind, key) else { continue };
            let Ok(kind) = i16::try_from(kind) else { continue };
            if !is_first && !read.newer.contains(&(xid, kind, key)) {
                note(Effect { kind, key });
            }
            newer.insert((xid, kind, key));
        }
        let horizon = read.horizon;
        newer.retain(|(xid, ..)| *xid >= horizon);
        read.newer = newer;
        read.at = Some(Instant::now());
        read.complete = serves;
        Ok(())
    }

    /// Deletes changes older than `CHANGES_KEPT`.
    pub async fn delete_old_changes(&self) -> Result<(), StoreError> {
        let kept = i64::try_from(CHANGES_KEPT.as_millis()).unwrap_or(i64::MAX);
        self.on(&self.takes, Purpose::Takes, async |connection| {
            let delete = query("DELETE FROM changes WHERE at < now_ms() - $1");
            delete.bind(kept).execute(connection).await
        })
        .await?;
        Ok(())
    }
}

/// Writes the taken places and the changes that follow from entries, in their transaction.
pub(in crate::store) async fn write(
    connection: &mut Connection,
    incarnation: i64,
    entries: impl Iterator<Item = &Entry> + Clone,
) -> Result<(), sqlx::Error> {
    let forks = entries.clone().filter_map(|entry| match entry {
        Entry::BeginForks(episodes) => Some(episodes.as_slice()),
        _ => None,
    });
    let forks = forks.flatten().map(|episode| Place::Game(*episode));
    let places: Vec<Place> = entries.clone().filter_map(taken_by).chain(forks).collect();
    if !places.is_empty() {
        take(connection, &places, incarnation).await?;
    }
    let effects: Vec<Effect> = entries.filter_map(Effect::of).collect();
    if effects.is_empty() {
        return Ok(());
    }
    let mut arguments = PgArguments::default();
    let (kinds, keys): (Vec<i16>, Vec<i64>) =
        effects.iter().map(|effect| (effect.kind, effect.key)).unzip();
    arguments.add(kinds).map_err(sqlx::Error::Encode)?;
    arguments.add(keys).map_err(sqlx::Error::Encode)?;
    arguments.add(incarnation).map_err(sqlx::Error::Encode)?;
    let Engine::Postgres(connection) = connection.engine() else {
        unreachable!("it is of PostgreSQL")
    };
    sqlx::query_with(
        "INSERT INTO changes (owner, kind, key, at)
         SELECT $3, t.kind, t.key, now_ms()
         FROM unnest($1::smallint[], $2::bigint[]) AS t (kind, key)",
        arguments,
    )
    .execute(connection)
    .await
    .map(drop)
}
