//! Durable acts per second, compared with a bare writer that commits groups of the same size, and with a bare server
//! that only receives, commits and answers.

use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use serde::Serialize;
use serde_json::value::RawValue;
use sqlx::migrate::Migrator;
use swarmbench_testkit::latencies::Spread;
use tokio::task::JoinSet;
use tokio::time::MissedTickBehavior;

use super::bare_acts::Setup;
use super::bare_commit::BareCommit;
use super::bare_handler::BareHandler;
use super::connection::{Answers, Target};
use super::games::{self, LoadGame, SEATS};
use super::metrics::Metrics;
use super::rounds::{Player, Score};
use super::{LoadError, Progress, median, per_second};

/// Rounds of an episode: more than any turn plays.
const ROUNDS_MAX: u32 = 100_000;

/// The results of the server and of the bare programs.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Comparison {
    /// The requests: `/act` with a connection for each seat, or `/swarm/act` with one for each episode.
    pub(crate) by: &'static str,
    /// Concurrent episodes of 12 seats.
    pub(crate) episodes: usize,
    /// Turns of each program.
    pub(crate) turns: usize,
    /// Duration of a turn.
    pub(crate) turn_s: f64,
    /// Durable acts a second of the server: the median over the turns.
    pub(crate) acts_per_s: f64,
    /// Durable acts a second of the bare writer: the median over the turns.
    pub(crate) bare_acts_per_s: f64,
    /// Ratio of the server to the bare writer, acts a second: the median over the turns.
    pub(crate) ratio: f64,
    /// Durable acts a second of a bare server, see [`bare_acts`](super::bare_acts): the median over the turns.
    pub(crate) bare_server_acts_per_s: f64,
    /// Ratio of the server to the bare server, acts a second: the median over the turns.
    pub(crate) bare_server_ratio: f64,
    /// Journal entries in one commit of the server, and thus of the bare writer: the median over the turns.
    pub(crate) entries_per_commit: f64,
    /// Commits a second of the server: the median over the turns.
    pub(crate) commits_per_s: f64,
    /// Commits a second of the bare writer: the median over the turns.
    pub(crate) bare_commits_per_s: f64,
    /// Processor time of the server per act, in µs, if the server reports it.
    pub(crate) cpu_us: Option<f64>,
    /// Bytes of an act's record.
    pub(crate) record_bytes: usize,
    /// Time from sending an act, or the acts of all seats, until the answer.
    pub(crate) acknowledged: Spread,
    /// The same time in a turn whose rounds begin evenly, at half the rate of the others.
    pub(crate) acknowledged_at_half: Spread,
    /// Outcomes of all requests.
    pub(crate) answers: Answers,
}

/// Runs the server, the bare writer and the bare server in turns; the bare programs use databases of their own
/// in `dir`. `bare_server` must call [`bare_acts::serve`](super::bare_acts::serve).
pub(crate) async fn run(
    target: &Target,
    (dir, tables, bare_server): (&Path, &Migrator, Command),
    by_seats: bool,
    episodes: usize,
    (turns, turn): (usize, Duration),
    progress: &Progress,
) -> Result<Comparison, LoadError> {
    let score = Arc::new(Score::default());
    let games = games::create(target, &score.tally, episodes, SEATS, ROUNDS_MAX, progress).await;
    let mut players = players_of(target, &games, by_seats, progress).await?;
    let first = games::first(&games, &score.tally)?;
    // A warm-up: every player plays a round before the measurement.
    players = play(players, &score, Duration::ZERO, None).await;
    let record = record(target, first).await?;
    let record_bytes = record.len();
    let setup = Setup { dir: dir.to_owned(), episodes: games.len(), record: record.clone() };
    let setup = serde_json::to_vec(&setup).expect("string keys");
    let mut bare = BareCommit::open(dir, tables, games.len(), record).await?;
    let (_bare_server, bare_target) = BareHandler::start(bare_server, &setup).await?;
    let bare_score = Arc::new(Score::default());
    let mut bare_players = players_of(&bare_target, &games, by_seats, progress).await?;
    let mut bare_server_rates = Vec::new();
    let (mut rates, mut bare_rates, mut groups) = (Vec::new(), Vec::new(), Vec::new());
    let (mut commits, mut bare_commits, mut cpu) = (Vec::new(), Vec::new(), Vec::new());
    for place in 0..turns {
        progress("comparing durable acts", place as u64, turns as u64);
        let before = Metrics::of(target).await?;
        let acts = score.acts.load(Ordering::Relaxed);
        let started = Instant::now();
        players = play(players, &score, turn, None).await;
        let elapsed = started.elapsed();
        let after = Metrics::of(target).await?;
        let acts = score.acts.load(Ordering::Relaxed) - acts;
        rates.push(per_second(acts, elapsed));
        let cpu_s = after.since(&before, "process_cpu_seconds_total");
        cpu.extend(cpu_s.map(|cpu_s| cpu_s * 1e6 / super::float(acts.max(1))));
        let entries = after.since(&before, "swarmbench_commit_entries_total");
        let count = after.since(&before, "swarmbench_commits_total");
        let (entries, count) =
            entries.zip(count).filter(|(_, count)| *count > 0.0).ok_or_else(|| {
                LoadError::of("the bare writer cannot be compared")(&"/metrics has no commits")
            })?;
        groups.push(entries / count);
        commits.push(count / elapsed.as_secs_f64());
        let done = bare.run(entries / count, turn).await?;
        bare_rates.push(per_second(done.acts, done.elapsed));
        bare_commits.push(per_second(done.commits, done.elapsed));
        let before = bare_score.acts.load(Ordering::Relaxed);
        let started = Instant::now();
        bare_players = play(bare_players, &bare_score, turn, None).await;
        let acts = bare_score.acts.load(Ordering::Relaxed) - before;
        bare_server_rates.push(per_second(acts, started.elapsed()));
    }
    bare.close().await?;
    let ratios = rates.iter().zip(&bare_rates).map(|(server, bare)| server / bare).collect();
    let bare_server_ratios =
        rates.iter().zip(&bare_server_rates).map(|(server, bare)| server / bare);
    let bare_server_ratio = median(bare_server_ratios.collect());
    let acts_per_s = median(rates);
    let acts_of_a_round = super::float((games.len().max(1) * SEATS) as u64);
    let interval = Duration::try_from_secs_f64(2.0 * acts_of_a_round / acts_per_s);
    let half = Arc::new(Score::default());
    drop(play(players, &half, turn, interval.ok()).await);
    games::abort(target, &score.tally, &games, progress).await;
    Ok(Comparison {
        by: if by_seats { "/act" } else { "/swarm/act" },
        episodes: games.len(),
        turns,
        turn_s: turn.as_secs_f64(),
        ratio: median(ratios),
        acts_per_s,
        bare_acts_per_s: median(bare_rates),
        bare_server_acts_per_s: median(bare_server_rates),
        bare_server_ratio,
        entries_per_commit: median(groups),
        commits_per_s: median(commits),
        bare_commits_per_s: median(bare_commits),
        cpu_us: (cpu.len() == turns).then(|| median(cpu)),
        record_bytes,
        acknowledged: score.acknowledged.spread(),
        acknowledged_at_half: half.acknowledged.spread(),
        answers: score.tally.answers(),
    })
}

