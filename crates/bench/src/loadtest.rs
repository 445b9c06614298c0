//! `swarmbench-bench loadtest`

use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, bail};
use indicatif::ProgressBar;
use serde::Serialize;
use swarmbench::{host, migrations, telemetry};
use swarmbench_terminal::{progress_bar, set};

use crate::load::connection::{Answers, Target};
use crate::load::games::SEATS;
use crate::load::metrics::Metrics;
use crate::load::{Progress, acts, bare_acts, bare_handler, obs, play, polls};
use crate::report;

/// Open files besides connections: the terminal, the runtime, the database of the bare writer.
const FILES_RESERVED: u64 = 100;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Load test only a server of your own: a load test creates thousands of episodes, which stay in the server's \
    database, and uses all processors."
)]
pub(super) struct Args {
    /// The scenarios. Default: obs, acts and play.
    #[arg(value_enum)]
    scenarios: Vec<Scenario>,
    /// The address of the server.
    #[arg(long, env = "SWARMBENCH_SERVER", default_value = "http://127.0.0.1:8080")]
    server: String,
    /// Your key, if the server requires one.
    #[arg(long, env = "SWARMBENCH_KEY", hide_env_values = true)]
    key: Option<String>,
    /// obs, acts: the duration of a turn, in seconds. The server and the bare program run in turns.
    #[arg(long, default_value_t = 3.0, value_parser = seconds)]
    turn: f64,
    /// obs, acts: the number of turns of each.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    turns: u16,
    /// obs: the number of connections, each with one request at a time.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u16).range(1..))]
    connections: u16,
    /// acts: the number of concurrent episodes of 12 seats, two lines of the table for each number. More episodes make larger
    /// groups.
    #[arg(long, value_delimiter = ',', default_value = "8,128",
          value_parser = clap::value_parser!(u16).range(1..))]
    writers: Vec<u16>,
    /// acts: the folder of the bare writer's database; it should be on the same disk as the server's database.
    #[arg(long, default_value = ".")]
    dir: PathBuf,
    /// play: the number of concurrent episodes of 12 seats, one line of the grid for each number.
    #[arg(long, value_delimiter = ',', default_value = "32,128,512,2048,8192",
          value_parser = clap::value_parser!(u16).range(1..))]
    episodes: Vec<u16>,
    /// play: the number of rounds of each episode. Default: 4 to 100, fewer for more episodes.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    rounds: Option<u32>,
    /// polls: the number of requests that wait at the same time.
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u16).range(1..))]
    polls: u16,
    /// polls: the number of seats of an episode, whose requests wait and are woken together.
    #[arg(long, default_value_t = 12, value_parser = clap::value_parser!(u16).range(1..=1024))]
    seats: u16,
    /// The maximum number of concurrent connections.
    #[arg(long, default_value_t = 15_000, value_parser = clap::value_parser!(u16).range(64..))]
    connections_max: u16,
    /// Internal: run as the bare handler of another load test (`obs`).
    #[arg(long, hide = true)]
    bare_handler: bool,
    /// Internal: run as the bare server of another load test (`acts`).
    #[arg(long, hide = true)]
    bare_acts: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Scenario {
    /// Observations per second, compared with a bare handler that sends the same bytes.
    Obs,
    /// Durable acts per second, compared with a bare writer that commits groups of the same size.
    Acts,
    /// A grid of games, played to the end.
    Play,
    /// Many long polls.
    Polls,
    /// All scenarios.
    All,
}

fn seconds(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|seconds| (0.01..=3600.0).contains(seconds))
        .ok_or_else(|| "must be from 0.01 to 3600".to_owned())
}

#[derive(Debug, Default, Serialize)]
struct LoadReport {
    server: String,
    notes: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    obs: Option<obs::Comparison>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    acts: Vec<acts::Comparison>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    play: Vec<play::Line>,
    #[serde(skip_serializing_if = "Option::is_none")]
    polls: Option<polls::PollsReport>,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    if args.bare_handler {
        return Ok(bare_handler::serve(telemetry::render).await?);
    }
    if args.bare_acts {
        return Ok(bare_acts::serve(telemetry::render, &migrations::sqlite()).await?);
    }
    let server = args.server.clone();
    let target = Target::new(&server, args.key.clone()).await?;
    let metrics = Metrics::of(&target)
        .await
        .with_context(|| format!("{server} does not answer; does a server run there?"))?;
    let mut report = LoadReport { server, ..LoadReport::default() };
    if target.addr().ip().is_loopback() {
        report.notes.push(
            "client and server share this machine, so the client takes processor time from the server"
                .to_owned(),
        );
    }
    let connections_max = connections(&args, &metrics, &mut report.notes);
    let bar = progress_bar("{msg:40} {bar:30} {pos:>7}/{len:7}");
    measure(&args, &target, connections_max, &progress(&bar), &mut report).await?;
    bar.finish_and_clear();
    report::print(&report)?;
    let errors: u64 = answers(&report).map(|answers| answers.errors).sum();
    let unfinished: usize = report.play.iter().map(|line| line.episodes - line.ended).sum();
    if errors > 0 || unfinished > 0 {
        bail!("{errors} answers were errors, {unfinished} episodes were not played to the end");
    }
    Ok(())
}

