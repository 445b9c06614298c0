//! Opens, runs and stops the whole server. `main` and the tests start the same one.

use std::io;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use futures::future::FutureExt as _;
use tokio::net::{TcpListener, TcpSocket};
use tokio::runtime::Handle;
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

use crate::budget::Budget;
use crate::competitions::closing;
use crate::episode::actor::Spawn;
use crate::episode::quota::Quotas;
use crate::episode::registry::Registry;
use crate::fair::Party;
use crate::host::{Disk, HostDisk, OtherHostsDisk, memory_bytes, raise_open_files};
use crate::hosted;
use crate::http::limits::Limits;
use crate::http::serve::{CONNECTION_BYTES, serve};
use crate::http::{Access, App, Forwarder, ForwardingPeers, Foundation, Front, Source};
use crate::ids::Numbers;
use crate::measure;
use crate::membership::{self, Membership};
use crate::run::RunError;
use crate::run::manager::{self, Peers, Runs};
use crate::store::port::EpisodeStore;
use crate::store::{Beat, Cluster, Joining, Location, OpenError, Store, StoreError};
use crate::telemetry;
use crate::work::Workers;
use swarmbench_clock::{BEAT, Clock, Entropy, ServerClock, SystemEntropy, after, millis};

/// Pause before the server retries to recover unfinished episodes and runs.
const RECOVERY_RETRY_PAUSE: Duration = Duration::from_secs(1);

/// Interval between sweeps of idle episodes, waiting runs and caches.
const SWEEP: Duration = Duration::from_mins(1);

/// Replaceable parts of a server; the defaults are the host's own.
#[derive(Clone)]
pub struct Parts {
    pub clock: Arc<dyn Clock>,
    pub entropy: Arc<dyn Entropy>,
    /// Disk of the database; `None` for the host's own.
    pub disk: Option<Arc<dyn Disk>>,
    pub limits: Limits,
    pub access: Access,
    /// Source of the files of pages.
    pub pages: Source,
    /// Identity with which the server joins others on the same database; `None` for a single server.
    pub joining: Option<Joining>,
}

impl Default for Parts {
    fn default() -> Self {
        Self {
            clock: Arc::new(ServerClock::default()),
            entropy: Arc::new(SystemEntropy),
            disk: None,
            limits: Limits::default(),
            access: Access::default(),
            pages: Source::default(),
            joining: None,
        }
    }
}

/// Open files besides client connections: the database, refused connections, and a reserve.
const FILES_RESERVED: u64 = 256;

/// Raises the limit of open files as far as the host allows, and caps connections to it.
pub fn fit_open_files(limits: Limits) -> Limits {
    let files = raise_open_files();
    let fitting = within_files(&limits, files);
    if fitting.connections_max < limits.connections_max {
        tracing::warn!(
            open_files = files,
            connections_max = fitting.connections_max,
            usual = limits.connections_max,
            "the limit of open files is too low for all connections: raise it (ulimit -n)"
        );
    }
    fitting
}

/// Limits the memory of worlds and answers to `memory_max` bytes, or to half of what this process may use. Caps connections to a
/// quarter of that, and bodies and the backlog to a sixteenth each.
pub fn fit_memory(limits: Limits, memory_max: Option<usize>) -> Limits {
    let half = memory_bytes().map(|bytes| bytes / 2);
    let memory = memory_max.or(half).unwrap_or(limits.memory_bytes_max);
    Limits {
        memory_bytes_max: memory,
        connections_max: limits.connections_max.min(memory / 4 / CONNECTION_BYTES).max(1),
        bodies_bytes_max: limits.bodies_bytes_max.min(memory / 16),
        backlog_bytes_max: limits.backlog_bytes_max.min(memory / 16),
        ..limits
    }
}

/// Limits that fit this many open files; `None` means no limit.
fn within_files(limits: &Limits, files: Option<u64>) -> Limits {
    let fit = files.map_or(u64::MAX, |files| files.saturating_sub(FILES_RESERVED).max(1));
    let fit = usize::try_from(fit).unwrap_or(usize::MAX);
    Limits { connections_max: limits.connections_max.min(fit), ..*limits }
}

/// Connections that the host queues before this process accepts them. With the usual 128, some of many simultaneous connections are
/// retried only after a second.
const ACCEPT_BACKLOG: u32 = 4096;

pub fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    // The port may still have closing connections of an earlier process.
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    socket.listen(ACCEPT_BACKLOG)
}

