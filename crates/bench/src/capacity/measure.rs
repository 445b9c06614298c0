//! `swarmbench-bench capacity measure`

use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::bail;
use serde::Serialize;
use serde_json::Value;

use super::child::{Child, Finished, Program};
use crate::load::connection::{Connection, Target, request};
use crate::load::{competition, reads};
use crate::report;

/// Maximum time until a server is ready.
const READY_PATIENCE: Duration = Duration::from_mins(10);

/// Pause between two checks whether it is ready.
const LOOK_AGAIN: Duration = Duration::from_millis(2);

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The command starts a server of its own on the database, reads boards, lists and look-ups, exports and verifies \
    the first competition, stops the server and rebuilds the results of the boards. No other server may use the database.\n\n\
    With --ends the command measures only the newest open competition: it lets new entrants play there, in the places \
    of others, reads all pages of the competition meanwhile, then exports and verifies it. This changes the database, so name a \
    copy.\n\n\
    Examples:\n  \
    swarmbench-bench capacity fill --db big.db && swarmbench-bench capacity measure --db big.db\n  \
    swarmbench-bench capacity measure --db copy-of-cup.db --ends 10\n  \
    swarmbench-bench capacity measure --db small.db --reads 100"
)]
pub(crate) struct Args {
    /// The database, such as one of `swarmbench-bench capacity fill`.
    #[arg(long)]
    db: PathBuf,
    #[command(flatten)]
    program: Program,
    /// The number of reads of each kind.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..))]
    reads: u32,
    /// The number of concurrent clients.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=1000))]
    readers: u16,
    /// The number of games per second that end in an open competition while its pages are read; 0 for none.
    #[arg(long, default_value_t = 0.0, value_parser = ends)]
    ends: f64,
    /// The time during which these pages are read, with --ends.
    #[arg(long, default_value_t = 60, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..=600))]
    reading: u64,
    /// Neither export nor verify the competition, with --ends: both take long, and as much disk as its journals.
    #[arg(long, requires = "ends")]
    no_export: bool,
    /// The folder of the temporary export of the competition.
    #[arg(long, default_value = ".")]
    dir: PathBuf,
}

/// Measurements.
#[derive(Debug, Serialize)]
struct CapacityReport {
    database: PathBuf,
    bytes: u64,
    /// Milliseconds from the start of the program until it reports that it is ready.
    ready_ms: f64,
    /// Milliseconds of the first read of the leaderboard after that.
    first_board_ms: f64,
    #[serde(flatten)]
    part: Part,
    /// Peak memory of the server in bytes, if the host reports it.
    server_memory_bytes: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rebuild: Option<Rebuild>,
}

/// Measurements of a running server.
#[derive(Debug, Serialize)]
struct Part {
    #[serde(skip_serializing_if = "Option::is_none")]
    reads: Option<reads::ReadsReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    while_games_end: Option<competition::CompetitionReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    competition: Option<File>,
}

#[derive(Debug, Serialize)]
struct File {
    games: u64,
    rounds: u64,
    export_bytes: u64,
    export_seconds: f64,
    export_memory_bytes: Option<u64>,
    verify_seconds: f64,
    verify_memory_bytes: Option<u64>,
}

#[derive(Debug, Serialize)]
struct Rebuild {
    results: u64,
    /// Results that were wrong before the rebuild.
    changed: u64,
    seconds: f64,
    memory_bytes: Option<u64>,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let Args { db, program, reads, readers, ends, reading, no_export, dir } = args;
    if !db.is_file() {
        bail!("there is no database {}: `swarmbench-bench capacity fill` makes one", db.display());
    }
    let organizer = if ends > 0.0 { Some(new_organizer(&program, &db).await?) } else { None };
    let started = Instant::now();
    let server = Server::start(&program, &db).await?;
    let ready_ms = milliseconds(started);
    let before = Instant::now();
    server.get("/api/v1/leaderboard").await?;
    let first_board_ms = milliseconds(before);
    let part = match organizer {
        None => of_all(&server, reads as usize, readers.into(), &dir).await?,
        Some(organizer) => {
            let reading = Duration::from_secs(reading);
            let competition = open_competition(&server).await?;
            let readers = readers.into();
            let plan =
                competition::Plan { competition, organizer, reading, readers, ends_per_s: ends };
            of_open_competition(&server, plan, (!no_export).then_some(&*dir)).await?
        }
    };
    let server_memory_bytes = server.stop().await?.memory_bytes;
    let rebuild = if part.reads.is_some() { Some(rebuild(&program, &db).await?) } else { None };
    let bytes = std::fs::metadata(&db)?.len();
    let database = db;
    let report = CapacityReport {
        database,
        bytes,
        ready_ms,
        first_board_ms,
        part,
        server_memory_bytes,
        rebuild,
    };
    report::print(&report)
}

/// Measures boards, lists and look-ups of all kinds, and a competition that is over.
async fn of_all(
    server: &Server,
    requests: usize,
    readers: usize,
    dir: &Path,
) -> anyhow::Result<Part> {
    let reads = reads::run(&server.target, requests, readers).await?;
    if let Some(error) = reads.answers.samples.first() {
        bail!("{} reads were answered with errors: {error}", reads.answers.errors);
    }
    let competition = match revealed_competition(server).await? {
        Some(id) => Some(file(server, &id, None, dir).await?),
        None => None,
    };
    Ok(Part { reads: Some(reads), while_games_end: None, competition })
}

