//! `swarmbench capacity measure`

use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::bail;
use indicatif::{HumanBytes, HumanCount};
use serde::Serialize;
use serde_json::Value;
use swarmbench_loadtest::connection::{Connection, Target, request};
use swarmbench_loadtest::{Progress, reads};

use super::child::{Child, Finished};
use crate::cli::loadtest::show_reads;
use crate::cli::output::{self, table};

/// How long a server may take to be ready.
const READY_PATIENCE: Duration = Duration::from_mins(10);

/// The pause between two looks whether it is ready.
const LOOK_AGAIN: Duration = Duration::from_millis(2);

#[derive(Debug, clap::Args)]
#[command(
    after_help = "It starts a server of its own on the database, reads boards, lists and look-ups, exports and verifies its \
    first competition, stops the server and rebuilds the results of the boards. No other server may use the database.\n\n\
    Examples:\n  \
    swarmbench capacity fill --db big.db && swarmbench capacity measure --db big.db\n  \
    swarmbench capacity measure --db small.db --reads 100 --json"
)]
pub(in crate::cli) struct Args {
    /// The database, such as `swarmbench capacity fill` makes it.
    #[arg(long)]
    db: PathBuf,
    /// Reads of each kind.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..))]
    reads: u32,
    /// Concurrent clients.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=1000))]
    readers: u16,
    /// Where the export of the competition is written for a while.
    #[arg(long, default_value = ".")]
    dir: PathBuf,
    /// As JSON.
    #[arg(long)]
    json: bool,
}

/// What was measured.
#[derive(Debug, Serialize)]
struct Report {
    database: PathBuf,
    bytes: u64,
    /// From the start of the program until it says that it is ready.
    ready_ms: f64,
    /// The first read of the leaderboard after that.
    first_board_ms: f64,
    reads: reads::Report,
    /// The most memory that the server had, in bytes, if the host tells it.
    server_memory_bytes: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    competition: Option<Competition>,
    rebuild: Rebuild,
}

#[derive(Debug, Serialize)]
struct Competition {
    games: u64,
    rounds: u64,
    export_bytes: u64,
    export_seconds: f64,
    verify_seconds: f64,
    verify_memory_bytes: Option<u64>,
}

#[derive(Debug, Serialize)]
struct Rebuild {
    results: u64,
    /// Results that were not as they should be.
    changed: u64,
    seconds: f64,
    memory_bytes: Option<u64>,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let Args { db, reads, readers, dir, json } = args;
    if !db.is_file() {
        bail!("there is no database {}: `swarmbench capacity fill` makes one", db.display());
    }
    let started = Instant::now();
    let server = Server::start(&db).await?;
    let ready_ms = milliseconds(started);
    let before = Instant::now();
    server.get("/api/v1/leaderboard").await?;
    let first_board_ms = milliseconds(before);
    let silent: Progress = Arc::new(|_, _, _| ());
    let reads = reads::run(&server.target, reads as usize, readers.into(), &silent).await?;
    if let Some(error) = reads.answers.samples.first() {
        bail!("{} reads were answered with errors: {error}", reads.answers.errors);
    }
    let competition = competition(&server, &dir).await?;
    let server_memory_bytes = server.stop().await?.memory_bytes;
    let rebuild = rebuild(&db).await?;
    let bytes = std::fs::metadata(&db)?.len();
    let database = db;
    let report = Report {
        database,
        bytes,
        ready_ms,
        first_board_ms,
        reads,
        server_memory_bytes,
        competition,
        rebuild,
    };
    if json {
        return output::json(&report);
    }
    show(&report);
    Ok(())
}

/// A server of this command, until it is stopped.
struct Server {
    child: Child,
    target: Target,
    address: String,
}

impl Server {
    /// Starts a server; it is ready when this returns.
    async fn start(db: &Path) -> anyhow::Result<Self> {
        // Another program may take the port before the server does; the server says so then.
        let port = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?.local_addr()?.port();
        let address = format!("127.0.0.1:{port}");
        let child = Child::start(&["serve", "--addr", &address, "--db", &text(db)], None)?;
        let address = format!("http://{address}");
        let target = Target::new(&address, None).await?;
        let mut server = Self { child, target, address };
        let started = Instant::now();
        while server.get("/readyz").await.is_err() {
            if let Some(said) = server.child.ended()? {
                bail!("the server ended: {said}");
            }
            if started.elapsed() > READY_PATIENCE {
                bail!("the server was not ready within {} s", READY_PATIENCE.as_secs());
            }
            tokio::time::sleep(LOOK_AGAIN).await;
        }
        Ok(server)
    }