#[derive(Debug, thiserror::Error)]
pub enum StartError {
    #[error(transparent)]
    Open(#[from] OpenError),
    #[error(transparent)]
    Journal(#[from] StoreError),
    /// The other servers cannot connect to this one.
    #[error("{0}")]
    Unreachable(String),
    /// The other servers have taken over this one's games.
    #[error(
        "the other servers have excluded this one, as it was not seen for too long: start it again, and it joins them anew"
    )]
    Excluded,
    /// A fault has stopped this server; the others continue its games.
    #[error("{0}: the other servers play on; start this one again, and it joins them anew")]
    Fault(String),
    /// The clock of this server was off; servers with correct clocks have taken its games.
    #[error(
        "the clock of this machine was too far from that of the database, so the other servers play on: synchronize it and start \
         this server again"
    )]
    ClockOff,
}

/// A server over an open database.
pub struct Server {
    app: App,
    joining: Option<Joining>,
}

impl Server {
    /// Cancelled when a commit fails; nothing is acknowledged afterwards.
    pub fn failed(&self) -> CancellationToken {
        self.app.store.writer().failed().clone()
    }

    pub async fn open(database: impl Into<Location>, parts: Parts) -> Result<Self, StartError> {
        telemetry::metrics();
        let database = database.into();
        let Parts { clock, entropy, disk, limits, access, pages, joining } = parts;
        let store = match &joining {
            Some(joining) => Store::join(&database, joining).await?,
            None => Store::open(&database).await?,
        };
        let last_key = store.last_key().await?;
        let has_keys = store.has_keys().await?;
        if let Some(newest) = store.newest_at().await?.filter(|newest| *newest > clock.host()) {
            clock.not_before(newest);
        }
        let quotas = Quotas::new(limits.caps());
        for (owner, bytes) in store.bytes_by_owner().await? {
            quotas.note_bytes(owner, bytes);
        }
        for (competition, bytes) in store.bytes_by_competition().await? {
            quotas.note_competition(competition, bytes);
        }
        if store.cluster().is_none() {
            for (episode, owner, competition) in store.accounts().await? {
                quotas.note(episode, Party::within(competition, owner));
            }
        }
        let slot = store.cluster().map(|cluster| cluster.slot());
        let numbers = |last| match slot {
            Some(slot) => Numbers::of_slot(slot, last),
            None => Numbers::after(last),
        };
        let journal: Arc<dyn EpisodeStore> = Arc::new(store.clone());
        let workers = Workers::of_this_host();
        // Episodes run on these threads even when a request of low priority recovers them.
        let runtime = Handle::current();
        let spawn: Spawn = Arc::new(move |task| drop(runtime.spawn(task)));
        let registry = Registry::new(
            journal,
            Arc::clone(&clock),
            Arc::new(quotas),
            workers.clone(),
            spawn,
            last_key,
        )
        .with_numbers(numbers(last_key))
        .with_budget(Budget::memory(limits.memory_bytes_max));
        let forwarder = joining.as_ref().zip(store.cluster()).map(|(joining, cluster)| {
            let name = joining.routing_name;
            Arc::new(Forwarder::new(store.clone(), Arc::clone(cluster), &joining.secret, name))
        });
        let disk = disk.unwrap_or_else(|| match database.file() {
            Some(file) => Arc::new(HostDisk::of(file)),
            None => Arc::new(OtherHostsDisk),
        });
        let stop = CancellationToken::new();
        let runs = Runs::new(manager::Parts {
            store: store.clone(),
            registry: registry.clone(),
            clock: Arc::clone(&clock),
            entropy: Arc::clone(&entropy),
            disk: Arc::clone(&disk),
            disk_free_percent_min: limits.disk_free_percent_min,
            stop: stop.clone(),
            numbers: numbers(store.last_run_key().await?),
            peers: forwarder
                .clone()
                .map(|forwarder| Arc::new(ForwardingPeers(forwarder)) as Arc<dyn Peers>),
        });
        let app = App::new(Foundation {
            store,
            registry,
            runs,
            clock,
            entropy,
            disk,
            workers,
            limits,
            access,
            pages,
            has_keys,
            stop,
            forwarder,
        });
        Ok(Self { app, joining })
    }

    /// Whether a key was ever created on this server.
    pub fn has_keys(&self) -> bool {
        self.app.has_keys
    }

