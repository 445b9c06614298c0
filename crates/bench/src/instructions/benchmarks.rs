//! The benchmarks. One process runs everything in the same order with the same inputs. All requests use local
//! connections to a server on the same thread, so a count includes the client's part, which is small.

use std::fmt::Write as _;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;

use crate::load::connection::{Connection, Target, request};
use futures::future::join_all;
use jiff::Timestamp;
use swarmbench::ids::EpisodeKey;
use swarmbench::store::Store;
use swarmbench::store::entries::{ActRow, Entry};
use swarmbench::store::port::committed;
use swarmbench::work::Workers;
use swarmbench_clock::Clock;
use swarmbench_engine::{Act, Action, AgentId, Message, Settings, TaskName};
use swarmbench_journal::record::{Decision, RawRecord, Source};
use swarmbench_protocol::episode::CreatedEpisode;
use swarmbench_testkit::host::ManualClock;
use tokio_util::sync::CancellationToken;

use crate::server::{self, made::Made};
use swarmbench_testkit::worlds::{Dice, world};

/// Seats of an episode in the standard setting.
const SEATS: usize = 12;

/// Rounds played before the count, which fill caches and give buffers their size.
const WARM_UP: u32 = 3;

/// Rounds that are counted.
const ROUNDS: u32 = 10;

/// Rounds of a game without a server, as in the standard setting.
const GAME: u32 = 100;

/// Entries of a commit, and number of counted commits.
const ENTRIES: u32 = 100;
const COMMITS: u32 = 5;

/// Runs on the boards, and number of counted boards.
const RUNS: i64 = 40;
const BOARDS: u32 = 5;

const MESSAGE: &str = "switch all lights on together in the next round";

/// Counts everything.
pub(crate) fn all() {
    println!("{}", machine());
    games();
    let folder = tempfile::tempdir().expect("a folder");
    // One thread, so that tasks always take turns in the same order.
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    runtime.expect("a runtime").block_on(async {
        commits(&folder.path().join("commits.db")).await;
        acts(&folder.path().join("acts.db")).await;
        boards(&folder.path().join("boards.db")).await;
    });
}

/// The kind of processor, which decides what code runs: memory is copied and searched with the widest registers
/// available.
fn machine() -> String {
    #[cfg(target_arch = "x86_64")]
    let wide = if std::arch::is_x86_feature_detected!("avx2") { " with AVX2" } else { "" };
    #[cfg(not(target_arch = "x86_64"))]
    let wide = "";
    format!("{}-{}{wide}", std::env::consts::ARCH, std::env::consts::OS)
}

/// Rounds and observations, without a server: the games of `cargo bench -p swarmbench-engine --bench rounds`.
fn games() {
    for task in TaskName::ALL {
        let start = world(&Settings::standard(task, 27));
        let mut dice = Dice(27);
        let rounds: Vec<_> = (0..GAME).map(|_| dice.acts(&start)).collect();
        let mut played = start.clone();
        counting!(format!("round-{}", task.name().to_lowercase()), GAME, {
            for acts in &rounds {
                played.step(acts);
                black_box(played.digest());
            }
        });
        if task == TaskName::Transport {
            counting!("observation", SEATS, {
                for agent in played.agents() {
                    black_box(played.observe(agent));
                }
            });
        }
    }
}

/// Commits of acts, each act as a job of its own, which is how the server submits them.
async fn commits(database: &Path) {
    let clock = clock();
    let store = Store::open(database).await.expect("it opens");
    let mut made = Made::new(Arc::clone(&clock) as _);
    store.keep(made.run()).await.expect("it is kept");
    let decision = Decision::of_player(Act {
        action: Some(Action::Switch),
        message: Message::new(MESSAGE),
        to: None,
    });
    let mut next = 0;
    for commit in 0..WARM_UP + COMMITS {
        let jobs: Vec<Vec<Entry>> = (0..ENTRIES)
            .map(|_| {
                let agent = AgentId(u16::try_from(next % SEATS).expect("a small number"));
                let row = ActRow {
                    episode: EpisodeKey(1),
                    round: u32::try_from(next / SEATS).expect("a small number"),
                    agent,
                    waiting_for: 0,
                    source: Source::Player,
                    at: clock.now(),
                    record: RawRecord::write(&decision.record(agent, 0)),
                    brief: None,
                };
                next += 1;
                vec![Entry::Act(row)]
            })
            .collect();
        let keep = async {
            // The acts of a game all go into one commit.
            let append = |job| committed(|committed| store.append(job, committed));
            let kept = join_all(jobs.into_iter().map(append)).await;
            assert!(kept.iter().all(Result::is_ok), "{kept:?}");
        };
        if commit < WARM_UP { keep.await } else { counting!("commit", 1, keep.await) }
    }
    store.close().await;
}

