//! Servers of the cluster: joining, beats, exclusion.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use sha2::{Digest as _, Sha256};
use tokio::sync::watch;

use super::super::group::session_name;
use super::super::session::{self, Server};
use super::{ALIVE, Cluster, Purpose, alive_key};
use crate::cluster::{CLOCK_OFF_MAX, Death, Lease, Places, STARTS_WITHIN, ServerRow};
use crate::ids::RoutingName;
use crate::store::sql::{Begin, Connection, query};
use crate::store::{OpenError, StoreError};

/// Limit of servers at the same time, each of which has a slot.
const SERVERS_MAX: i16 = 1024;

/// Settings of a server that joins a cluster.
#[derive(Clone, Debug)]
pub struct Joining {
    /// Host and port for requests of the other servers.
    pub address: String,
    /// Secret shared by the servers: proof of membership.
    pub secret: Arc<[u8]>,
    /// A forwarding server owns no places: it forwards every request about games to the owner.
    pub forwards_only: bool,
    /// Name by which load balancers know this server.
    pub routing_name: Option<RoutingName>,
    pub host_ms: fn() -> i64,
}

/// Errors of joining. Each message says what to do.
#[derive(Debug, thiserror::Error)]
pub enum JoinError {
    #[error(
        "the secret is not that of the other servers on {0}: give all of them the same --cluster-secret-file. To change it, stop \
         all of them first. If they are a cluster of their own, name another database with --db"
    )]
    Secret(String),
    #[error(
        "the clock of this machine is {off_ms} ms {direction} that of the database: it may be {most} ms off. Synchronize both, \
         with chrony say, and start again",
        most = CLOCK_OFF_MAX.as_millis()
    )]
    Clock { off_ms: u64, direction: &'static str },
    #[error("there are {SERVERS_MAX} servers on {0} already")]
    Full(String),
    #[error(
        "another server with the address {0} is running on this database: give each its own --cluster-address"
    )]
    Address(String),
}

/// A snapshot of the cluster.
#[derive(Clone, Debug, Default)]
pub struct ClusterSnapshot {
    /// All servers, oldest first.
    pub servers: Vec<ServerRow>,
    /// The revision of tokens and keys that servers must apply.
    pub revision: i64,
}

#[derive(Clone, Copy, Debug)]
pub struct Beat {
    pub is_ready: bool,
    pub episodes: u32,
}

/// Checks clock and secret of a joining server before it changes anything.
pub(in crate::store) async fn check(
    server: &Server,
    connection: &mut Connection,
    joining: &Joining,
) -> Result<(), OpenError> {
    let failed = |error| server.failed(error);
    let (before, now) = (
        (joining.host_ms)(),
        query("SELECT CAST(extract(epoch FROM clock_timestamp()) * 1000 AS bigint)"),
    );
    let database: i64 = now.one(connection).await.map_err(failed)?;
    let after = (joining.host_ms)();
    let off = i64::midpoint(before, after) - database;
    // The database read its clock at some moment between the two readings, so the offset is known to half their distance.
    let unsure = before.abs_diff(after) / 2;
    if off.unsigned_abs().saturating_sub(unsure)
        > u64::try_from(CLOCK_OFF_MAX.as_millis()).unwrap_or(0)
    {
        let direction = if off > 0 { "ahead of" } else { "behind" };
        return Err(JoinError::Clock { off_ms: off.unsigned_abs(), direction }.into());
    }
    let known: bool =
        query("SELECT to_regclass('cluster') IS NOT NULL").one(connection).await.map_err(failed)?;
    if !known {
        return Ok(());
    }
    let secret: Option<Vec<u8>> =
        query("SELECT secret FROM cluster WHERE EXISTS (SELECT 1 FROM members)")
            .optional(connection)
            .await
            .map_err(failed)?;
    if secret.is_some_and(|secret| secret != digest(&joining.secret)) {
        return Err(JoinError::Secret(server.location().to_owned()).into());
    }
    Ok(())
}

