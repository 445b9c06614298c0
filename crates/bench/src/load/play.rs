//! Many concurrent games, played to their ends.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

use serde::Serialize;
use swarmbench_testkit::latencies::Spread;
use tokio::task::JoinSet;

use super::connection::{Answers, Target};
use super::games::{self, SEATS};
use super::rounds::{Player, Score};
use super::{LoadError, Progress, per_second};

/// The approximate number of acts of one line of the grid, if the number of rounds is not set.
const ACTS_AIM: usize = 150_000;

/// Episodes with one seat that waits for the next round, if there is no connection for every seat.
const WATCHED_MAX: usize = 512;

/// One line of the grid.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Line {
    /// Concurrent episodes of 12 seats.
    pub(crate) episodes: usize,
    /// The requests: `/act` with a connection for each seat, or `/swarm/act` with one for each episode.
    pub(crate) by: &'static str,
    /// Rounds of each episode.
    pub(crate) rounds: u32,
    /// Episodes that reached their end.
    pub(crate) ended: usize,
    /// Open connections.
    pub(crate) connections: usize,
    /// Time from the first act to the last answer, in seconds.
    pub(crate) seconds: f64,
    /// Outcomes of all requests.
    pub(crate) answers: Answers,
    /// Durable acts a second.
    pub(crate) acts_per_s: f64,
    /// Resolved rounds a second, of all episodes together.
    pub(crate) rounds_per_s: f64,
    /// Time from sending an act until its receipt; for `/swarm/act`, from sending a round's acts until the receipts.
    pub(crate) acknowledged: Spread,
    /// Time from the receipt of a round's last act until a waiting client has the next observation.
    pub(crate) woken: Spread,
}

/// The default number of rounds of a line.
pub(crate) fn rounds(episodes: usize) -> u32 {
    let rounds = ACTS_AIM / (episodes * SEATS).max(1);
    u32::try_from(rounds.clamp(4, 100)).unwrap_or(100)
}

/// Plays `count` concurrent episodes for `rounds` rounds each, with at most `connections_max` connections. If there
/// are more episodes than connections, some share one, which plays a round of each in turn.
pub(crate) async fn run(
    target: &Target,
    count: usize,
    rounds: u32,
    connections_max: usize,
    progress: &Progress,
) -> Result<Line, LoadError> {
    let score = Arc::new(Score::default());
    let games = games::create(target, &score.tally, count, SEATS, rounds, progress).await;
    let by_seats = games.len() * SEATS <= connections_max;
    let shared = games.len().div_ceil(connections_max.max(1)).max(1);
    let acting = games.len().div_ceil(shared);
    let watched = connections_max.saturating_sub(acting).min(WATCHED_MAX).min(acting);
    let connections = if by_seats { games.len() * SEATS } else { acting + watched };
    let mut open = games::connect(target, connections, progress).await?.into_iter();
    let mut tasks = JoinSet::new();
    let all = games.len() as u64 * u64::from(rounds);
    let started = Instant::now();
    for (place, games) in games.chunks(shared).enumerate() {
        let mut player = match games {
            [game] if by_seats => Player::by_seats(target, game, open.by_ref()),
            _ => {
                let connection = open.next().expect("there is one for every chunk");
                let watcher = if place < watched { open.next() } else { None };
                Player::by_swarm(target, games, connection, watcher)
            }
        };
        let (score, progress, played) = (Arc::clone(&score), Arc::clone(progress), games.len());
        tasks.spawn(async move {
            for round in 0..rounds {
                if !player.round(&score, round, true).await {
                    return 0;
                }
                progress("playing rounds", score.rounds.load(Ordering::Relaxed), all);
            }
            played
        });
    }
    let ended = tasks.join_all().await.into_iter().sum();
    let elapsed = started.elapsed();
    Ok(Line {
        episodes: count,
        by: if by_seats { "/act" } else { "/swarm/act" },
        rounds,
        ended,
        connections,
        seconds: elapsed.as_secs_f64(),
        answers: score.tally.answers(),
        acts_per_s: per_second(score.acts.load(Ordering::Relaxed), elapsed),
        rounds_per_s: per_second(score.rounds.load(Ordering::Relaxed), elapsed),
        acknowledged: score.acknowledged.spread(),
        woken: score.woken.spread(),
    })
}