    /// The body of an answer.
    async fn get(&self, path: &str) -> anyhow::Result<Vec<u8>> {
        let mut connection = Connection::new(&self.target);
        let answer = connection.ask(&request(&self.target, "GET", path, None, None)).await?;
        let body = connection.body().to_vec();
        if !answer.is_ok() {
            bail!("{path} was answered with {}", String::from_utf8_lossy(&body));
        }
        Ok(body)
    }

    async fn stop(self) -> anyhow::Result<Finished> {
        self.child.stop().await
    }
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

/// Exports and verifies the newest competition that is open to all, if there is one.
async fn competition(server: &Server, dir: &Path) -> anyhow::Result<Option<Competition>> {
    let listed: Value = serde_json::from_slice(&server.get("/api/v1/competitions").await?)?;
    let all = listed["items"].as_array().map_or(&[][..], Vec::as_slice);
    let open = all.iter().find(|competition| competition["revealed_at"].is_string());
    let Some(id) = open.and_then(|competition| competition["id"].as_str()) else { return Ok(None) };
    let file = tempfile(dir)?;
    let address = &server.address;
    let export = Child::start(&["competition", "export", id, "--server", address], Some(&file))?;
    let export = export.finished().await?;
    let export_bytes = std::fs::metadata(&file)?.len();
    let verify = Child::start(&["verify", "--competition", "--json", &text(&file)], None)?;
    let verify = verify.finished().await;
    std::fs::remove_file(&file)?;
    let verify = verify?;
    let said: Value = serde_json::from_slice(&verify.output)?;
    let count = |name: &str| said[name].as_u64().unwrap_or(0);
    Ok(Some(Competition {
        games: count("episodes"),
        rounds: count("rounds"),
        export_bytes,
        export_seconds: export.seconds,
        verify_seconds: verify.seconds,
        verify_memory_bytes: verify.memory_bytes,
    }))
}

/// A new file for the export.
fn tempfile(dir: &Path) -> anyhow::Result<PathBuf> {
    let file = dir.join(format!("capacity-{}.jsonl", std::process::id()));
    if file.exists() {
        bail!("{} exists: remove it, or name another folder with --dir", file.display());
    }
    Ok(file)
}

async fn rebuild(db: &Path) -> anyhow::Result<Rebuild> {
    let args = ["board", "rebuild", "--no-metrics", "--json", "--db", &text(db)];
    let done = Child::start(&args, None)?.finished().await?;
    let said: Value = serde_json::from_slice(&done.output)?;
    let count = |name: &str| said[name].as_u64().unwrap_or(0);
    let (results, changed) = (count("results"), count("changed"));
    Ok(Rebuild { results, changed, seconds: done.seconds, memory_bytes: done.memory_bytes })
}

fn show(report: &Report) {
    let Report { database, bytes, ready_ms, first_board_ms, .. } = report;
    let memory = |bytes: Option<u64>| {
        bytes.map_or_else(|| "?".to_owned(), |bytes| HumanBytes(bytes).to_string())
    };
    let mut shown = table(&["what", "measured"]);
    let mut row = |what: &str, measured: String| {
        shown.add_row([what.to_owned(), measured]);
    };
    row("database", format!("{}, {}", database.display(), HumanBytes(*bytes)));
    row("start until ready", format!("{ready_ms:.0} ms"));
    row("first read of the leaderboard", format!("{first_board_ms:.0} ms"));
    row("memory of the server, at most", memory(report.server_memory_bytes));
    if let Some(cup) = &report.competition {
        let Competition { games, rounds, export_bytes, export_seconds, verify_seconds, .. } = *cup;
        let rate = |count: u64, seconds: f64| HumanCount(per_second(count, seconds));
        row(
            "export of a competition",
            format!(
                "{} games, {} in {export_seconds:.2} s: {}/s",
                HumanCount(games),
                HumanBytes(export_bytes),
                HumanBytes(per_second(export_bytes, export_seconds)),
            ),
        );
        row(
            "its verification",
            format!(
                "{} rounds in {verify_seconds:.2} s: {} a second, memory {}",
                HumanCount(rounds),
                rate(rounds, verify_seconds),
                memory(cup.verify_memory_bytes),
            ),
        );
    }
    let Rebuild { results, seconds, memory_bytes, .. } = report.rebuild;
    row(
        "board rebuild",
        format!(
            "{} results in {seconds:.1} s, memory {}",
            HumanCount(results),
            memory(memory_bytes)
        ),
    );
    out!("{shown}");
    show_reads(&report.reads);
}

#[expect(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a rate that is shown"
)]
fn per_second(count: u64, seconds: f64) -> u64 {
    (count as f64 / seconds.max(1e-9)) as u64
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
