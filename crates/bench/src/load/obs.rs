//! The speed of `/obs`, compared with a bare handler that sends the same bytes.

use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use serde::Serialize;
use swarmbench_testkit::latencies::{Latencies, Spread};
use tokio::task::JoinSet;

use super::bare_handler::BareHandler;
use super::connection::{Answers, Connection, Tally, Target, request};
use super::games::{self, SEATS};
use super::metrics::Metrics;
use super::rounds::{Player, Score};
use super::{LoadError, Progress, median, per_second};

/// Rounds played first: more than an agent of the standard setting remembers.
const ROUNDS: u32 = 6;

/// The results of the server and of the bare handler.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Comparison {
    /// Connections, each with one request after another.
    pub(crate) connections: usize,
    /// Bytes of the observation.
    pub(crate) bytes: usize,
    /// Turns of each program.
    pub(crate) turns: usize,
    /// Duration of a turn, in seconds.
    pub(crate) turn_s: f64,
    /// Results of the server.
    pub(crate) server: Side,
    /// Results of the bare handler.
    pub(crate) bare: Side,
    /// Ratio of the server to the bare handler, requests a second: the median over the turns.
    pub(crate) ratio: f64,
    /// Ratio of processor times for one request, the bare handler's to the server's, if both report it: the ratio of
    /// a client without cost.
    pub(crate) cpu_ratio: Option<f64>,
    /// Outcomes of all requests.
    pub(crate) answers: Answers,
}

/// The results of one program.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Side {
    /// Requests a second: the median over the turns.
    pub(crate) per_s: f64,
    /// The slowest turn.
    pub(crate) per_s_min: f64,
    /// The fastest turn.
    pub(crate) per_s_max: f64,
    /// Processor time of the process per request, in µs, if it reports it.
    pub(crate) cpu_us: Option<f64>,
    /// Durations of requests.
    pub(crate) latency: Spread,
}

/// Runs both programs in turns.
pub(crate) async fn run(
    target: &Target,
    command: Command,
    connections: usize,
    (turns, turn): (usize, Duration),
    progress: &Progress,
) -> Result<Comparison, LoadError> {
    let score = Score::default();
    let tally = Arc::clone(&score.tally);
    let count = connections.div_ceil(SEATS);
    let games = games::create(target, &tally, count, SEATS, ROUNDS + 1, progress).await;
    for game in &games {
        let mut player =
            Player::by_swarm(target, std::slice::from_ref(game), Connection::new(target), None);
        for round in 0..ROUNDS {
            player.round(&score, round, false).await;
        }
    }
    let tokens: Vec<&String> = games.iter().flat_map(|game| &game.seats).collect();
    let looks = (tokens.iter().cycle().take(if tokens.is_empty() { 0 } else { connections }))
        .map(|token| Arc::new(request(target, "GET", "/obs", Some(token), None)))
        .collect::<Vec<_>>();
    let failed = LoadError::of("no observation to compare with");
    let first = looks.first().ok_or_else(|| {
        failed(&tally.answers().samples.first().map_or("no episode", String::as_str))
    })?;
    let mut connection = Connection::new(target);
    connection.ask(first).await.map_err(|error| failed(&error))?;
    let (bare, bare_target) = BareHandler::start(command, connection.body()).await?;
    let bytes = connection.body().len();
    let bare_looks: Vec<_> = (0..connections)
        .map(|place| {
            let token = tokens[place % tokens.len()];
            Arc::new(request(&bare_target, "GET", "/obs", Some(token), None))
        })
        .collect();
    let mut server_side = Measured::new(target.clone(), looks);
    let mut bare_side = Measured::new(bare_target, bare_looks);
    for place in 0..turns {
        progress("comparing /obs", place as u64, turns as u64);
        server_side.turn(turn, &tally).await?;
        bare_side.turn(turn, &tally).await?;
    }
    drop(bare);
    games::abort(target, &tally, &games, progress).await;
    let ratios = server_side.rates.iter().zip(&bare_side.rates).map(|(server, bare)| server / bare);
    let ratio = median(ratios.collect());
    let (server, bare) = (server_side.side(), bare_side.side());
    let cpu = server.cpu_us.zip(bare.cpu_us).filter(|(server, bare)| *server > 0.0 && *bare > 0.0);
    let cpu_ratio = cpu.map(|(server, bare)| bare / server);
    Ok(Comparison {
        connections,
        bytes,
        turns,
        turn_s: turn.as_secs_f64(),
        server,
        bare,
        ratio,
        cpu_ratio,
        answers: tally.answers(),
    })
}

/// One program, and its measurements so far.
struct Measured {
    target: Target,
    /// Connections, each with its request.
    askers: Vec<(Connection, Arc<Vec<u8>>)>,
    latency: Arc<Latencies>,
    rates: Vec<f64>,
    requests: u64,
    cpu_s: Option<f64>,
}

impl Measured {
    fn new(target: Target, looks: Vec<Arc<Vec<u8>>>) -> Self {
        let askers = looks.into_iter().map(|look| (Connection::new(&target), look)).collect();
        let latency = Arc::default();
        Self { target, askers, latency, rates: Vec::new(), requests: 0, cpu_s: Some(0.0) }
    }

    /// Sends requests on all connections for `time`.
    async fn turn(&mut self, time: Duration, tally: &Arc<Tally>) -> Result<(), LoadError> {
        let before = Metrics::of(&self.target).await?;
        let count = Arc::new(AtomicU64::new(0));
        let mut tasks = JoinSet::new();
        let started = Instant::now();
        for (mut connection, look) in self.askers.drain(..) {
            let (tally, count) = (Arc::clone(tally), Arc::clone(&count));
            let latency = Arc::clone(&self.latency);
            tasks.spawn(async move {
                let mut durations = Vec::new();
                let mut sent = Instant::now();
                while started.elapsed() < time {
                    if !connection.call(&tally, &look).await {
                        break;
                    }
                    let answered = Instant::now();
                    durations.push(answered - sent);
                    sent = answered;
                }
                count.fetch_add(durations.len() as u64, Ordering::Relaxed);
                latency.record(durations);
                (connection, look)
            });
        }
        self.askers = tasks.join_all().await;
        let elapsed = started.elapsed();
        let after = Metrics::of(&self.target).await?;
        let count = count.load(Ordering::Relaxed);
        self.rates.push(per_second(count, elapsed));
        self.requests += count;
        let cpu_s = after.since(&before, "process_cpu_seconds_total");
        self.cpu_s = self.cpu_s.zip(cpu_s).map(|(all, this)| all + this);
        Ok(())
    }

    fn side(self) -> Side {
        Side {
            per_s: median(self.rates.clone()),
            per_s_min: self.rates.iter().copied().fold(f64::INFINITY, f64::min),
            per_s_max: self.rates.iter().copied().fold(0.0, f64::max),
            cpu_us: self.cpu_s.map(|all| all * 1e6 / super::float(self.requests.max(1))),
            latency: self.latency.spread(),
        }
    }
}
