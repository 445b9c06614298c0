//! PostgreSQL goes away, at any moment and for any time, and comes back: connections break with commits under way, so that
//! nobody knows whether these were done. It is a pause: nothing that was acknowledged is lost, nothing is written twice, and the
//! server does not end.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

use crate::audit::audit_after;
use crate::clients::{Clients, while_playing};
use crate::dice::{Dice, number, seed, tell};
use crate::postgres::{self, Scratch};
use crate::server::{PATIENCE, Site};

/// How often the database goes away, where `SWARMBENCH_CUTS` does not say otherwise.
const CUTS: u64 = 12;

/// How long it is away once. Acts that were sent before wait as long.
const LONG: Duration = Duration::from_secs(20);

/// What the server complains about while the database is away: that it is, connections that broke, and requests that had to
/// read it.
const REASONS: [&str; 4] =
    ["the database is not reached", "sqlx_core::pool", "a request failed", "answered status=503"];

/// How many games are played at once.
const TABLES: usize = 6;

/// How connections break.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cut {
    /// All at once, in both directions.
    Whole,
    /// What the database answers is lost, for a while before the connections break: commits are done, and nobody knows.
    Answers,
    /// What the server sends is lost for a while: commits are not done, and nobody knows.
    Questions,
}

/// Stands between the server and PostgreSQL.
struct Proxy {
    address: SocketAddr,
    state: Arc<State>,
}

struct State {
    /// Counts up when all connections break.
    generation: watch::Sender<u64>,
    refuses: AtomicBool,
    drops_answers: AtomicBool,
    drops_questions: AtomicBool,
    opened: AtomicU64,
}

impl Proxy {
    async fn before(database: String) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
        let address = listener.local_addr().expect("an address");
        let state = Arc::new(State {
            generation: watch::Sender::new(0),
            refuses: AtomicBool::new(false),
            drops_answers: AtomicBool::new(false),
            drops_questions: AtomicBool::new(false),
            opened: AtomicU64::new(0),
        });
        let shared = Arc::clone(&state);
        tokio::spawn(async move {
            loop {
                let (client, _) = listener.accept().await.expect("a connection");
                if shared.refuses.load(Ordering::SeqCst) {
                    continue;
                }
                shared.opened.fetch_add(1, Ordering::SeqCst);
                tokio::spawn(pass(client, database.clone(), Arc::clone(&shared)));
            }
        });
        Self { address, state }
    }

    /// Breaks all connections, and refuses further ones for this time.
    async fn cut(&self, cut: Cut, blind: Duration, away: Duration) {
        let state = &self.state;
        state.refuses.store(true, Ordering::SeqCst);
        state.drops_answers.store(cut == Cut::Answers, Ordering::SeqCst);
        state.drops_questions.store(cut == Cut::Questions, Ordering::SeqCst);
        if cut != Cut::Whole {
            tokio::time::sleep(blind).await;
        }
        state.generation.send_modify(|generation| *generation += 1);
        tokio::time::sleep(away).await;
        state.drops_answers.store(false, Ordering::SeqCst);
        state.drops_questions.store(false, Ordering::SeqCst);
        state.refuses.store(false, Ordering::SeqCst);
    }
}

/// Passes bytes both ways until the connections break.
async fn pass(mut client: TcpStream, database: String, state: Arc<State>) {
    let mut broken = state.generation.subscribe();
    let Ok(mut server) = TcpStream::connect(database).await else { return };
    let (mut asks, mut answers) = (vec![0; 64 * 1024], vec![0; 64 * 1024]);
    loop {
        tokio::select! {
            read = client.read(&mut asks) => {
                let Ok(read @ 1..) = read else { return };
                let is_lost = state.drops_questions.load(Ordering::SeqCst);
                if !is_lost && server.write_all(&asks[..read]).await.is_err() {
                    return;
                }
            }
            read = server.read(&mut answers) => {
                let Ok(read @ 1..) = read else { return };
                let is_lost = state.drops_answers.load(Ordering::SeqCst);
                if !is_lost && client.write_all(&answers[..read]).await.is_err() {
                    return;
                }
            }
            _ = broken.changed() => return,
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_database_that_goes_away_is_a_pause() {
    let Some(url) = postgres::server() else {
        println!(
            "NOT RUN: a_database_that_goes_away_is_a_pause needs {} (.ci/postgres)",
            postgres::VARIABLE
        );
        return;
    };
    let seed = seed("away");
    let cuts = number("SWARMBENCH_CUTS").unwrap_or(CUTS);
    let began = Instant::now();
    let proxy = Proxy::before(Scratch::address_of(&url)).await;
    let site = Site::new().through(proxy.address);
    let mut server = site.start();
    server.ready().await;
    let clients = Clients::new(seed, site.door.clone());
    clients.expect_pauses();
    let mut tables = clients.sit_down(TABLES);
    let mut longest = Duration::ZERO;
    let cutting = async {
        for number in 1..=cuts {
            let dice = Dice::of(seed, &format!("cut {number}"));
            clients.further(&clients.acknowledged, 1 + dice.below(30)).await;
            tokio::time::sleep(dice.time(Duration::from_millis(20))).await;
            let cut = *dice.pick(&[Cut::Whole, Cut::Answers, Cut::Questions]);
            let away = if number == cuts { LONG } else { dice.time(Duration::from_millis(1500)) };
            proxy.cut(cut, dice.time(Duration::from_millis(200)), away).await;
            let back = Instant::now();
            clients.further(&clients.acknowledged, 1).await;
            longest = longest.max(back.elapsed());
            assert!(longest < PATIENCE, "it does not continue");
        }
    };
    while_playing(&mut tables, cutting).await;
    clients.finish(tables).await;
    let log = server.log();
    assert!(!log.iter().any(|line| line.contains("a commit failed")), "{log:#?}");
    let lost = log.iter().filter(|line| line.contains("a commit whose answer was lost")).count();
    let totals = audit_after(&site, server, &clients, &REASONS).await;
    assert_eq!(totals.acts, clients.counts.acknowledged.load(Ordering::SeqCst));
    tell(&format!(
        "away: {cuts} cuts, {lost} commits were settled, {} acts acknowledged, {} journals verified, at most {} ms until the \
         next receipt after the database was back, {} connections, {:.0} s",
        totals.acts,
        totals.episodes,
        longest.as_millis(),
        proxy.state.opened.load(Ordering::SeqCst),
        began.elapsed().as_secs_f64(),
    ));
}