/// Measures the pages of a competition while its games end, and its export.
async fn of_open_competition(
    server: &Server,
    plan: competition::Plan,
    dir: Option<&Path>,
) -> anyhow::Result<Part> {
    let (id, organizer) = (plan.competition.clone(), plan.organizer.clone());
    let read = competition::run(&server.target, plan).await?;
    let competition = match dir {
        Some(dir) => Some(file(server, &id, Some(&organizer), dir).await?),
        None => None,
    };
    Ok(Part { reads: None, while_games_end: Some(read), competition })
}

/// A server that this command runs.
struct Server {
    program: Program,
    child: Child,
    target: Target,
    address: String,
}

impl Server {
    /// Starts a server and waits until it is ready.
    async fn start(program: &Program, db: &Path) -> anyhow::Result<Self> {
        // If another program takes the port before the server does, the server reports it.
        let port = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?.local_addr()?.port();
        let address = format!("127.0.0.1:{port}");
        let child = program.start(&["serve", "--addr", &address, "--db", &text(db)], None)?;
        let address = format!("http://{address}");
        let target = Target::new(&address, None).await?;
        let mut server = Self { program: program.clone(), child, target, address };
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

    /// Body of a response.
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

/// Creates an organizer's key.
async fn new_organizer(program: &Program, db: &Path) -> anyhow::Result<String> {
    let name = "capacity measure";
    let args = ["key", "create", "--name", name, "--role", "organizer", "--db", &text(db)];
    let made = program.start(&args, None)?.finished().await?;
    let said = String::from_utf8(made.output)?;
    Ok(said.trim().to_owned())
}

/// The newest competition that can be entered.
async fn open_competition(server: &Server) -> anyhow::Result<String> {
    let listed: Value = serde_json::from_slice(&server.get("/api/v1/competitions").await?)?;
    let all = listed["items"].as_array().map_or(&[][..], Vec::as_slice);
    let open = all.iter().find(|one| one["phase"] == "open" && one["entry"] == "anybody");
    match open.and_then(|one| one["id"].as_str()) {
        Some(id) => Ok(id.to_owned()),
        None => {
            bail!(
                "no competition is open: `swarmbench-bench capacity fill --entrants 1000` makes one"
            )
        }
    }
}

fn ends(text: &str) -> Result<f64, String> {
    let ends = text.parse().ok().filter(|ends| (0.0..=1000.0).contains(ends));
    ends.ok_or_else(|| "must be from 0 to 1000".to_owned())
}

/// The newest competition that is readable for all, if there is one.
async fn revealed_competition(server: &Server) -> anyhow::Result<Option<String>> {
    let listed: Value = serde_json::from_slice(&server.get("/api/v1/competitions").await?)?;
    let all = listed["items"].as_array().map_or(&[][..], Vec::as_slice);
    let open = all.iter().find(|competition| competition["revealed_at"].is_string());
    Ok(open.and_then(|competition| competition["id"].as_str()).map(str::to_owned))
}

/// Exports and verifies a competition.
async fn file(server: &Server, id: &str, key: Option<&str>, dir: &Path) -> anyhow::Result<File> {
    let file = tempfile(dir)?;
    let mut args = vec!["competition", "export", id, "--server", &server.address];
    args.extend(key.iter().flat_map(|key| ["--key", key]));
    let export = server.program.start(&args, Some(&file))?.finished().await?;
    let export_bytes = std::fs::metadata(&file)?.len();
    let verify =
        server.program.start(&["verify", "--competition", "--json", &text(&file)], None)?;
    let verify = verify.finished().await;
    std::fs::remove_file(&file)?;
    let verify = verify?;
    let said: Value = serde_json::from_slice(&verify.output)?;
    let count = |name: &str| said[name].as_u64().unwrap_or(0);
    Ok(File {
        games: count("episodes"),
        rounds: count("rounds"),
        export_bytes,
        export_seconds: export.seconds,
        export_memory_bytes: export.memory_bytes,
        verify_seconds: verify.seconds,
        verify_memory_bytes: verify.memory_bytes,
    })
}

/// Path of a new file for the export.
fn tempfile(dir: &Path) -> anyhow::Result<PathBuf> {
    let file = dir.join(format!("capacity-{}.jsonl", std::process::id()));
    if file.exists() {
        bail!("{} exists: remove it, or name another folder with --dir", file.display());
    }
    Ok(file)
}

async fn rebuild(program: &Program, db: &Path) -> anyhow::Result<Rebuild> {
    let args = ["board", "rebuild", "--no-metrics", "--json", "--db", &text(db)];
    let done = program.start(&args, None)?.finished().await?;
    let said: Value = serde_json::from_slice(&done.output)?;
    let count = |name: &str| said[name].as_u64().unwrap_or(0);
    let (results, changed) = (count("results"), count("changed"));
    Ok(Rebuild { results, changed, seconds: done.seconds, memory_bytes: done.memory_bytes })
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
