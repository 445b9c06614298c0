//! Slow clients: the time that the server keeps them, and their effect on honest clients.

use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::Serialize;
use swarmbench_testkit::latencies::{Latencies, Spread};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpSocket, TcpStream};
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval, sleep, sleep_until};

use super::connection::{Answers, Target, request};
use super::games::{self, Game, SEATS};
use super::metrics::Metrics;
use super::rounds::{Player, Score};
use super::{LoadError, Progress};

/// The age by which the server should have closed a slow connection.
const CLOSED_WITHIN: Duration = Duration::from_secs(15);

/// Interval between the bytes of a slow client.
const PACE: Duration = Duration::from_secs(1);

/// Episodes of honest clients, with a connection for each seat.
pub(crate) const HONEST: usize = 8;
/// Interval between rounds of honest clients.
const HONEST_PACE: Duration = Duration::from_millis(100);

/// Rounds of an episode: more than are played.
const ROUNDS_MAX: u32 = 100_000;

/// The behaviour of a slow client.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
    /// Sends the head of a request byte by byte.
    Head,
    /// Sends the body of an act byte by byte.
    Body,
    /// Connects and sends nothing.
    Silent,
    /// Requests a long answer again and again, without reading it.
    Unread,
}

impl Kind {
    /// The kinds of eight clients, repeated for more.
    const SHARES: [Self; 8] = [
        Self::Head,
        Self::Body,
        Self::Head,
        Self::Silent,
        Self::Head,
        Self::Body,
        Self::Head,
        Self::Unread,
    ];
}

/// The lifetimes of connections of one kind of slow client.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct KindSummary {
    /// The kind.
    pub(crate) kind: Kind,
    /// Concurrent clients.
    pub(crate) clients: usize,
    /// Connections that the server closed; a client reconnects a second later.
    pub(crate) closed: usize,
    /// Connections that the server closed within 15 s.
    pub(crate) closed_within_15_s: usize,
    /// Connections older than 15 s that were open when the test ended.
    pub(crate) open_after_15_s: usize,
    /// The longest lifetime of a connection, in seconds.
    pub(crate) longest_s: f64,
}

/// The measurements of honest clients.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Honest {
    /// Time from sending an act until its receipt.
    pub(crate) acknowledged: Spread,
    /// Durations of `/obs`.
    pub(crate) looked: Spread,
}

/// The results of the scenario.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    /// Concurrent slow clients.
    pub(crate) clients: usize,
    /// Duration of each of the two phases, in seconds: honest clients alone, then beside slow ones.
    pub(crate) seconds: f64,
    /// The lifetimes of slow connections, by kind.
    pub(crate) kept: Vec<KindSummary>,
    /// Honest clients alone.
    pub(crate) before: Honest,
    /// Honest clients beside slow ones.
    pub(crate) during: Honest,
    /// Ratio of the 99th percentiles of `acknowledged`, beside slow clients to alone.
    pub(crate) acknowledged_factor: f64,
    /// Ratio of the 99th percentiles of `looked`, beside slow clients to alone.
    pub(crate) looked_factor: f64,
    /// Connections that the server counted at the end of the second phase, if it reports them.
    pub(crate) counted: Option<f64>,
    /// Outcomes of the honest clients' requests.
    pub(crate) answers: Answers,
}

/// Lets honest clients play alone for `time`, and then for `time` beside `clients` slow ones.
pub(crate) async fn run(
    target: &Target,
    clients: usize,
    time: Duration,
    progress: &Progress,
) -> Result<Report, LoadError> {
    let score = Score::default();
    let tally = Arc::clone(&score.tally);
    let games = games::create(target, &tally, HONEST, SEATS, ROUNDS_MAX, progress).await;
    let first = games::first(&games, &tally)?;
    let mut open = games::connect(target, games.len() * SEATS, progress).await?.into_iter();
    let mut players: Vec<_> =
        (games.iter()).map(|game| (Player::by_seats(target, game, open.by_ref()), 0)).collect();
    progress("honest clients alone", 0, 2);
    let (before, players_after) = honest(players, &tally, time).await;
    players = players_after;
    progress("slow clients beside them", 1, 2);
    let end = Instant::now() + time;
    let mut slow = JoinSet::new();
    for (place, kind) in Kind::SHARES.into_iter().cycle().take(clients).enumerate() {
        // Clients connect one after another, as connecting is not measured.
        let delay = time / 10 * u32::try_from(place).unwrap_or(0)
            / u32::try_from(clients).unwrap_or(u32::MAX);
        slow.spawn(slow_client(target.clone(), kind, opening(target, first, kind), delay, end));
    }
    let (during, players) = honest(players, &tally, time).await;
    let counted = Metrics::of(target).await?.get("swarmbench_connections");
    let logs = slow.join_all().await;
    drop(players);
    games::abort(target, &tally, &games, progress).await;
    let kinds = [Kind::Head, Kind::Body, Kind::Silent, Kind::Unread];
    let factor = |before: Spread, during: Spread| during.p99_ms / before.p99_ms.max(0.001);
    Ok(Report {
        clients,
        seconds: time.as_secs_f64(),
        kept: kinds.map(|kind| summary(kind, &logs)).into(),
        acknowledged_factor: factor(before.acknowledged, during.acknowledged),
        looked_factor: factor(before.looked, during.looked),
        before,
        during,
        counted,
        answers: tally.answers(),
    })
}

