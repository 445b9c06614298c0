//! `swarmbench-bench boards`: the time of a read of the leaderboard over HTTP, alone and while runs end one after the
//! other. The runs are made up, the openings and ends of their episodes are such as the server writes; acts and rounds
//! are left out, as boards do not read them.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use swarmbench::store::Store;
use swarmbench::work::Workers;
use swarmbench_clock::SystemClock;
use swarmbench_testkit::latencies::{Latencies, Spread};
use tokio::task::JoinSet;

use crate::server::{
    self,
    made::{Made, PLAYERS},
};

/// Requests of each kind in each part of the measurement, and concurrent clients.
const REQUESTS: usize = 500;
const CLIENTS: usize = 4;

/// The measured requests.
const QUERIES: [(&str, &str); 6] = [
    ("the first page", ""),
    ("the first page, mean of all runs", "pick=mean"),
    ("by one task", "task=Pursuit&pick=last"),
    ("without the paper's rows", "reference=false&sort=Foraging"),
    ("1,000 rows", "limit=1000"),
    ("1,000 rows as CSV", "format=csv"),
];

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The number of finished episodes on the board.
    #[arg(long, default_value_t = 100_000, value_parser = clap::value_parser!(i64).range(1..=10_000_000))]
    episodes: i64,
}

pub(crate) async fn run(Args { episodes }: Args) -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("boards.db");
    let store = Store::open(&path).await?;
    let mut made = Made::new(Arc::new(SystemClock));
    let started = Instant::now();
    while made.episodes < episodes {
        let entries = made.run();
        store.keep(entries).await?;
    }
    let bytes = std::fs::metadata(&path)?.len();
    out!(
        "{} runs with {} episodes ({} each) of {PLAYERS} players, {:.0} MB, made in {:.0} s",
        made.runs,
        made.episodes,
        made.episodes / made.runs,
        float(bytes) / 1e6,
        started.elapsed().as_secs_f64()
    );
    let (address, stop) =
        server::start(store.clone(), Arc::new(SystemClock), Workers::of_this_host()).await;
    let client = reqwest::Client::new();
    let first = Instant::now();
    ask(&client, address, "").await;
    out!(
        "the first read of all, which reads all results: {:.0} ms",
        first.elapsed().as_secs_f64() * 1e3
    );

    out!("| read | alone p50 | p99 | max | while runs end p50 | p99 | max |");
    out!("| --- | ---: | ---: | ---: | ---: | ---: | ---: |");
    let mut rates = Vec::new();
    for (name, query) in QUERIES {
        let alone = measure(&client, address, query).await;
        let ending = Arc::new(AtomicBool::new(true));
        let ended = Arc::new(AtomicU64::new(0));
        let writer =
            tokio::spawn(end_runs(store.clone(), made, Arc::clone(&ending), Arc::clone(&ended)));
        let began = Instant::now();
        let busy = measure(&client, address, query).await;
        let rate = float(ended.load(Ordering::Relaxed)) / began.elapsed().as_secs_f64();
        rates.push(format!("{rate:.0}"));
        ending.store(false, Ordering::Relaxed);
        made = writer.await.expect("no panic");
        let show = |spread: &Spread| {
            format!("{:.1} ms | {:.1} ms | {:.1} ms", spread.p50_ms, spread.p99_ms, spread.max_ms)
        };
        out!("| {name} | {} | {} |", show(&alone.spread()), show(&busy.spread()));
    }
    out!(
        "{REQUESTS} requests a cell, {CLIENTS} at once; meanwhile {} episodes ended a second; in the end there were {}",
        rates.join(", "),
        made.episodes
    );
    stop.cancel();
    Ok(())
}

/// A count as a number that can be divided.
#[expect(clippy::cast_precision_loss, reason = "no count here comes near 2⁵³")]
const fn float(count: u64) -> f64 {
    count as f64
}

async fn ask(client: &reqwest::Client, address: SocketAddr, query: &str) {
    let answer = client.get(format!("http://{address}/api/v1/leaderboard?{query}")).send().await;
    let answer = answer.expect("an answer");
    assert_eq!(answer.status(), 200);
    assert!(answer.bytes().await.expect("a body").len() > 1000);
}

async fn measure(
    client: &reqwest::Client,
    address: SocketAddr,
    query: &'static str,
) -> Arc<Latencies> {
    let latencies = Arc::new(Latencies::default());
    let mut clients = JoinSet::new();
    for _ in 0..CLIENTS {
        let (client, latencies) = (client.clone(), Arc::clone(&latencies));
        clients.spawn(async move {
            for _ in 0..REQUESTS / CLIENTS {
                let started = Instant::now();
                ask(&client, address, query).await;
                latencies.record([started.elapsed()]);
            }
        });
    }
    clients.join_all().await;
    latencies
}

/// Lets runs end, one every 50 ms, as if 500 episodes ended every second.
async fn end_runs(
    store: Store,
    mut made: Made,
    goes_on: Arc<AtomicBool>,
    ended: Arc<AtomicU64>,
) -> Made {
    let mut ticks = tokio::time::interval(Duration::from_millis(50));
    while goes_on.load(Ordering::Relaxed) {
        ticks.tick().await;
        let before = made.episodes;
        store.keep(made.run()).await.expect("it is kept");
        ended.fetch_add((made.episodes - before).unsigned_abs(), Ordering::Relaxed);
    }
    made
}
