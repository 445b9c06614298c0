//! `swarmbench-bench loadtest`

use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, bail};
use indicatif::ProgressBar;
use serde::Serialize;
use swarmbench::store::Location;
use swarmbench::{host, migrations, telemetry};
use swarmbench_terminal::{self as terminal, numbers, progress_bar, set};
use swarmbench_testkit::latencies::Spread;

use crate::load::bare_commit::{BareLocation, Tables};
use crate::load::connection::{Answers, Target};
use crate::load::games::SEATS;
use crate::load::metrics::Metrics;
use crate::load::{Progress, acts, alone, bare_acts, bare_handler, obs, play, polls, reads, slow};

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
    /// Another server of the same cluster; may be repeated. Connections go to all servers in turn, so most requests are
    /// forwarded. Counts are sums over the servers.
    #[arg(long = "other-server", alias = "node", value_name = "URL")]
    other_servers: Vec<String>,
    /// Print all measurements as JSON instead of tables.
    #[arg(long)]
    json: bool,
    /// obs, acts, alone: the duration of a turn, in seconds. The server and the bare program run in turns.
    #[arg(long, default_value_t = 3.0, value_parser = seconds)]
    turn: f64,
    /// obs, acts, alone: the number of turns of each.
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
    /// acts, alone: the folder of the bare writer's database and of a file that is written; it should be on the same disk as the
    /// server's database.
    #[arg(long, default_value = ".")]
    dir: PathBuf,
    /// acts, alone: the address of the database, for a server on PostgreSQL. The bare writer creates a database of its own beside
    /// this one, and drops it afterwards. The user must be allowed to create databases; a password is better in `password_file=`
    /// or PGPASSWORD.
    #[arg(long, value_name = "postgres://USER@HOST:PORT/DATABASE")]
    db: Option<Location>,
    /// play: the number of concurrent episodes of 12 seats, one line of the grid for each number.
    #[arg(long, value_delimiter = ',', default_value = "32,128,512,2048,8192",
          value_parser = clap::value_parser!(u16).range(1..))]
    episodes: Vec<u16>,
    /// play: the number of rounds of each episode. Default: 4 to 100, fewer for more episodes.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    rounds: Option<u32>,
    /// reads: the number of requests of each kind.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..))]
    reads: u32,
    /// reads: the number of concurrent clients.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=1000))]
    readers: u16,
    /// polls: the number of requests that wait at the same time.
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u16).range(1..))]
    polls: u16,
    /// polls: the number of seats of an episode, whose requests wait and are woken together.
    #[arg(long, default_value_t = 12, value_parser = clap::value_parser!(u16).range(1..=1024))]
    seats: u16,
    /// slow: the number of clients that send a byte now and then, send nothing, or read nothing.
    #[arg(long, default_value_t = 2000, value_parser = clap::value_parser!(u16).range(1..))]
    slow_connections: u16,
    /// slow: the duration in seconds. Before it, honest clients play alone for as long.
    #[arg(long, default_value_t = 30.0, value_parser = seconds)]
    slow_time: f64,
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
    /// Durable acts one after the other, compared with one commit of a bare writer and one fdatasync.
    Alone,
    /// A grid of games, played to the end.
    Play,
    /// Boards, lists and look-ups of the games that the server has.
    Reads,
    /// Many long polls.
    Polls,
    /// Slow clients next to honest ones.
    Slow,
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
    #[serde(skip_serializing_if = "Option::is_none")]
    alone: Option<alone::Comparison>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    play: Vec<play::Line>,
    #[serde(skip_serializing_if = "Option::is_none")]
    reads: Option<reads::ReadsReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    polls: Option<polls::PollsReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    slow: Option<slow::SlowReport>,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    if args.bare_handler {
        return Ok(bare_handler::serve(telemetry::render).await?);
    }
    if args.bare_acts {
        let (sqlite, postgres) = (migrations::sqlite(), migrations::postgres());
        let tables = Tables { sqlite: &sqlite, postgres: &postgres };
        return Ok(bare_acts::serve(telemetry::render, tables).await?);
    }
    let server = args.server.clone();
    let mut target = Target::new(&server, args.key.clone()).await?;
    for server in &args.other_servers {
        target.add(server).await?;
    }
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
    if args.json {
        terminal::json(&report)?;
    } else {
        show(&report);
    }
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