    /// Closes the database without serving.
    pub async fn close(self) {
        self.app.store.clone().close().await;
    }

    /// Serves until `shutdown` completes. Then long polls return, open requests are answered, and queued entries are committed.
    pub async fn run(
        self,
        listener: TcpListener,
        shutdown: impl Future<Output = ()> + Send,
    ) -> Result<(), StartError> {
        self.run_with(listener, None, shutdown).await
    }

    /// Variant of [`Server::run`] for a server of a cluster, which the others reach by a listener of their own.
    pub async fn run_with(
        self,
        listener: TcpListener,
        for_servers: Option<TcpListener>,
        shutdown: impl Future<Output = ()> + Send,
    ) -> Result<(), StartError> {
        let Self { app, joining } = self;
        let stop = app.stop.clone();
        // A server that is dropped while it serves leaves no tasks on threads of its own.
        let _stops = stop.clone().drop_guard();
        if let Some(hosted) = app.registry.take_hosted() {
            let playing = hosted::run(hosted, Arc::clone(app.registry.host()), stop.clone());
            app.workers.spawn_in_background(Box::pin(playing)).unwrap_or_else(|playing| {
                drop(tokio::spawn(playing));
            });
        }
        // Boxed, so that the runtime's code for tasks is compiled once for all of them.
        let mut services = JoinSet::new();
        services.spawn(watch_clock(Arc::clone(&app.clock)).boxed());
        if app.store.cluster().is_none() {
            services.spawn(recover_with_retries(app.clone()).boxed());
        }
        services.spawn(advance_runs(app.clone()).boxed());
        services.spawn(close_competitions(app.clone()).boxed());
        services.spawn(measure_games(app.clone()).boxed());
        services.spawn(sweep(app.clone()).boxed());
        let trusted_proxies = app.access.trusted_proxies.clone();
        let front = Front::new(app.clone());
        // Another server forwards the requests of all its clients from one address.
        let in_cluster = Limits { connections_per_address_max: usize::MAX, ..app.limits };
        let serving_cluster = for_servers.map(|listener| {
            let front = front.for_servers();
            tokio::spawn(serve(listener, front, in_cluster, Vec::new(), stop.clone()).boxed())
        });
        let (excluded, mut outcome) = (app.store.writer().excluded().clone(), Ok(()));
        let mut clock_is_off = CancellationToken::new();
        let mut shutdown = pin!(shutdown);
        if let Some((joining, cluster)) = joining.as_ref().zip(app.store.cluster()) {
            let is_reachable = Arc::new(AtomicBool::new(false));
            let parts = parts(&app, cluster, &is_reachable, joining.forwards_only);
            clock_is_off = parts.clock_is_off.clone();
            services.spawn(membership::run(Arc::new(Membership::new(parts))).boxed());
            tokio::select! {
                checked = check_reachable(&app, &joining.address) => match checked {
                    Ok(()) => is_reachable.store(true, Ordering::Release),
                    Err(problem) => outcome = Err(StartError::Unreachable(problem)),
                },
                () = &mut shutdown => {}
            }
        }
        let serving = serve(listener, front, app.limits, trusted_proxies, stop.clone());
        let serving = tokio::spawn(serving.boxed());
        if outcome.is_ok() {
            tokio::select! {
                () = shutdown => {}
                () = excluded.cancelled(), if joining.is_some() => {
                    let fault = app.store.writer().fault().map(str::to_owned);
                    outcome = Err(fault.map_or(StartError::Excluded, StartError::Fault));
                }
                () = clock_is_off.cancelled() => outcome = Err(StartError::ClockOff),
            }
        }
        tracing::info!("stopping");
        stop.cancel();
        // The panic was already logged.
        drop(serving.await);
        if let Some(serving) = serving_cluster {
            drop(serving.await);
        }
        // The services read the database, so it is closed after they have stopped.
        services.shutdown().await;
        app.store.clone().close().await;
        outcome
    }
}

/// Parts of a server in a cluster.
fn parts(
    app: &App,
    cluster: &Arc<Cluster>,
    is_reachable: &Arc<AtomicBool>,
    forwards_only: bool,
) -> membership::Parts {
    let (ready, revoked) = (app.clone(), app.clone());
    membership::Parts {
        store: app.store.clone(),
        cluster: Arc::clone(cluster),
        registry: app.registry.clone(),
        runs: app.runs.clone(),
        is_reachable: Arc::clone(is_reachable),
        forwards_only,
        stop: app.stop.clone(),
        clock_is_off: CancellationToken::new(),
        ready: Arc::new(move || {
            if !ready.ready.swap(true, Ordering::AcqRel) {
                let app = ready.clone();
                drop(tokio::spawn(async move { app.read_boards().await }));
            }
        }),
        revoked: Arc::new(move || revoked.forget_tokens()),
    }
}

