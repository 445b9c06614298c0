//! A server in the process of a benchmark.

pub(crate) mod made;

use std::net::SocketAddr;
use std::sync::Arc;

use swarmbench::episode::quota::Quotas;
use swarmbench::episode::registry::Registry;
use swarmbench::host::{Disk, OtherHostsDisk};
use swarmbench::http::limits::Limits;
use swarmbench::http::{Access, App, Foundation, Front, Source, serve::serve};
use swarmbench::ids::Numbers;
use swarmbench::run::manager::{self, Runs};
use swarmbench::store::Store;
use swarmbench::telemetry;
use swarmbench::work::Workers;
use swarmbench_clock::{Clock, Entropy};
use swarmbench_testkit::host::SeededEntropy;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

/// Serves the database as a server does, without what a server does by itself from time to time.
pub(crate) async fn start(
    store: Store,
    clock: Arc<dyn Clock>,
    workers: Workers,
) -> (SocketAddr, CancellationToken) {
    telemetry::metrics();
    let entropy: Arc<dyn Entropy> = Arc::new(SeededEntropy::new(1));
    let disk: Arc<dyn Disk> = Arc::new(OtherHostsDisk);
    let limits = Limits::default();
    let quotas = Arc::new(Quotas::new(limits.caps()));
    let journal = Arc::new(store.clone());
    let spawn = Arc::new(|task| drop(tokio::spawn(task)));
    let stop = CancellationToken::new();
    let registry = Registry::new(journal, Arc::clone(&clock), quotas, workers.clone(), spawn, 0);
    let runs = Runs::new(manager::Parts {
        store: store.clone(),
        registry: registry.clone(),
        clock: Arc::clone(&clock),
        entropy: Arc::clone(&entropy),
        disk: Arc::clone(&disk),
        disk_free_percent_min: limits.disk_free_percent_min,
        stop: stop.clone(),
        numbers: Numbers::after(0),
        peers: None,
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
        access: Access::default(),
        pages: Source::default(),
        has_keys: false,
        stop: stop.clone(),
        forwarder: None,
    });
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
    let address = listener.local_addr().expect("an address");
    tokio::spawn(serve(listener, Front::new(app), limits, Vec::new(), stop.clone()));
    (address, stop)
}