impl Cluster {
    /// Adds this server, with its number in `nodes`, to the cluster.
    pub(in crate::store) async fn join(
        server: &Server,
        connection: &mut Connection,
        incarnation: i64,
        joining: &Joining,
    ) -> Result<Arc<Self>, OpenError> {
        // Joins are serialized, so that no two servers get the same slot.
        let (slot, seen) = connection
            .transaction(Begin::Write, async |connection| {
                query("LOCK TABLE members IN SHARE ROW EXCLUSIVE MODE").execute(connection).await?;
                enter(server.location(), connection, incarnation, joining).await
            })
            .await
            .map_err(|error| match error {
                EnterError::Refused(refused) => OpenError::from(refused),
                EnterError::Database(error) => server.failed(error).into(),
            })?;
        let cluster = Self {
            server: server.clone(),
            incarnation,
            slot: i16::try_from(slot).expect("a slot is a small number"),
            started: Instant::now(),
            beats: tokio::sync::Mutex::default(),
            takes: tokio::sync::Mutex::default(),
            places: Places::default(),
            servers: Mutex::new(Arc::default()),
            incarnations: watch::Sender::new(Vec::new()),
            takes_places: AtomicBool::new(false),
            lease: Lease::default(),
            seen: AtomicU64::new(seen.unsigned_abs()),
            changes: tokio::sync::Mutex::default(),
            reads: AtomicU64::new(0),
        };
        cluster.lease.renew(cluster.started.elapsed());
        Ok(Arc::new(cluster))
    }

    /// Replaces the known servers.
    pub fn set_servers(&self, servers: Arc<[ServerRow]>) {
        self.places.saw(&servers);
        let numbers: Vec<i64> = servers.iter().map(|row| row.incarnation).collect();
        *self.servers.lock().expect("nothing panics while it holds this") = servers;
        self.incarnations.send_if_modified(|known| {
            let is_new = *known != numbers;
            *known = numbers;
            is_new
        });
    }

    /// The servers as last seen, oldest first.
    pub fn servers(&self) -> Arc<[ServerRow]> {
        Arc::clone(&self.servers.lock().expect("nothing panics while it holds this"))
    }