/// Location of the bare writers' databases. Checked here, as clap would print a password in an invalid address.
fn bare_place(args: &Args) -> anyhow::Result<BareLocation> {
    match &args.db {
        None => Ok(BareLocation::Folder(args.dir.clone())),
        Some(Location::Postgres(address)) => Ok(BareLocation::Postgres(address.with_password()?)),
        Some(Location::Unknown(error)) => bail!("{error}"),
        Some(Location::File(_)) => bail!(
            "--db is the address of a PostgreSQL, as in postgres://USER@HOST:PORT/DATABASE; a bare writer of SQLite makes a file \
             in --dir"
        ),
    }
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
    let (sqlite, postgres) = (migrations::sqlite(), migrations::postgres());
    let tables = Tables { sqlite: &sqlite, postgres: &postgres };
    if named(Scenario::Obs) {
        let connections = scaled("obs", args.connections.into(), connections_max);
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["loadtest", "--bare-handler"]);
        let done = obs::run(target, command, connections, (turns, turn), progress).await?;
        report.obs = Some(done);
    }
    if named(Scenario::Acts) {
        let place = bare_place(args)?;
        for (&episodes, by_seats) in args.writers.iter().flat_map(|n| [(n, true), (n, false)]) {
            let each = if by_seats { SEATS } else { 1 };
            let episodes = scaled("acts", episodes.into(), connections_max / each);
            let times = (turns, turn);
            let mut bare = Command::new(std::env::current_exe()?);
            bare.args(["loadtest", "--bare-acts"]);
            let bare = (&place, tables, bare);
            let done = acts::run(target, bare, by_seats, episodes, times, progress).await?;
            report.acts.push(done);
        }
    }
    if named(Scenario::Alone) {
        let place = bare_place(args)?;
        let beside = (&place, tables, args.dir.as_path());
        report.alone = Some(alone::run(target, beside, (turns, turn), progress).await?);
    }
    if named(Scenario::Play) {
        for &episodes in &args.episodes {
            let episodes = usize::from(episodes);
            let rounds = args.rounds.unwrap_or_else(|| play::rounds(episodes));
            let line = play::run(target, episodes, rounds, connections_max, progress).await?;
            report.play.push(line);
        }
    }
    if named(Scenario::Reads) {
        let (requests, clients) = (args.reads as usize, usize::from(args.readers));
        report.reads = Some(reads::run(target, requests, clients, progress).await?);
    }
    if named(Scenario::Polls) {
        let seats = usize::from(args.seats);
        // One connection for each poll, and one for each episode to act on.
        let polls = scaled("polls", args.polls.into(), connections_max * seats / (seats + 1));
        report.polls = Some(polls::run(target, polls, seats, progress).await?);
    }
    if named(Scenario::Slow) {
        let honest = slow::HONEST * SEATS;
        let most = connections_max.saturating_sub(honest);
        let clients = scaled("slow", args.slow_connections.into(), most);
        let time = Duration::from_secs_f64(args.slow_time);
        report.slow = Some(slow::run(target, clients, time, progress).await?);
    }
    Ok(())
}

fn answers(report: &LoadReport) -> impl Iterator<Item = &Answers> {
    (report.obs.iter().map(|obs| &obs.answers))
        .chain(report.acts.iter().map(|acts| &acts.answers))
        .chain(report.alone.iter().map(|alone| &alone.answers))
        .chain(report.play.iter().map(|line| &line.answers))
        .chain(report.reads.iter().map(|reads| &reads.answers))
        .chain(report.polls.iter().map(|polls| &polls.answers))
        .chain(report.slow.iter().map(|slow| &slow.answers))
}

fn show(report: &LoadReport) {
    out!("Load test of {}", report.server);
    for note in &report.notes {
        out!("Note: {note}.");
    }
    if let Some(obs) = &report.obs {
        show_obs(obs);
    }
    if !report.acts.is_empty() {
        show_acts(&report.acts);
    }
    if !report.play.is_empty() {
        show_play(&report.play);
    }
    if let Some(reads) = &report.reads {
        show_reads(reads);
    }
    if let Some(alone) = &report.alone {
        show_alone(alone);
    }
    if let Some(polls) = &report.polls {
        show_polls(polls);
    }
    if let Some(slow) = &report.slow {
        show_slow(slow);
    }
    for sample in answers(report).flat_map(|answers| &answers.samples) {
        out!("error: {sample}");
    }
}

