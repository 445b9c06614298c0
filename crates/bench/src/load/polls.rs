//! Many waiting requests: their cost for the server, and the delay until they are woken.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use futures::StreamExt;
use serde::Serialize;
use swarmbench_testkit::latencies::{Latencies, Spread};
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

use super::connection::{Answers, Connection, Tally, Target};
use super::games;
use super::metrics::Metrics;
use super::rounds::{Acting, SeatConnection};
use super::{LoadError, Progress};

/// Rounds of an episode: more than are played, so that none ends.
const ROUNDS_MAX: u32 = 100;

/// Timeout until all requests wait, or have been woken.
const PATIENCE: Duration = Duration::from_mins(1);

/// Connections that act when all episodes are resolved at once.
const ACTING: usize = 64;

/// The results of the scenario.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct PollsReport {
    /// Concurrent waiting requests, each on its own connection.
    pub(crate) polls: usize,
    /// Waiting requests as the server counted them, if it reports them.
    pub(crate) counted: Option<f64>,
    /// Episodes that they waited for.
    pub(crate) episodes: usize,
    /// Seats of an episode, each with one request.
    pub(crate) seats: usize,
    /// Memory of the server before the connections were opened, in bytes, if it reports it.
    pub(crate) memory_before_bytes: Option<f64>,
    /// Memory of the server while all requests waited, in bytes.
    pub(crate) memory_held_bytes: Option<f64>,
    /// Memory per request, its connection included, in bytes.
    pub(crate) bytes_per_poll: Option<f64>,
    /// Time from the receipts of a round until the waiting requests are answered, with one episode resolved after
    /// another.
    pub(crate) one_by_one: Spread,
    /// The same time with all episodes resolved at once.
    pub(crate) all_at_once: Spread,
    /// Outcomes of all requests.
    pub(crate) answers: Answers,
}

/// The episode of a woken request, and the time.
type Woken = (usize, Instant);

/// Opens `polls` requests on episodes with `seats` seats, and resolves two rounds of each.
pub(crate) async fn run(
    target: &Target,
    polls: usize,
    seats: usize,
    progress: &Progress,
) -> Result<PollsReport, LoadError> {
    let tally = Arc::new(Tally::default());
    let count = (polls / seats).max(1);
    let games = games::create(target, &tally, count, seats, ROUNDS_MAX, progress).await;
    let polls = games.len() * seats;
    let before = Metrics::of(target).await?;
    let mut open = games::connect(target, polls, progress).await?.into_iter();
    let (send, mut woken) = mpsc::unbounded_channel();
    let mut waiting = JoinSet::new();
    for (place, game) in games.iter().enumerate() {
        for (token, connection) in game.seats.iter().zip(open.by_ref()) {
            let seat = SeatConnection::new(target, connection, token.clone());
            waiting.spawn(poll(seat, place, Arc::clone(&tally), send.clone()));
        }
    }
    all_wait(target, polls, progress).await?;
    let held = Metrics::of(target).await?;
    let mut acting: Vec<_> =
        (games.iter()).map(|game| Acting::new(target, game, Connection::new(target))).collect();

    let one_by_one = Latencies::default();
    for (place, acting) in acting.iter_mut().enumerate() {
        progress("waking one episode after the other", place as u64, games.len() as u64);
        let Some((_, acknowledged)) = acting.act(&tally, 0).await else { continue };
        let acknowledged = HashMap::from([(place, acknowledged)]);
        collect(&mut woken, &acknowledged, seats, &tally, &one_by_one).await;
    }

    all_wait(target, polls, progress).await?;
    progress("waking all at once", 0, 1);
    let all_at_once = Latencies::default();
    let acts = acting.iter_mut().enumerate().map(|(place, acting)| {
        let tally = Arc::clone(&tally);
        async move { Some((place, acting.act(&tally, 1).await?.1)) }
    });
    let acknowledged: Vec<_> = futures::stream::iter(acts).buffer_unordered(ACTING).collect().await;
    let acknowledged = acknowledged.into_iter().flatten().collect();
    collect(&mut woken, &acknowledged, seats, &tally, &all_at_once).await;

    // Pollers that stayed would be answered with the abortion again and again.
    waiting.shutdown().await;
    drop(acting);
    games::abort(target, &tally, &games, progress).await;
    let memory = |metrics: &Metrics| metrics.get("process_resident_memory_bytes");
    let grown = memory(&before).zip(memory(&held)).map(|(before, held)| held - before);
    Ok(PollsReport {
        polls,
        counted: held.get("swarmbench_waits"),
        episodes: games.len(),
        seats,
        memory_before_bytes: memory(&before),
        memory_held_bytes: memory(&held),
        bytes_per_poll: grown.map(|grown| grown / super::float(polls.max(1) as u64)),
        one_by_one: one_by_one.spread(),
        all_at_once: all_at_once.spread(),
        answers: tally.answers(),
    })
}

/// Waits for one round after the other until a request fails.
async fn poll(
    mut seat: SeatConnection,
    episode: usize,
    tally: Arc<Tally>,
    woken: mpsc::UnboundedSender<Woken>,
) {
    for round in 0..ROUNDS_MAX {
        let Some((_, ended)) = seat.wait(&tally, round).await else { return };
        if woken.send((episode, ended)).is_err() {
            return;
        }
    }
}

/// Waits until the server counts `polls` waiting requests. Without metrics it waits for a second.
async fn all_wait(target: &Target, polls: usize, progress: &Progress) -> Result<(), LoadError> {
    let started = Instant::now();
    let wanted = super::float(polls as u64);
    loop {
        let Some(waits) = Metrics::of(target).await?.get("swarmbench_waits") else {
            sleep(Duration::from_secs(1)).await;
            return Ok(());
        };
        if waits >= wanted {
            return Ok(());
        }
        if started.elapsed() > PATIENCE {
            let why = format!("{waits} of {wanted} do after {} s", PATIENCE.as_secs());
            return Err(LoadError::of("not all requests wait")(&why));
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count")]
        progress("requests that wait", waits as u64, polls as u64);
        sleep(Duration::from_millis(100)).await;
    }
}

/// Receives the times of the woken requests of some episodes.
async fn collect(
    woken: &mut mpsc::UnboundedReceiver<Woken>,
    acknowledged: &HashMap<usize, Instant>,
    seats: usize,
    tally: &Tally,
    latencies: &Latencies,
) {
    let mut left = acknowledged.len() * seats;
    while left > 0 {
        let Ok(Some((episode, at))) = timeout(PATIENCE, woken.recv()).await else {
            tally.error(|| format!("{left} requests were not woken"));
            return;
        };
        if let Some(acknowledged) = acknowledged.get(&episode) {
            latencies.record([at.saturating_duration_since(*acknowledged)]);
            left -= 1;
        }
    }
}