fn progress(bar: &ProgressBar) -> Progress {
    let bar = bar.clone();
    Arc::new(move |what, done, of| {
        set(&bar, done, of);
        if bar.message() != what {
            bar.set_message(what.to_owned());
            // A bar prints nothing without a terminal.
            if bar.is_hidden() {
                note!("{what} ({of})");
            }
        }
    })
}

/// Connections that may be open, by the limits of both processes and the options.
fn connections(args: &Args, metrics: &Metrics, notes: &mut Vec<String>) -> usize {
    let own = host::raise_open_files().map_or(usize::MAX, |files| {
        usize::try_from(files.saturating_sub(FILES_RESERVED)).unwrap_or(usize::MAX)
    });
    let servers = metrics.connections_left().unwrap_or(usize::MAX);
    let most = usize::from(args.connections_max).min(own).min(servers);
    if most < usize::from(args.connections_max) {
        let whose = if own <= servers { "this process" } else { "the server" };
        notes.push(format!(
            "the limit of open files of {whose} allows {most} connections, so larger numbers are scaled down"
        ));
    }
    most
}

/// Runs the scenarios one after the other, so that they do not disturb each other.
async fn measure(
    args: &Args,
    target: &Target,
    connections_max: usize,
    progress: &Progress,
    report: &mut LoadReport,
) -> anyhow::Result<()> {
    let named = |scenario| {
        let default = matches!(scenario, Scenario::Obs | Scenario::Acts | Scenario::Play);
        args.scenarios.contains(&scenario)
            || args.scenarios.contains(&Scenario::All)
            || (args.scenarios.is_empty() && default)
    };
    let mut scaled = |what: &str, asked: usize, most: usize| {
        if asked > most {
            report.notes.push(format!("{what}: {most} instead of {asked}, as connections allow"));
        }
        asked.min(most).max(1)
    };
    let turn = Duration::from_secs_f64(args.turn);
    let turns = usize::from(args.turns);
    let tables = migrations::sqlite();
    if named(Scenario::Obs) {
        let connections = scaled("obs", args.connections.into(), connections_max);
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["loadtest", "--bare-handler"]);
        let done = obs::run(target, command, connections, (turns, turn), progress).await?;
        report.obs = Some(done);
    }
    if named(Scenario::Acts) {
        for (&episodes, by_seats) in args.writers.iter().flat_map(|n| [(n, true), (n, false)]) {
            let each = if by_seats { SEATS } else { 1 };
            let episodes = scaled("acts", episodes.into(), connections_max / each);
            let times = (turns, turn);
            let mut bare = Command::new(std::env::current_exe()?);
            bare.args(["loadtest", "--bare-acts"]);
            let bare = (args.dir.as_path(), &tables, bare);
            let done = acts::run(target, bare, by_seats, episodes, times, progress).await?;
            report.acts.push(done);
        }
    }
    if named(Scenario::Play) {
        for &episodes in &args.episodes {
            let episodes = usize::from(episodes);
            let rounds = args.rounds.unwrap_or_else(|| play::rounds(episodes));
            let line = play::run(target, episodes, rounds, connections_max, progress).await?;
            report.play.push(line);
        }
    }
    if named(Scenario::Polls) {
        let seats = usize::from(args.seats);
        // One connection for each poll, and one for each episode to act on.
        let polls = scaled("polls", args.polls.into(), connections_max * seats / (seats + 1));
        report.polls = Some(polls::run(target, polls, seats, progress).await?);
    }
    Ok(())
}

fn answers(report: &LoadReport) -> impl Iterator<Item = &Answers> {
    (report.obs.iter().map(|obs| &obs.answers))
        .chain(report.acts.iter().map(|acts| &acts.answers))
        .chain(report.play.iter().map(|line| &line.answers))
        .chain(report.polls.iter().map(|polls| &polls.answers))
}
