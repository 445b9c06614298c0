//! The latency of an act that is committed alone, compared with the minimum of its disk and its database: one
//! `fdatasync` of a file, and one commit of a bare writer.

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::Serialize;
use serde_json::json;
use swarmbench_testkit::latencies::{Latencies, Spread};

use super::bare_commit::{BareCommit, BareLocation, Tables};
use super::connection::{Answers, Connection, Tally, Target, request};
use super::games::{self, SEATS};
use super::{LoadError, Progress};

/// Bytes written before each `fdatasync`: a page, as in a log.
const PAGE_BYTES: usize = 4096;

/// Rounds of an episode: more than any turn plays.
const ROUNDS_MAX: u32 = 100_000;

/// The record of an act, about as long as a server's.
const RECORD: &str =
    r#"{"agent":"Agent_0","action":"SWITCH","message":null,"usage":null,"valid":true}"#;

/// The results.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Comparison {
    /// The engine of the bare writer.
    pub(crate) bare_engine: &'static str,
    /// Turns of each program.
    pub(crate) turns: usize,
    /// Duration of a turn.
    pub(crate) turn_s: f64,
    /// Time from sending an act until its receipt, one act after another.
    pub(crate) act: Spread,
    /// Time of a commit of one act by the bare writer.
    pub(crate) bare_commit: Spread,
    /// Time of `fdatasync` after a page was appended to a file.
    pub(crate) fdatasync: Spread,
    /// Outcomes of all requests.
    pub(crate) answers: Answers,
}

/// Measures the server, the bare writer and the disk of `dir` in turns.
pub(crate) async fn run(
    target: &Target,
    (place, tables, dir): (&BareLocation, Tables<'_>, &Path),
    (turns, turn): (usize, Duration),
    progress: &Progress,
) -> Result<Comparison, LoadError> {
    let tally = Arc::new(Tally::default());
    let games = games::create(target, &tally, 1, SEATS, ROUNDS_MAX, progress).await;
    let game = games::first(&games, &tally)?;
    let mut acts = 0;
    let mut connection = Connection::new(target);
    let mut bare = BareCommit::open(place, tables, 1, RECORD.to_owned()).await?;
    let failed = LoadError::of("a file cannot be written");
    let path = dir.join(format!("swarmbench-loadtest-{}.sync", std::process::id()));
    let mut file = File::create(&path).map_err(|error| failed(&error))?;
    let (act, bare_commit, fdatasync) = <(Latencies, Latencies, Latencies)>::default();
    let mut synced = Ok(());
    for place in 0..turns {
        progress("comparing acts alone", place as u64, turns as u64);
        let started = Instant::now();
        while started.elapsed() < turn {
            let (round, seat) = (acts / SEATS, acts % SEATS);
            let body = json!({ "round": round, "action": "SWITCH" }).to_string();
            let call = request(target, "POST", "/act", Some(&game.seats[seat]), Some(&body));
            let sent = Instant::now();
            if !connection.call(&tally, &call).await {
                break;
            }
            act.record([sent.elapsed()]);
            acts += 1;
        }
        let started = Instant::now();
        while started.elapsed() < turn {
            bare_commit.record([bare.run(1.0, Duration::ZERO).await?.elapsed]);
        }
        let started = Instant::now();
        while started.elapsed() < turn && synced.is_ok() {
            let begun = Instant::now();
            synced = file.write_all(&[0x5a; PAGE_BYTES]).and_then(|()| file.sync_data());
            fdatasync.record([begun.elapsed()]);
        }
    }
    bare.close().await?;
    drop(file);
    let removed = std::fs::remove_file(&path);
    synced.and(removed).map_err(|error| failed(&error))?;
    games::abort(target, &tally, &games, progress).await;
    Ok(Comparison {
        bare_engine: place.engine(),
        turns,
        turn_s: turn.as_secs_f64(),
        act: act.spread(),
        bare_commit: bare_commit.spread(),
        fdatasync: fdatasync.spread(),
        answers: tally.answers(),
    })
}
