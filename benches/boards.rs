//! How fast the leaderboard is read, over HTTP, with 100,000 finished episodes in a database file; alone, and while
//! runs end one after the other.
//!
//! `cargo bench --bench boards [EPISODES]`. The runs are made up, the openings and ends of their episodes are such as
//! the server writes; acts and rounds are left out, as boards do not read them.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::Map;
use swarmbench::episode::quota::Quotas;
use swarmbench::episode::registry::Registry;
use swarmbench::episode::spec::{Spec, Visibility};
use swarmbench::host::{Disk, ManualDisk};
use swarmbench::http::limits::Limits;
use swarmbench::http::{Access, App, Foundation, Source, router, serve::serve};
use swarmbench::ids::{EpisodeId, EpisodeKey, RunKey};
use swarmbench::run::definition::Definition;
use swarmbench::run::manager::{self, Runs};
use swarmbench::run::new_id;
use swarmbench::store::Store;
use swarmbench::store::entries::{EndRow, Entry, OpeningRow, RunRow};
use swarmbench::work::Workers;
use swarmbench_clock::{Clock, Entropy, SeededEntropy, SystemClock};
use swarmbench_engine::{Config, Settings, World};
use swarmbench_journal::Tally;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{End, RawRecord, Record};
use swarmbench_loadtest::latencies::Latencies;
use swarmbench_protocol::suite::Suite;
use tokio::net::TcpListener;
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

/// Players; each has several runs.
const PLAYERS: i64 = 1000;

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

#[tokio::main]
async fn main() {
    let episodes = std::env::args().skip(1).find_map(|arg| arg.parse().ok()).unwrap_or(100_000_i64);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("boards.db");
    let store = Store::open(&path).await.expect("it opens");
    let suite = Suite::built_in("standard", "paper").expect("it is built in");
    let games = i64::try_from(suite.plan().len()).expect("a count");
    let mut made = Made { suite, runs: 0, episodes: 0, random: ChaCha8Rng::seed_from_u64(1) };
    let started = Instant::now();
    while made.episodes < episodes {
        let entries = made.run();
        store.keep(entries).await.expect("it is kept");
    }
    let bytes = std::fs::metadata(&path).expect("a file").len();
    println!(
        "{} runs with {} episodes ({games} each) of {PLAYERS} players, {:.0} MB, made in {:.0} s",
        made.runs,
        made.episodes,
        float(bytes) / 1e6,
        started.elapsed().as_secs_f64()
    );
    let (address, stop) = start(store.clone()).await;
    let client = reqwest::Client::new();
    let first = Instant::now();
    ask(&client, address, "").await;
    println!(
        "the first read of all, which reads all results: {:.0} ms",
        first.elapsed().as_secs_f64() * 1e3
    );

    println!("| read | alone p50 | p99 | max | while runs end p50 | p99 | max |");
    println!("| --- | ---: | ---: | ---: | ---: | ---: | ---: |");
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
        let show = |spread: &swarmbench_loadtest::latencies::Spread| {
            format!("{:.1} ms | {:.1} ms | {:.1} ms", spread.p50_ms, spread.p99_ms, spread.max_ms)
        };
        println!("| {name} | {} | {} |", show(&alone.spread()), show(&busy.spread()));
    }
    println!(
        "{REQUESTS} requests a cell, {CLIENTS} at once; meanwhile {} episodes ended a second; in the end there were {}",
        rates.join(", "),
        made.episodes
    );
    stop.cancel();
}

/// A count as a number that can be divided.
#[expect(clippy::cast_precision_loss, reason = "no count here comes near 2⁵³")]
const fn float(count: u64) -> f64 {
    count as f64
}