/// Lets every seat act and then observe, round by round at a fixed pace.
async fn honest(
    players: Vec<(Player, u32)>,
    tally: &Arc<super::connection::Tally>,
    time: Duration,
) -> (Honest, Vec<(Player, u32)>) {
    let score = Arc::new(Score { tally: Arc::clone(tally), ..Score::default() });
    let looked = Arc::new(Latencies::default());
    let end = Instant::now() + time;
    let mut tasks = JoinSet::new();
    for (mut player, mut round) in players {
        let (score, looked) = (Arc::clone(&score), Arc::clone(&looked));
        tasks.spawn(async move {
            let mut pace = interval(HONEST_PACE);
            pace.set_missed_tick_behavior(MissedTickBehavior::Delay);
            while Instant::now() < end {
                pace.tick().await;
                if !player.round(&score, round, false).await {
                    return None;
                }
                round += 1;
                player.look(&score.tally, &looked).await;
            }
            Some((player, round))
        });
    }
    let players = tasks.join_all().await.into_iter().flatten().collect();
    (Honest { acknowledged: score.acknowledged.spread(), looked: looked.spread() }, players)
}

/// The first bytes that a slow client sends.
fn opening(target: &Target, game: &Game, kind: Kind) -> Vec<u8> {
    let token = game.seats.first().map(String::as_str);
    match kind {
        Kind::Head => {
            let mut head = request(target, "GET", "/obs", token, None);
            // The begin of another header replaces the empty line that ends a head.
            head.truncate(head.len() - 2);
            head.extend_from_slice(b"x-slow: ");
            head
        }
        Kind::Body => {
            let mut act = request(target, "POST", "/act", token, Some(&" ".repeat(10_000)));
            act.truncate(act.len() - 10_000);
            act
        }
        Kind::Silent => Vec::new(),
        Kind::Unread => request(target, "GET", "/openapi.json", None, None),
    }
}

/// The lifetimes of a client's connections, and whether the server closed them.
type ClientLog = (Kind, Vec<(Duration, bool)>);

/// Reconnects whenever the server closes the connection, until `end`.
async fn slow_client(
    target: Target,
    kind: Kind,
    opening: Vec<u8>,
    delay: Duration,
    end: Instant,
) -> ClientLog {
    sleep(delay).await;
    let mut logs = Vec::new();
    while Instant::now() < end {
        let Ok(stream) = connect(&target, kind).await else {
            // Failed attempts to connect are not measured.
            sleep(PACE).await;
            continue;
        };
        let began = Instant::now();
        let closed = if kind == Kind::Unread {
            pile_up(stream, &opening, end).await
        } else {
            drip(stream, kind, &opening, end).await
        };
        logs.push((began.elapsed(), closed));
        sleep(PACE).await;
    }
    (kind, logs)
}

async fn connect(target: &Target, kind: Kind) -> io::Result<TcpStream> {
    let socket = if target.addr().is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    if kind == Kind::Unread {
        // A small buffer lets the server notice sooner that nothing is read.
        socket.set_recv_buffer_size(4096)?;
    }
    let stream = socket.connect(target.addr()).await?;
    stream.set_nodelay(true)?;
    Ok(stream)
}

/// Sends `opening`, then a byte per second; returns whether the server closed the connection.
async fn drip(mut stream: TcpStream, kind: Kind, opening: &[u8], end: Instant) -> bool {
    let sends = kind != Kind::Silent;
    if sends && stream.write_all(opening).await.is_err() {
        return true;
    }
    let mut pace = interval(PACE);
    pace.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut buffer = [0; 1024];
    loop {
        tokio::select! {
            // Answers are ignored; only the close counts.
            read = stream.read(&mut buffer) => if matches!(read, Ok(0) | Err(_)) {
                return true;
            },
            _ = pace.tick(), if sends => if is_closed(&stream.try_write(b" ")) {
                return true;
            },
            () = sleep_until(end.into()) => return false,
        }
    }
}

/// Sends requests without reading; returns whether the server closed the connection.
async fn pile_up(mut stream: TcpStream, asked: &[u8], end: Instant) -> bool {
    let mut pace = interval(PACE);
    pace.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            written = async { pace.tick().await; stream.write_all(asked).await } => if written.is_err() {
                return true;
            },
            () = sleep_until(end.into()) => return false,
        }
    }
}

/// Whether the connection is closed. A full buffer does not count.
fn is_closed(written: &io::Result<usize>) -> bool {
    written.as_ref().is_err_and(|error| error.kind() != io::ErrorKind::WouldBlock)
}

/// The summary of all clients of a kind.
fn summary(kind: Kind, logs: &[ClientLog]) -> KindSummary {
    let clients = logs.iter().filter(|(which, _)| *which == kind);
    let all: Vec<_> = clients.clone().flat_map(|(_, connections)| connections).collect();
    KindSummary {
        kind,
        clients: clients.count(),
        closed: all.iter().filter(|(_, closed)| *closed).count(),
        closed_within_15_s: all
            .iter()
            .filter(|(age, closed)| *closed && *age <= CLOSED_WITHIN)
            .count(),
        open_after_15_s: all.iter().filter(|(age, closed)| !closed && *age > CLOSED_WITHIN).count(),
        longest_s: all.iter().map(|(age, _)| age.as_secs_f64()).fold(0.0, f64::max),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_was_kept_too_long_is_counted() {
        let closed_after = |seconds, closed| (Duration::from_secs(seconds), closed);
        let all = [
            // Three connections: closed in time, closed in time, still young at the end.
            (
                Kind::Head,
                vec![closed_after(10, true), closed_after(11, true), closed_after(5, false)],
            ),
            (Kind::Head, vec![closed_after(16, true)]),
            (Kind::Head, vec![closed_after(26, false)]),
            (Kind::Body, vec![closed_after(1, true)]),
        ];
        let kept = summary(Kind::Head, &all);
        assert_eq!((kept.clients, kept.closed), (3, 3));
        assert_eq!((kept.closed_within_15_s, kept.open_after_15_s), (2, 1));
        assert!((kept.longest_s - 26.0).abs() < 1e-9);
    }
}