    /// Completes when a server has left or was excluded.
    pub fn gone(&self, incarnation: i64) -> impl Future<Output = ()> + Send + 'static {
        let mut known = self.incarnations.subscribe();
        async move {
            let is_gone = |known: &Vec<i64>| !known.contains(&incarnation);
            if known.wait_for(is_gone).await.is_err() {
                // The sender is gone: this server ends.
                std::future::pending::<()>().await;
            }
        }
    }

    /// Whether this is the oldest server that takes places, which does the work of a single server. Two servers may briefly
    /// both believe it.
    pub fn is_oldest(&self) -> bool {
        let servers = self.servers();
        let oldest = servers.iter().find(|row| row.is_ready);
        oldest.is_some_and(|oldest| oldest.incarnation == self.incarnation)
    }

    /// Renews this server's row. [`StoreError::Failed`] means that it was excluded; other errors leave that open.
    pub async fn beat(&self, beat: Beat, host_ms: fn() -> i64) -> Result<(), StoreError> {
        let sent = self.started.elapsed();
        let (before, places) = (host_ms(), self.places.count());
        let found: Option<i64> = self
            .on(&self.beats, Purpose::Beats, async |connection| {
                let update = query(
                    "UPDATE members SET beat_at = now_ms(),
                         is_ready = $2, episodes = $3, places = $4
                     WHERE incarnation = $1 RETURNING beat_at",
                );
                let update = update
                    .bind(self.incarnation)
                    .bind(beat.is_ready)
                    .bind(beat.episodes)
                    .bind(i64::try_from(places).unwrap_or(i64::MAX));
                update.optional(connection).await
            })
            .await?;
        let database = found.ok_or(StoreError::Failed)?;
        self.takes_places.store(beat.is_ready, Ordering::Release);
        let after = host_ms();
        self.lease.renew(sent);
        // A slow answer says little about the clock, so the last offset stays.
        let tells_clock = u128::from(before.abs_diff(after)) <= CLOCK_OFF_MAX.as_millis();
        let offset = tells_clock.then(|| i64::midpoint(before, after) - database);
        self.on(&self.beats, Purpose::Beats, async |connection| {
            show_connected(connection, self.incarnation).await?;
            let Some(offset) = offset else { return Ok(0) };
            let update = query("UPDATE members SET offset_ms = $2 WHERE incarnation = $1 AND abs(offset_ms - $2) > 5");
            update.bind(self.incarnation).bind(offset).execute(connection).await
        })
        .await?;
        Ok(())
    }

    /// Reads all servers and the revision they must apply.
    pub async fn snapshot(&self) -> Result<ClusterSnapshot, StoreError> {
        self.on(&self.beats, Purpose::Beats, async |connection| {
            let revision = query("SELECT revision FROM cluster").one(connection).await?;
            let rows = query(
                "SELECT m.incarnation, m.address, n.name, m.version, n.started_at,
                        now_ms() - m.beat_at, m.offset_ms, m.is_ready,
                        m.episodes, m.places, l.objid IS NOT NULL, m.beat_at
                 FROM members m JOIN nodes n ON n.incarnation = m.incarnation
                 LEFT JOIN pg_locks l ON l.locktype = 'advisory' AND l.granted AND l.objsubid = 2
                     AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database())
                     AND CAST(l.classid AS bigint) = $1 AND CAST(l.objid AS bigint) = (m.incarnation & 2147483647)
                 ORDER BY m.incarnation",
            );
            let rows = rows.bind(i64::from(ALIVE)).fetch_all(connection).await?;
            let servers = rows.iter().map(|row| {
                Ok(ServerRow {
                    incarnation: row.try_get(0)?,
                    address: row.try_get(1)?,
                    name: row.try_get(2)?,
                    version: row.try_get(3)?,
                    joined_at_ms: row.try_get(4)?,
                    seen_ms_ago: row.try_get(5)?,
                    clock_offset_ms: row.try_get(6)?,
                    is_ready: row.try_get(7)?,
                    episodes: row.try_get(8)?,
                    places: row.try_get(9)?,
                    is_connected: row.try_get(10)?,
                    beat_at_ms: row.try_get(11)?,
                })
            });
            let servers = servers.collect::<Result<_, sqlx::Error>>()?;
            Ok(ClusterSnapshot { servers, revision })
        })
        .await
    }

    /// Whether a server has a session in the database, which ends with its process or connection.
    pub async fn is_connected(&self, incarnation: i64) -> Result<bool, StoreError> {
        self.on(&self.beats, Purpose::Beats, async |connection| {
            is_connected(connection, incarnation).await
        })
        .await
    }

    /// Excludes a dead server: it can commit nothing more and its places are free. False if the server is alive after all.
    pub async fn exclude(&self, incarnation: i64, death: Death) -> Result<bool, StoreError> {
        self.on(&self.takes, Purpose::Takes, async |connection| {
            exclude(connection, incarnation, death).await
        })
        .await
    }
}

/// The digest of the secret in the table `cluster`.
fn digest(secret: &[u8]) -> Vec<u8> {
    let mut hash = Sha256::new();
    hash.update(b"swarmbench cluster\0");
    hash.update(secret);
    hash.finalize().to_vec()
}