/// Serves the database as a server does.
async fn start(store: Store) -> (SocketAddr, CancellationToken) {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let entropy: Arc<dyn Entropy> = Arc::new(SeededEntropy::new(1));
    let disk: Arc<dyn Disk> = Arc::new(ManualDisk::new(50));
    let limits = Limits::default();
    let quotas = Arc::new(Quotas::new(limits.caps()));
    let journal = Arc::new(store.clone());
    let spawn = Arc::new(|task| drop(tokio::spawn(task)));
    let stop = CancellationToken::new();
    let workers = Workers::of_this_host();
    let registry = Registry::new(journal, Arc::clone(&clock), quotas, workers.clone(), spawn, 0);
    let runs = Runs::new(manager::Parts {
        store: store.clone(),
        registry: registry.clone(),
        clock: Arc::clone(&clock),
        entropy: Arc::clone(&entropy),
        disk: Arc::clone(&disk),
        disk_free_percent_min: limits.disk_free_percent_min,
        stop: stop.clone(),
        last_key: 0,
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
    });
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
    let address = listener.local_addr().expect("an address");
    tokio::spawn(serve(listener, router(app), limits, Vec::new(), stop.clone()));
    (address, stop)
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

/// What was made so far.
struct Made {
    suite: Suite,
    runs: i64,
    episodes: i64,
    random: ChaCha8Rng,
}

impl Made {
    /// A run that has ended, with all its episodes.
    fn run(&mut self) -> Vec<Entry> {
        self.runs += 1;
        let now = SystemClock.now();
        let entropy = SeededEntropy::new(self.runs.unsigned_abs());
        let run = RunKey(self.runs);
        let model = format!("model-{}", self.runs % PLAYERS);
        let definition = Definition {
            suite: self.suite.clone(),
            model: model.clone(),
            temperature: Some(1.0),
            top_p: Some(1.0),
            meta: Map::new(),
            prompt_template: None,
            prompt_revision: swarmbench_prompt::REVISION,
            player: None,
            parallel: 4,
            visibility: "public".to_owned(),
            idle_timeout_ms: 86_400_000,
            closes_at: None,
        };
        let row = RunRow {
            run,
            id: new_id(now, &entropy),
            owner: None,
            suite: self.suite.name.clone(),
            digest: self.suite.digest(),
            definition: serde_json::to_string(&definition).expect("JSON"),
            model: model.clone(),
            visibility: "public",
            attempt: None,
            at: now,
            idempotency: None,
            token: None,
        };
        let id = row.id.clone();
        let mut entries = vec![Entry::OpenRun(Box::new(row))];
        for game in self.suite.plan() {
            entries.extend(self.game(run, &id, &game, &model));
        }
        entries.push(Entry::EndRun { run, status: "finished", at: now });
        entries
    }

    fn game(
        &mut self,
        run: RunKey,
        run_id: &str,
        game: &swarmbench_protocol::suite::Game,
        model: &str,
    ) -> [Entry; 2] {
        self.episodes += 1;
        let now = SystemClock.now();
        let seed = i64::from(game.seed);
        let settings = Settings { task: game.task.clone(), seed, ..Settings::default() };
        let config = Arc::new(Config::check(&settings).expect("the standard setting"));
        let world = World::new(Arc::clone(&config));
        let spec = Spec {
            config,
            round_deadline: None,
            bank: Duration::ZERO,
            manual_start: false,
            idle_timeout: Duration::from_hours(24),
            visibility: Visibility::Public,
            model: model.to_owned(),
            agent_meta: Map::new(),
            prompt_template: swarmbench_prompt::BUILT_IN.into(),
            prompt_revision: swarmbench_prompt::REVISION,
            custom_template: false,
            run: Some(run_id.to_owned()),
            salt: None,
            fork: None,
            closes_at: None,
            open_seats: Vec::new(),
            fill_after: None,
            fill_with: None,
            player: None,
        };
        let id = EpisodeId::new(now, &SeededEntropy::new(self.episodes.unsigned_abs()));
        let record = RawRecord::write(&spec.opening(&id, now, &world));
        let head = Head::START.link(record.as_str().as_bytes());
        let score = f64::from(self.random.next_u32() % 1000) / 50.0;
        let end = Record::End(End {
            status: "finished".to_owned(),
            reason: "rounds_played".to_owned(),
            rounds: 100,
            score,
            open_acts: Vec::new(),
        });
        let end = RawRecord::write(&end);
        let episode = EpisodeKey(self.episodes);
        let opening = OpeningRow {
            episode,
            id,
            owner: None,
            run: Some((run, game.slot)),
            fork: None,
            record,
            head,
            task: spec.config.task().name(),
            model: model.to_owned(),
            visibility: spec.visibility.name(),
            waiting: false,
            clocked: false,
            at: now,
            idempotency: None,
            tokens: Vec::new(),
        };
        let ending = EndRow {
            episode,
            status: "finished",
            reason: "rounds_played",
            head: head.link(end.as_str().as_bytes()),
            record: end,
            bytes: 0,
            score,
            rounds: 100,
            tally: Tally { acts: 1200, invalid: 12, ..Tally::default() },
            counts: true,
            at: now,
        };
        [Entry::Open(Box::new(opening)), Entry::End(ending)]
    }
}