fn clock() -> Arc<ManualClock> {
    let start: Timestamp = "2026-03-01T12:00:00Z".parse().expect("a time");
    Arc::new(ManualClock::new(start))
}

/// Observations and acts, for each seat and for a whole swarm.
async fn acts(database: &Path) {
    let store = Store::open(database).await.expect("it opens");
    let (target, stop) = serve(&store, clock()).await;
    looks_and_acts(&target).await;
    swarm_acts(&target).await;
    stop.cancel();
    store.close().await;
}

async fn serve(store: &Store, clock: Arc<ManualClock>) -> (Target, CancellationToken) {
    let (address, stop) = server::start(store.clone(), clock, Workers::inline()).await;
    let target = Target::new(&format!("http://{address}"), None).await.expect("an address");
    (target, stop)
}

/// A game of Synchronization, in which every seat acts in every round.
async fn create(target: &Target) -> CreatedEpisode {
    let json = r#"{"task":"Synchronization","seed":27,"model":"instructions"}"#;
    let create = request(target, "POST", "/api/v1/episodes", None, Some(json));
    let mut connection = Connection::new(target);
    ask(&mut connection, &create).await;
    serde_json::from_slice(connection.body()).expect("an episode")
}

async fn ask(connection: &mut Connection, request: &[u8]) {
    let answer = connection.ask(request).await.expect("an answer");
    assert!(answer.is_ok(), "{}", String::from_utf8_lossy(connection.body()));
}

/// Sends requests on all connections at the same time.
async fn ask_all(connections: &mut [Connection], requests: &[Vec<u8>]) {
    join_all(
        connections.iter_mut().zip(requests).map(|(connection, request)| ask(connection, request)),
    )
    .await;
}

/// A connection for each seat: all observe a round, observe it again, and act.
async fn looks_and_acts(target: &Target) {
    let game = create(target).await;
    let mut connections: Vec<_> = game.seats.iter().map(|_| Connection::new(target)).collect();
    let of_all = |make: &dyn Fn(&str) -> Vec<u8>| -> Vec<Vec<u8>> {
        game.seats.iter().map(|seat| make(&seat.token)).collect()
    };
    let looks = of_all(&|token| request(target, "GET", "/obs", Some(token), None));
    for round in 0..WARM_UP + ROUNDS {
        let json = format!(r#"{{"round":{round},"action":"SWITCH","message":"{MESSAGE}"}}"#);
        let acts = of_all(&|token| request(target, "POST", "/act", Some(token), Some(&json)));
        if round < WARM_UP {
            ask_all(&mut connections, &looks).await;
            ask_all(&mut connections, &acts).await;
            continue;
        }
        counting!("first-look", SEATS, ask_all(&mut connections, &looks).await);
        counting!("look", SEATS, ask_all(&mut connections, &looks).await);
        if round % 2 == 0 {
            counting!("act", SEATS, ask_all(&mut connections, &acts).await);
        } else {
            counting!("act-alone", SEATS, {
                for (connection, act) in connections.iter_mut().zip(&acts) {
                    ask(connection, act).await;
                }
            });
        }
    }
}

/// One connection for all seats.
async fn swarm_acts(target: &Target) {
    let game = create(target).await;
    let mut connection = Connection::new(target);
    for round in 0..WARM_UP + ROUNDS {
        let mut json = r#"{"acts":["#.to_owned();
        for seat in &game.seats {
            let comma = if json.ends_with('[') { "" } else { "," };
            write!(
                json,
                r#"{comma}{{"episode":"{}","agent":"{}","round":{round},"action":"SWITCH","message":"{MESSAGE}"}}"#,
                game.id, seat.agent
            )
            .expect("a string takes all text");
        }
        json.push_str("]}");
        let acts = request(target, "POST", "/swarm/act", Some(&game.swarm_token), Some(&json));
        if round < WARM_UP {
            ask(&mut connection, &acts).await;
        } else {
            counting!("swarm-act", 1, ask(&mut connection, &acts).await);
        }
    }
}

/// The leaderboard, first after a run has ended, and then again.
async fn boards(database: &Path) {
    let clock = clock();
    let store = Store::open(database).await.expect("it opens");
    let mut made = Made::new(Arc::clone(&clock) as _);
    while made.runs < RUNS {
        store.keep(made.run()).await.expect("it is kept");
    }
    let (target, stop) = serve(&store, clock).await;
    let mut connection = Connection::new(&target);
    let read = request(&target, "GET", "/api/v1/leaderboard", None, None);
    ask(&mut connection, &read).await;
    for _ in 0..BOARDS {
        store.keep(made.run()).await.expect("it is kept");
        counting!("first-board", 1, ask(&mut connection, &read).await);
        // The work that the first board leaves behind is not counted.
        ask(&mut connection, &read).await;
        counting!("board", BOARDS, {
            for _ in 0..BOARDS {
                ask(&mut connection, &read).await;
            }
        });
    }
    stop.cancel();
    store.close().await;
}