#[derive(Debug, thiserror::Error)]
enum EnterError {
    #[error(transparent)]
    Refused(#[from] JoinError),
    #[error(transparent)]
    Database(#[from] sqlx::Error),
}

/// Inserts the rows of a new server, which gets a free slot.
async fn enter(
    location: &str,
    connection: &mut Connection,
    incarnation: i64,
    joining: &Joining,
) -> Result<(i64, i64), EnterError> {
    let secret = digest(&joining.secret);
    // A cluster without servers may get another secret.
    let kept = query(
        "INSERT INTO cluster (secret) VALUES ($1) ON CONFLICT (one) DO UPDATE SET secret = excluded.secret
         WHERE cluster.secret = excluded.secret OR NOT EXISTS (SELECT 1 FROM members)",
    );
    if kept.bind(&secret).execute(connection).await? == 0 {
        return Err(JoinError::Secret(location.to_owned()).into());
    }
    // This process listens at the address, so a former owner is dead, unless another machine has the same address.
    let same: Vec<i64> = query("SELECT incarnation FROM members WHERE address = $1")
        .bind(&joining.address)
        .all(connection)
        .await?;
    for before in same {
        if is_connected(connection, before).await? {
            return Err(JoinError::Address(joining.address.clone()).into());
        }
        delete(connection, before, Death::Replaced).await?;
    }
    let joined = query(
        "INSERT INTO members (incarnation, slot, address, version, beat_at, seen)
         SELECT $1, s.slot, $2, $3, now_ms() + $5, c.revision
         FROM cluster c, generate_series(0, $4) AS s (slot)
         WHERE NOT EXISTS (SELECT 1 FROM members m WHERE m.slot = s.slot)
         ORDER BY s.slot LIMIT 1 RETURNING slot, seen",
    );
    let joined = joined
        .bind(incarnation)
        .bind(&joining.address)
        .bind(env!("CARGO_PKG_VERSION"))
        .bind(i64::from(SERVERS_MAX - 1))
        .bind(i64::try_from(STARTS_WITHIN.as_millis()).unwrap_or(i64::MAX))
        .optional::<(i64, i64)>(connection)
        .await?;
    joined.ok_or_else(|| JoinError::Full(location.to_owned()).into())
}

/// Takes the advisory lock that proves this server's session, unless the session has it. An old session may hold the lock
/// until PostgreSQL notices that its connection broke, so every beat tries again.
pub(super) async fn show_connected(
    connection: &mut Connection,
    incarnation: i64,
) -> Result<(), sqlx::Error> {
    let lock = query(
        "SELECT pg_try_advisory_lock(CAST($1 AS integer), CAST($2 AS integer))
         WHERE NOT EXISTS (SELECT 1 FROM pg_locks WHERE locktype = 'advisory' AND granted AND objsubid = 2
             AND pid = pg_backend_pid() AND CAST(classid AS bigint) = $1)",
    );
    let lock = lock.bind(i64::from(ALIVE)).bind(alive_key(incarnation));
    lock.optional::<bool>(connection).await.map(drop)
}

async fn is_connected(connection: &mut Connection, incarnation: i64) -> Result<bool, sqlx::Error> {
    let lock = query(
        "SELECT EXISTS (SELECT 1 FROM pg_locks WHERE locktype = 'advisory' AND granted AND objsubid = 2
             AND database = (SELECT oid FROM pg_database WHERE datname = current_database())
             AND CAST(classid AS bigint) = $1 AND CAST(objid AS bigint) = $2)",
    );
    lock.bind(i64::from(ALIVE)).bind(alive_key(incarnation)).one(connection).await
}

/// Deletes a server's rows in an order that excludes it for certain: a later beat finds no row, and a commit under way is
/// done before the deletion or fails. False if the server has sent a beat meanwhile.
async fn exclude(
    connection: &mut Connection,
    incarnation: i64,
    death: Death,
) -> Result<bool, sqlx::Error> {
    // Otherwise the deletion would wait for a transaction that the server left open.
    let sessions = query(
        "SELECT CAST(pid AS bigint) FROM pg_stat_activity
         WHERE datname = current_database() AND (application_name = $1 OR application_name LIKE $1 || '/%')
             AND EXISTS (SELECT 1 FROM members WHERE incarnation = $2 AND beat_at < now_ms() - $3)",
    );
    let sessions: Vec<i64> = sessions
        .bind(session_name(incarnation))
        .bind(incarnation)
        .bind(death.silent_ms())
        .all(connection)
        .await?;
    for pid in sessions {
        session::terminate(connection, pid).await?;
    }
    connection
        .transaction(Begin::Write, async |connection| delete(connection, incarnation, death).await)
        .await
}

/// Deletes a server's rows in the open transaction; false if the server has sent a beat meanwhile.
async fn delete(
    connection: &mut Connection,
    incarnation: i64,
    death: Death,
) -> Result<bool, sqlx::Error> {
    let expired = query("DELETE FROM members WHERE incarnation = $1 AND beat_at < now_ms() - $2");
    let expired = expired.bind(incarnation).bind(death.silent_ms());
    if expired.execute(connection).await? == 0 {
        return Ok(false);
    }
    let row = query("DELETE FROM nodes WHERE incarnation = $1").bind(incarnation);
    row.execute(connection).await?;
    Ok(true)
}