fn show_obs(obs: &obs::Comparison) {
    let mut shown =
        numbers(&["GET /obs", "requests/s", "slowest", "fastest", "p50 ms", "p99 ms", "CPU µs"]);
    for (name, side) in [("server", &obs.server), ("bare handler", &obs.bare)] {
        shown.add_row([
            name.to_owned(),
            round(side.per_s),
            round(side.per_s_min),
            round(side.per_s_max),
            millis(side.latency.p50_ms),
            millis(side.latency.p99_ms),
            micros(side.cpu_us),
        ]);
    }
    out!(
        "\nThe same {} bytes from the server and from a bare handler of axum, {} connections, {} turns of {} s",
        obs.bytes,
        obs.connections,
        obs.turns,
        obs.turn_s
    );
    out!("{shown}");
    out!("/obs has {:.0} % of the bare handler's requests a second", obs.ratio * 100.0);
    if let Some(ratio) = obs.cpu_ratio {
        out!("(by time on the processors alone, without the client's: {:.0} %)", ratio * 100.0);
    }
}

fn show_acts(all: &[acts::Comparison]) {
    let mut shown = numbers(&[
        "durable acts",
        "episodes",
        "acts/s",
        "entries a commit",
        "commits/s",
        "ack p50 ms",
        "ack p99 ms",
        "p99 at half",
        "CPU µs",
        "bare acts/s",
        "bare commits/s",
        "of the bare writer",
        "of a bare server",
    ]);
    for acts in all {
        shown.add_row([
            acts.by.to_owned(),
            acts.episodes.to_string(),
            round(acts.acts_per_s),
            format!("{:.1}", acts.entries_per_commit),
            round(acts.commits_per_s),
            millis(acts.acknowledged.p50_ms),
            millis(acts.acknowledged.p99_ms),
            millis(acts.acknowledged_at_half.p99_ms),
            micros(acts.cpu_us),
            round(acts.bare_acts_per_s),
            round(acts.bare_commits_per_s),
            format!("{:.0} %", acts.ratio * 100.0),
            format!("{:.0} %", acts.bare_server_ratio * 100.0),
        ]);
    }
    if let Some(acts) = all.first() {
        out!(
            "\nActs that are on the disk, and a bare {} writer with groups of the same size (records of {} bytes), \
             {} turns of {} s",
            acts.bare_engine,
            acts.record_bytes,
            acts.turns,
            acts.turn_s
        );
    }
    out!("{shown}");
}

fn show_play(lines: &[play::Line]) {
    let mut shown = numbers(&[
        "episodes",
        "by",
        "rounds",
        "to the end",
        "success",
        "held back",
        "acts/s",
        "rounds/s",
        "ack p50 ms",
        "ack p99 ms",
        "wake p50 ms",
        "wake p99 ms",
        "s",
    ]);
    for line in lines {
        shown.add_row([
            line.episodes.to_string(),
            line.by.to_owned(),
            line.rounds.to_string(),
            line.ended.to_string(),
            format!("{:.2} %", line.answers.success() * 100.0),
            line.answers.held_back.to_string(),
            round(line.acts_per_s),
            round(line.rounds_per_s),
            millis(line.acknowledged.p50_ms),
            millis(line.acknowledged.p99_ms),
            millis(line.woken.p50_ms),
            millis(line.woken.p99_ms),
            format!("{:.1}", line.seconds),
        ]);
    }
    out!("\nEpisodes of 12 seats, all at once, to the end");
    out!("{shown}");
    out!(
        "by /act: a connection for each seat, which acts and then waits at /obs; by /swarm/act: one for each \
         episode, or for several if there are more than connections, which looks at /swarm/obs and acts for all seats (ack: of all 12 acts), and of some episodes one seat \
         that waits at /obs. wake: from the receipt of a round's last act until a waiting seat has its observation"
    );
}

