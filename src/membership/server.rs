//! The [`Port`] of a server: its database on PostgreSQL, the clock of its host, and its games.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::io::ErrorKind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use swarmbench_clock::{Clock as _, SystemClock};
use tokio::net::TcpStream;
use tokio_util::sync::CancellationToken;

use super::{Others, Port};
use crate::cluster::watch::ClockSeen;
use crate::cluster::{Death, Incarnation, Places, ServerRow};
use crate::episode::registry::Registry;
use crate::fair::Party;
use crate::ids::{EpisodeKey, Place, RunKey};
use crate::run::manager::{Held, Runs};
use crate::store::{Beat, Cluster, Store, StoreError};

/// Timeout for a live process to accept a connection.
const ACCEPT_PATIENCE: Duration = Duration::from_millis(500);

/// Dependencies of a server's part in the cluster.
pub struct Parts {
    pub store: Store,
    pub cluster: Arc<Cluster>,
    pub registry: Registry,
    pub runs: Runs,
    /// Whether the other servers reach this one.
    pub is_reachable: Arc<AtomicBool>,
    /// Whether this server takes no places, and lets the others answer.
    pub forwards_only: bool,
    /// Cancelled when this server stops: it takes no more places.
    pub stop: CancellationToken,
    /// Stop signal: the clock of this server is off while that of another one is right.
    pub clock_is_off: CancellationToken,
    /// Called when this server has taken the places that waited for it; repeatedly where it only forwards.
    pub ready: Arc<dyn Fn() + Send + Sync>,
    /// Called when tokens or keys were revoked, before this server confirms the revocation.
    pub revoked: Arc<dyn Fn() + Send + Sync>,
}

/// A server's part in the cluster.
pub struct Membership {
    parts: Parts,
    started: Instant,
}

impl Membership {
    #[must_use]
    pub fn new(parts: Parts) -> Self {
        Self { parts, started: Instant::now() }
    }

    /// This server, as last seen.
    fn own(&self) -> Option<ServerRow> {
        let servers = self.parts.cluster.servers();
        servers.iter().find(|row| row.incarnation == self.me()).cloned()
    }
}

/// Time of day of this host, in milliseconds.
pub fn host_ms() -> i64 {
    SystemClock.now().as_millisecond()
}

impl Others for Cluster {
    fn servers(&self) -> Arc<[ServerRow]> {
        Self::servers(self)
    }

    fn set_servers(&self, servers: Arc<[ServerRow]>) {
        Self::set_servers(self, servers);
    }

    /// The database has no session of the server, and its address refuses connections. An address that does not answer proves
    /// nothing, as the process may be stopped, or cut off.
    async fn is_dead(&self, row: &ServerRow) -> bool {
        let connecting = TcpStream::connect(&row.address);
        let refused = match tokio::time::timeout(ACCEPT_PATIENCE, connecting).await {
            Ok(Err(error)) => error.kind() == ErrorKind::ConnectionRefused,
            Ok(Ok(_)) | Err(_) => false,
        };
        refused && matches!(self.is_connected(row.incarnation).await, Ok(false))
    }

    async fn exclude(&self, server: Incarnation, death: Death) -> Result<bool, StoreError> {
        let is_excluded = Self::exclude(self, server, death).await?;
        if is_excluded {
            self.delete_incomplete_forks().await?;
        }
        Ok(is_excluded)
    }
}

impl Port for Membership {
    type Others = Cluster;
    type Held<'a> = HashMap<RunKey, Held<'a>>;

    fn others(&self) -> &Cluster {
        &self.parts.cluster
    }

    fn places(&self) -> &Places {
        self.parts.cluster.places()
    }

    fn me(&self) -> Incarnation {
        self.parts.cluster.incarnation()
    }

    fn forwards_only(&self) -> bool {
        self.parts.forwards_only
    }

    fn now(&self) -> Duration {
        self.started.elapsed()
    }

    async fn sleep(&self, pause: Duration) {
        tokio::time::sleep(pause).await;
    }

    async fn beat(&self) -> Result<(), StoreError> {
        let Parts { cluster, registry, is_reachable, forwards_only, stop, .. } = &self.parts;
        let is_ready =
            is_reachable.load(Ordering::Acquire) && !forwards_only && !stop.is_cancelled();
        let episodes = u32::try_from(registry.in_memory()).unwrap_or(u32::MAX);
        cluster.beat(Beat { is_ready, episodes }, host_ms).await
    }