/// Players of new episodes, each before its first round.
async fn players_of(
    target: &Target,
    games: &[LoadGame],
    by_seats: bool,
    progress: &Progress,
) -> Result<Vec<(Player, u32)>, LoadError> {
    let each = if by_seats { SEATS } else { 1 };
    let mut open = games::connect(target, games.len() * each, progress).await?.into_iter();
    let player = |game| {
        if by_seats {
            Player::by_seats(target, game, open.by_ref())
        } else {
            let connection = open.next().expect("there is one for every episode");
            Player::by_swarm(target, std::slice::from_ref(game), connection, None)
        }
    };
    Ok(games.iter().map(player).map(|player| (player, 0)).collect())
}

/// Plays for `time`, and at least one round. Players do not observe, as only acts are measured. With an interval each
/// player begins a round every `interval`, the players evenly spread; otherwise rounds follow each other at once.
async fn play(
    players: Vec<(Player, u32)>,
    score: &Arc<Score>,
    time: Duration,
    interval: Option<Duration>,
) -> Vec<(Player, u32)> {
    let mut tasks = JoinSet::new();
    let started = Instant::now();
    let share = 1.0 / super::float(players.len().max(1) as u64);
    for (place, (mut player, mut round)) in players.into_iter().enumerate() {
        let score = Arc::clone(score);
        let mut begins = interval.map(|interval| {
            let first = started + interval.mul_f64(super::float(place as u64) * share);
            let mut begins = tokio::time::interval_at(first.into(), interval);
            // A late round delays the later ones, which would otherwise be sent all at once.
            begins.set_missed_tick_behavior(MissedTickBehavior::Delay);
            begins
        });
        tasks.spawn(async move {
            loop {
                if let Some(begins) = &mut begins {
                    begins.tick().await;
                }
                if !player.round(&score, round, false).await {
                    return None;
                }
                round += 1;
                if started.elapsed() >= time {
                    return Some((player, round));
                }
            }
        });
    }
    // Failed clients are counted as errors and stop playing.
    tasks.join_all().await.into_iter().flatten().collect()
}

/// The record of an act in the server's journal, byte for byte.
async fn record(target: &Target, game: &LoadGame) -> Result<String, LoadError> {
    #[derive(serde::Deserialize)]
    struct Line {
        record: Round,
    }
    #[derive(serde::Deserialize)]
    struct Round {
        acts: Vec<Box<RawValue>>,
    }
    let failed = LoadError::of("the journal cannot be read");
    let url = format!("http://{}/api/v1/episodes/{}/journal", target.addr(), game.id);
    let answer = async {
        let call = reqwest::Client::new().get(url).bearer_auth(&game.swarm_token);
        call.send().await?.error_for_status()?.text().await
    };
    let journal = answer.await.map_err(|error| failed(&error))?;
    let line = journal.lines().nth(1).ok_or_else(|| failed(&"it has no round"))?;
    let line: Line = serde_json::from_str(line).map_err(|error| failed(&error))?;
    let act = line.record.acts.first().ok_or_else(|| failed(&"its first round has no act"))?;
    Ok(act.get().to_owned())
}