/// Prints the durations of reads.
pub(super) fn show_reads(reads: &reads::ReadsReport) {
    let mut shown = numbers(&[
        "read",
        "different",
        "first: p50 ms",
        "max ms",
        "later: p50 ms",
        "p99 ms",
        "max ms",
    ]);
    for line in &reads.lines {
        shown.add_row([
            line.read.to_owned(),
            line.different.to_string(),
            millis(line.first.p50_ms),
            millis(line.first.max_ms),
            millis(line.latency.p50_ms),
            millis(line.latency.p99_ms),
            millis(line.latency.max_ms),
        ]);
    }
    out!(
        "\nDifferent requests of each kind once by one client, then {} of each kind by {} clients at once",
        reads.requests,
        reads.clients
    );
    out!("{shown}");
}

fn show_alone(alone: &alone::Comparison) {
    let mut shown = numbers(&["one at a time", "count", "p50 ms", "p99 ms", "max ms"]);
    for (name, spread) in [
        ("/act, until its receipt".to_owned(), alone.act),
        (format!("a commit of a bare writer of {}", alone.bare_engine), alone.bare_commit),
        ("fdatasync of a page".to_owned(), alone.fdatasync),
    ] {
        let Spread { count, p50_ms, p99_ms, max_ms } = spread;
        let times = [p50_ms, p99_ms, max_ms].map(exact);
        shown.add_row([name, count.to_string()].into_iter().chain(times));
    }
    out!("\nNothing else is committed meanwhile, {} turns of {} s each", alone.turns, alone.turn_s);
    out!("{shown}");
}

fn show_polls(polls: &polls::PollsReport) {
    let mut shown = numbers(&["woken", "requests", "p50 ms", "p99 ms", "max ms"]);
    for (name, spread) in [
        ("one episode after the other", polls.one_by_one),
        ("all episodes at once", polls.all_at_once),
    ] {
        let Spread { count, p50_ms, p99_ms, max_ms } = spread;
        let times = [p50_ms, p99_ms, max_ms].map(millis);
        shown.add_row([name.to_owned(), count.to_string()].into_iter().chain(times));
    }
    out!(
        "\n{} requests waited at once, on {} episodes of {} seats",
        polls.polls,
        polls.episodes,
        polls.seats
    );
    out!("{shown}");
    let memory = polls.memory_before_bytes.zip(polls.memory_held_bytes).zip(polls.bytes_per_poll);
    let Some(((before, held), grown)) = memory else {
        out!("the server does not report its memory");
        return;
    };
    out!(
        "the server's memory grew from {:.1} to {:.1} MB, {:.1} kB for each request (episodes and all, the server has \
         {:.1} kB for each; if it did much before, it may have used memory again, and only that counts)",
        before / 1e6,
        held / 1e6,
        grown / 1e3,
        held / 1e3 / f64::from(u32::try_from(polls.polls.max(1)).unwrap_or(u32::MAX))
    );
}

fn show_slow(slow: &slow::SlowReport) {
    out!("\n{} slow clients for {} s", slow.clients, slow.seconds);
    let mut kept = numbers(&[
        "they send",
        "clients",
        "closed",
        "within 15 s",
        "still open after 15 s",
        "longest s",
    ]);
    for one in &slow.kept {
        kept.add_row([
            one.kind.name().to_owned(),
            one.clients.to_string(),
            one.closed.to_string(),
            one.closed_within_15_s.to_string(),
            one.open_after_15_s.to_string(),
            format!("{:.1}", one.longest_s),
        ]);
    }
    out!("{kept}");
    let mut honest =
        numbers(&["honest clients", "act p50 ms", "act p99 ms", "look p50 ms", "look p99 ms"]);
    for (name, side) in [("alone", slow.before), ("beside slow ones", slow.during)] {
        let times = [
            side.acknowledged.p50_ms,
            side.acknowledged.p99_ms,
            side.looked.p50_ms,
            side.looked.p99_ms,
        ];
        honest.add_row([name.to_owned()].into_iter().chain(times.map(millis)));
    }
    out!("{honest}");
    out!(
        "the p99 of acts is {:.2} times, that of looks {:.2} times what it is without them",
        slow.acknowledged_factor,
        slow.looked_factor
    );
}

fn round(number: f64) -> String {
    format!("{number:.0}")
}

fn micros(number: Option<f64>) -> String {
    number.map_or_else(|| "?".to_owned(), |micros| format!("{micros:.1}"))
}

/// A number with two decimals, also for times below a millisecond.
fn exact(number: f64) -> String {
    format!("{number:.2}")
}

pub(super) fn millis(number: f64) -> String {
    format!("{number:.1}")
}