    async fn look(&self) -> Result<Vec<ServerRow>, StoreError> {
        let Parts { cluster, revoked, .. } = &self.parts;
        let snapshot = cluster.snapshot().await?;
        if snapshot.revision > cluster.seen() {
            revoked();
            if let Err(StoreError::Failed) = cluster.act_by(snapshot.revision).await {
                return Err(StoreError::Failed);
            }
        }
        Ok(snapshot.servers)
    }

    async fn unowned(&self) -> Result<Vec<Place>, StoreError> {
        self.parts.cluster.unowned().await
    }

    async fn take(&self, places: &[Place]) -> Result<Vec<(Place, Incarnation)>, StoreError> {
        self.parts.cluster.take_noted(places).await
    }

    async fn release(&self, places: &[Place]) -> Result<(), StoreError> {
        self.parts.cluster.release(places).await
    }

    async fn release_ended(&self) -> Result<(), StoreError> {
        self.parts.cluster.release_ended().await
    }

    async fn delete_old_changes(&self) -> Result<(), StoreError> {
        self.parts.cluster.delete_old_changes().await
    }

    async fn resume(&self, places: &[Place]) -> Result<(), StoreError> {
        let Parts { store, registry, runs, .. } = &self.parts;
        let unfinished = store.unfinished_at(places).await?;
        let keys: Vec<EpisodeKey> = unfinished.iter().map(|episode| episode.episode).collect();
        for (episode, owner, competition) in store.accounts_of(&keys).await? {
            registry.host().quotas.note(episode, Party::within(competition, owner));
        }
        let episodes = registry.adopt(unfinished).await;
        tracing::info!(places = places.len(), episodes, "took over work that no server did");
        for place in places {
            if let Place::Run(run) = place {
                runs.try_advance(*run).await;
            }
        }
        Ok(())
    }

    fn idle(&self, places: Vec<Place>) -> (Vec<Place>, Self::Held<'_>) {
        let Parts { registry, runs, .. } = &self.parts;
        let mut idle: Vec<Place> =
            registry.idle_places(places.into_iter().collect()).into_iter().collect();
        let of_runs = idle.iter().filter_map(|place| match place {
            Place::Run(run) => Some(*run),
            Place::Game(_) | Place::Competition(_) => None,
        });
        let held = runs.hold(&of_runs.collect::<Vec<_>>());
        idle.retain(|place| match place {
            Place::Run(run) => held.contains_key(run),
            Place::Game(_) => true,
            Place::Competition(_) => false,
        });
        (idle, held)
    }

    async fn evict(&self, places: &[Place]) -> Result<BTreeSet<Place>, StoreError> {
        let places: HashSet<Place> = places.iter().copied().collect();
        Ok(self.parts.registry.give_up(places).await?.into_iter().collect())
    }

    fn excluded(&self) {
        self.parts.store.set_excluded();
    }

    fn ready(&self) {
        (self.parts.ready)();
    }

    fn clock_seen(&self, clock: ClockSeen) {
        match clock {
            ClockSeen::Off { is_new: true } => {
                let off_ms = self.own().map(|own| own.clock_offset_ms);
                tracing::error!(
                    off_ms,
                    "the clock of this machine is too far from that of the database: synchronize both"
                );
            }
            ClockSeen::OffForTooLong => self.parts.clock_is_off.cancel(),
            ClockSeen::Right | ClockSeen::Off { is_new: false } => {}
        }
    }

    fn measure(&self) {
        let cluster = &self.parts.cluster;
        metrics::gauge!("swarmbench_nodes").set(count(cluster.servers().len()));
        metrics::gauge!("swarmbench_places").set(count(cluster.places().count()));
        metrics::gauge!("swarmbench_lease_seconds").set(cluster.answers_for().as_secs_f64());
        if let Some(own) = self.own() {
            #[expect(clippy::cast_precision_loss, reason = "a gauge is a double")]
            metrics::gauge!("swarmbench_clock_offset_seconds")
                .set(own.clock_offset_ms as f64 / 1000.0);
        }
    }
}

#[expect(clippy::cast_precision_loss, reason = "a gauge is a double")]
const fn count(number: usize) -> f64 {
    number as f64
}