/// Sends this server's first heartbeat, before it answers any request, and checks that the other servers reach it.
async fn check_reachable(app: &App, address: &str) -> Result<(), String> {
    let (Some(forwarder), Some(cluster)) = (&app.forwarder, app.store.cluster()) else {
        return Ok(());
    };
    let first = Beat { is_ready: false, episodes: 0 };
    while let Err(StoreError::Away) = cluster.beat(first, membership::host_ms).await {
        tokio::time::sleep(RECOVERY_RETRY_PAUSE).await;
    }
    forwarder.check_reachable(address).await
}

/// Reads the clock often enough to detect that the process was stopped. Logs each stop, and each doubt about the time of day once.
async fn watch_clock(clock: Arc<dyn Clock>) {
    // Opening the database may have taken long without a reading of the clock, which must not count as a stop.
    clock.now();
    let mut lost = clock.lost();
    let mut was_in_doubt = false;
    loop {
        let doubt = clock.doubt();
        metrics::gauge!("swarmbench_clock_in_doubt").set(f64::from(u8::from(doubt.is_some())));
        match doubt {
            Some(doubt) if !was_in_doubt => tracing::error!("{doubt}"),
            None if was_in_doubt => tracing::info!(now = %clock.wall(), "the clock is right again"),
            Some(_) | None => {}
        }
        was_in_doubt = doubt.is_some();
        let stopped = clock.lost().saturating_sub(lost);
        if !stopped.is_zero() {
            lost += stopped;
            metrics::counter!("swarmbench_stopped_ms_total").increment(millis(stopped));
            let stopped_ms = millis(stopped);
            tracing::info!(stopped_ms, "the process was stopped: no player's clock ran meanwhile");
        }
        clock.sleep_until(after(clock.now(), BEAT)).await;
    }
}

async fn recover_with_retries(app: App) {
    while let Err(error) = recover_all(&app).await {
        tracing::error!(%error, "unfinished episodes and runs cannot be recovered; trying again");
        app.clock.sleep_until(after(app.clock.now(), RECOVERY_RETRY_PAUSE)).await;
    }
    app.ready.store(true, Ordering::Release);
    app.read_boards().await;
}

async fn recover_all(app: &App) -> Result<(), RunError> {
    let episodes = app.registry.recover_unfinished().await?;
    let runs = app.runs.advance_all().await?;
    if episodes + runs > 0 {
        tracing::info!(episodes, runs, "unfinished episodes and runs were recovered");
    }
    Ok(())
}

/// Advances a run after one of its games has ended.
async fn advance_runs(app: App) {
    if let Some(ended) = app.registry.take_ended() {
        app.runs.advance_ended(ended).await;
    }
}

async fn close_competitions(app: App) {
    closing::run(&app.store, &app.runs, &*app.clock).await;
}

async fn measure_games(app: App) {
    measure::run(&app.store, app.registry.host(), &*app.clock).await;
}

/// Advances episodes that are not in memory and runs that wait for a permit, and evicts idle episodes.
async fn sweep(app: App) {
    loop {
        app.registry.sweep_idle().await;
        if let Err(error) = app.runs.advance_all().await {
            tracing::error!(%error, "runs cannot be advanced");
        }
        app.tidy();
        // The callee logs its error, and the writer meets the same one at its next commit.
        drop(app.store.check_files());
        app.clock.sleep_until(after(app.clock.now(), SWEEP)).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_no_more_connections_than_open_files() {
        let limits = Limits::default();
        let most = |files| within_files(&limits, files).connections_max;
        assert_eq!(most(None), limits.connections_max);
        assert_eq!(most(Some(1_048_576)), limits.connections_max);
        assert_eq!(most(Some(4096)), 3840);
        assert_eq!(most(Some(64)), 1);
        let closing = crate::http::serve::REFUSALS_MAX + crate::http::serve::EVICTIONS_MAX;
        assert!(closing as u64 <= FILES_RESERVED * 5 / 8);
    }
}
