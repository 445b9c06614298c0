//! Ways to write a group of rows to PostgreSQL, by sqlx, each group one commit that is counted in a row of its writer: how long
//! this process works for a row, and how many rows a second become durable. The ways take turns, and the numbers are medians.
//!
//! ```sh
//! .ci/postgres cargo bench -p swarmbench-loadtest --bench postgres
//! .ci/postgres cargo bench -p swarmbench-loadtest --bench postgres -- fence     # what the fence costs, with more turns
//! ```

use std::fmt::Write as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustix::fd::OwnedFd;
use rustix::net::sockopt::set_tcp_nodelay;
use rustix::net::{AddressFamily, getpeername};
use rustix::process::{Pid, PidfdFlags, PidfdGetfdFlags, pidfd_getfd, pidfd_open};
use rustix::time::{ClockId, clock_gettime};
use sqlx::migrate::Migrator;
use sqlx::postgres::{PgArguments, PgBindIterExt as _, PgConnection};
use sqlx::{Arguments as _, AssertSqlSafe};
use swarmbench_loadtest::bare_commit::postgres::{APPEND, INCARNATION, Scratch};

type Error = Box<dyn std::error::Error + Send + Sync>;

/// In the order in which `binary` and `text` write them.
const ACT_COLUMNS: &str = "acts (episode, round, agent, waiting_for, source, at, record, brief)";
const ROUND_COLUMNS: &str = "rounds (episode, round, digest, score, head, at)";

const SEATS: usize = 12;
const EPISODES: usize = 128;
const TURNS: usize = 9;
/// Of the two ways that show what the fence costs: a few per cent need more of them.
const FENCE_TURNS: usize = 41;
const TURN: Duration = Duration::from_millis(300);

/// Rows of a group: of 13 twelve are acts.
const SIZES: [usize; 4] = [12, 52, 208, 832];

/// As long as a usual one, with something to escape.
const RECORD: &str = r#"{"action":"SWITCH","message":"\"on\" in the next round, all of us, please","valid":true,"source":"seat"}"#;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    /// An array a column, from a `Vec` a column.
    Vecs,
    /// An array a column, from an iterator a column.
    Iterators,
    /// An array a column, from iterators, in a buffer that is large enough from the start.
    Reserved,
    /// The same, and nothing says whether the writer still may: what the row in `nodes` costs.
    Unfenced,
    /// `COPY FROM STDIN (FORMAT binary)` for each table, in a transaction.
    CopyBinary,
    /// `COPY FROM STDIN` for each table, in a transaction.
    CopyText,
    /// A parameter a value, rows in `VALUES`.
    Values,
}

/// With sockets as sqlx 0.9.0 makes them, and with `TCP_NODELAY`.
const WAYS: [(Way, bool, &str); 9] = [
    (Way::Iterators, true, "arrays of iterators"),
    (Way::Iterators, false, "the same, socket of sqlx"),
    (Way::Reserved, true, "the same, reserved"),
    (Way::Vecs, true, "arrays of Vec"),
    (Way::Unfenced, true, "the same, without the fence"),
    (Way::CopyBinary, true, "COPY, binary"),
    (Way::CopyBinary, false, "the same, socket of sqlx"),
    (Way::CopyText, true, "COPY, text"),
    (Way::Values, true, "VALUES"),
];

struct ActRow<'r> {
    episode: i64,
    round: i32,
    agent: i16,
    waiting_for: i16,
    source: i16,
    at: i64,
    record: &'r str,
    brief: Option<&'r str>,
}

struct RoundRow<'r> {
    episode: i64,
    round: i32,
    digest: &'r [u8],
    score: f64,
    head: &'r [u8],
    at: i64,
}

/// What a turn took, by row.
#[derive(Clone, Copy)]
struct Sample {
    rows_per_s: f64,
    /// Values to bytes, without sending them.
    encode_us: f64,
    /// Processor time of this process.
    own_us: f64,
    /// Processor time of the process of PostgreSQL that serves the connection.
    server_us: f64,
}

fn main() -> Result<(), Error> {
    let Ok(url) = std::env::var("SWARMBENCH_TEST_DB") else {
        println!("NOT RUN: it needs a PostgreSQL in SWARMBENCH_TEST_DB (.ci/postgres)");
        return Ok(());
    };
    let is_about_fence = std::env::args().any(|argument| argument == "fence");
    let of_fence = |(way, ..): &(Way, bool, &str)| matches!(way, Way::Vecs | Way::Unfenced);
    let (ways, turns) = if is_about_fence {
        (WAYS.into_iter().filter(of_fence).collect(), FENCE_TURNS)
    } else {
        (WAYS.to_vec(), TURNS)
    };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(compare(&url, &ways, turns))
}

/// The server's tables.
async fn tables() -> Result<Migrator, Error> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../migrations/postgres");
    Ok(Migrator::new(std::path::Path::new(folder)).await?)
}

async fn compare(url: &str, ways: &[(Way, bool, &str)], turns: usize) -> Result<(), Error> {
    let (scratch, connection) = Scratch::create(url, &tables().await?).await?;
    let mut writer = Writer { connection, committed: 0, acts: 0 };
    let pid = Pid::from_raw(std::process::id().cast_signed()).expect("it is not 0");
    let own = pidfd_open(pid, PidfdFlags::empty())?;
    let sockets = sockets(&own);
    println!(
        "| rows | way | encoding, µs a row | this process, µs a row | PostgreSQL, µs a row | rows/s | by the first |"
    );
    println!("| ---: | --- | ---: | ---: | ---: | ---: | ---: |");
    for size in SIZES {
        let mut samples: Vec<Vec<Sample>> = vec![Vec::new(); ways.len()];
        for turn in 0..=turns {
            for place in 0..ways.len() {
                // Whoever comes after a slow one differs from turn to turn.
                let place = (place + turn) % ways.len();
                let (way, nodelay, _) = ways[place];
                for socket in &sockets {
                    set_tcp_nodelay(socket, nodelay)?;
                }
                let sample = writer.turn(way, size).await?;
                // The first turn prepares statements.
                if turn > 0 {
                    samples[place].push(sample);
                }
            }
        }
        for ((_, _, name), own) in ways.iter().zip(&samples) {
            let of = |value: fn(&Sample) -> f64| median(own.iter().map(value).collect());
            let ratios = own.iter().zip(&samples[0]).map(|(a, b)| a.rows_per_s / b.rows_per_s);
            println!(
                "| {size} | {name} | {:.2} | {:.2} | {:.2} | {:.0} | {:.2} |",
                of(|sample| sample.encode_us),
                of(|sample| sample.own_us),
                of(|sample| sample.server_us),
                of(|sample| sample.rows_per_s),
                median(ratios.collect())
            );
        }
    }
    drop(writer);
    scratch.remove().await?;
    Ok(())
}

struct Writer {
    connection: PgConnection,
    committed: i64,
    acts: usize,
}

impl Writer {
    async fn turn(&mut self, way: Way, size: usize) -> Result<Sample, Error> {
        // All ways begin with the same tables.
        sqlx::raw_sql("TRUNCATE acts, rounds").execute(&mut self.connection).await?;
        let pid = sqlx::query_scalar("SELECT pg_backend_pid()");
        let pid: i32 = pid.fetch_one(&mut self.connection).await?;
        self.acts = 0;
        let values = Arc::new(values(size));
        let (mut rows, mut encoding) = (0, Duration::ZERO);
        let (own, server, started) = (own_time(), time_of(pid), Instant::now());
        let elapsed = loop {
            let acts = size * 12 / 13 + usize::from(size < 13);
            let (acts, rounds) = group(self.acts, acts);
            self.acts += acts.len();
            rows += acts.len() + rounds.len();
            encoding += self.write(way, &acts, &rounds, &values).await?;
            let elapsed = started.elapsed();
            if elapsed >= TURN {
                break elapsed;
            }
        };
        let us = |time: Duration| {
            time.as_secs_f64() * 1e6 / f64::from(u32::try_from(rows).unwrap_or(u32::MAX))
        };
        Ok(Sample {
            rows_per_s: 1e6 / us(elapsed),
            encode_us: us(encoding),
            own_us: us(own_time().saturating_sub(own)),
            server_us: us(time_of(pid).saturating_sub(server)),
        })
    }

    /// Commits rows; how long they took to be encoded.
    async fn write(
        &mut self,
        way: Way,
        acts: &[ActRow<'_>],
        rounds: &[RoundRow<'_>],
        values: &Arc<String>,
    ) -> Result<Duration, Error> {
        let started = Instant::now();
        let is_copy = matches!(way, Way::CopyBinary | Way::CopyText);
        if is_copy {
            let [acts, rounds] =
                if way == Way::CopyBinary { binary(acts, rounds) } else { text(acts, rounds) };
            let encoded = started.elapsed();
            let format = if way == Way::CopyBinary { " (FORMAT binary)" } else { "" };
            let begin = format!(
                "BEGIN; UPDATE nodes SET committed = committed + 1 WHERE incarnation = {INCARNATION} AND committed = {}",
                self.committed
            );
            sqlx::raw_sql(AssertSqlSafe(begin)).execute(&mut self.connection).await?;
            for (columns, rows) in [(ACT_COLUMNS, acts), (ROUND_COLUMNS, rounds)] {
                if !rows.is_empty() {
                    let copy = format!("COPY {columns} FROM STDIN{format}");
                    let mut copy = self.connection.copy_in_raw(&copy).await?;
                    copy.send(rows).await?;
                    copy.finish().await?;
                }
            }
            sqlx::raw_sql("COMMIT").execute(&mut self.connection).await?;
            self.committed += 1;
            return Ok(encoded);
        }
        let mut arguments = PgArguments::default();
        if way == Way::Reserved {
            let bytes: usize = acts.iter().map(|act| 64 + act.record.len()).sum();
            arguments.reserve(16, bytes + rounds.len() * 136 + 400);
        }
        arguments.add(INCARNATION)?;
        arguments.add(self.committed)?;
        match way {
            Way::Vecs | Way::Unfenced => add_vecs(&mut arguments, acts, rounds)?,
            Way::Iterators | Way::Reserved => add_iterators(&mut arguments, acts, rounds)?,
            Way::Values => add_values(&mut arguments, acts, rounds)?,
            Way::CopyBinary | Way::CopyText => unreachable!("they are above"),
        }
        let encoded = started.elapsed();
        let counted: i64 = if way == Way::Values {
            let insert = sqlx::query_scalar_with(AssertSqlSafe(Arc::clone(values)), arguments);
            insert.fetch_one(&mut self.connection).await?
        } else if way == Way::Unfenced {
            let insert = sqlx::query_scalar_with(AssertSqlSafe(unfenced()), arguments);
            let counted = insert.fetch_one(&mut self.connection).await?;
            // Nothing was counted.
            self.committed -= 1;
            counted
        } else {
            sqlx::query_scalar_with(APPEND, arguments).fetch_one(&mut self.connection).await?
        };
        assert_eq!(counted, 1);
        self.committed += 1;
        Ok(encoded)
    }
}

/// The statement that appends, without its condition. The first two values are not used.
fn unfenced() -> String {
    let (_, inserts) = APPEND.split_once("RETURNING 1),").expect("it begins with the fence");
    let inserts = inserts.replace("FROM me, unnest", "FROM unnest");
    let inserts = inserts.replace("SELECT count(*) FROM me", "SELECT CAST(1 AS bigint)");
    format!("WITH {inserts}")
}

/// The next rows, in the order in which a server stores episodes that are played side by side.
fn group(first: usize, acts: usize) -> (Vec<ActRow<'static>>, Vec<RoundRow<'static>>) {
    let small = |count: usize| i16::try_from(count).expect("a small number");
    let place = |round: usize| {
        let number = |count: usize| i32::try_from(count).expect("a turn is short");
        (i64::from(number(round % EPISODES)), number(round / EPISODES))
    };
    let of_acts = (first..first + acts).map(|act| {
        let (episode, round) = place(act / SEATS);
        ActRow {
            episode,
            round,
            agent: small(act % SEATS),
            waiting_for: small(SEATS - 1 - act % SEATS),
            source: 0,
            at: 1_700_000_000_000,
            record: RECORD,
            brief: None,
        }
    });
    // A group of 12 has no round.
    let completed = if acts < 13 { 0..0 } else { first / SEATS..(first + acts) / SEATS };
    let of_rounds = completed.map(|round| {
        let (episode, round) = place(round);
        RoundRow {
            episode,
            round,
            digest: &[0xa5; 32],
            score: 1.5,
            head: &[0x5a; 32],
            at: 1_700_000_000_000,
        }
    });
    (of_acts.collect(), of_rounds.collect())
}

fn add_vecs(
    to: &mut PgArguments,
    acts: &[ActRow<'_>],
    rounds: &[RoundRow<'_>],
) -> Result<(), Error> {
    to.add(acts.iter().map(|act| act.episode).collect::<Vec<_>>())?;
    to.add(acts.iter().map(|act| act.round).collect::<Vec<_>>())?;
    to.add(acts.iter().map(|act| act.agent).collect::<Vec<_>>())?;
    to.add(acts.iter().map(|act| act.waiting_for).collect::<Vec<_>>())?;
    to.add(acts.iter().map(|act| act.source).collect::<Vec<_>>())?;
    to.add(acts.iter().map(|act| act.at).collect::<Vec<_>>())?;
    to.add(acts.iter().map(|act| act.record).collect::<Vec<&str>>())?;
    to.add(acts.iter().map(|act| act.brief).collect::<Vec<Option<&str>>>())?;
    to.add(rounds.iter().map(|round| round.episode).collect::<Vec<_>>())?;
    to.add(rounds.iter().map(|round| round.round).collect::<Vec<_>>())?;
    to.add(rounds.iter().map(|round| round.digest).collect::<Vec<&[u8]>>())?;
    to.add(rounds.iter().map(|round| round.score).collect::<Vec<_>>())?;
    to.add(rounds.iter().map(|round| round.head).collect::<Vec<&[u8]>>())?;
    to.add(rounds.iter().map(|round| round.at).collect::<Vec<_>>())
}

fn add_iterators(
    to: &mut PgArguments,
    acts: &[ActRow<'_>],
    rounds: &[RoundRow<'_>],
) -> Result<(), Error> {
    to.add(acts.iter().map(|act| act.episode).bind_iter())?;
    to.add(acts.iter().map(|act| act.round).bind_iter())?;
    to.add(acts.iter().map(|act| act.agent).bind_iter())?;
    to.add(acts.iter().map(|act| act.waiting_for).bind_iter())?;
    to.add(acts.iter().map(|act| act.source).bind_iter())?;
    to.add(acts.iter().map(|act| act.at).bind_iter())?;
    to.add(acts.iter().map(|act| act.record).bind_iter())?;
    to.add(acts.iter().map(|act| act.brief).bind_iter())?;
    to.add(rounds.iter().map(|round| round.episode).bind_iter())?;
    to.add(rounds.iter().map(|round| round.round).bind_iter())?;
    to.add(rounds.iter().map(|round| round.digest).bind_iter())?;
    to.add(rounds.iter().map(|round| round.score).bind_iter())?;
    to.add(rounds.iter().map(|round| round.head).bind_iter())?;
    to.add(rounds.iter().map(|round| round.at).bind_iter())
}

fn add_values(
    to: &mut PgArguments,
    acts: &[ActRow<'_>],
    rounds: &[RoundRow<'_>],
) -> Result<(), Error> {
    for act in acts {
        to.add(act.episode)?;
        to.add(act.round)?;
        to.add(act.agent)?;
        to.add(act.waiting_for)?;
        to.add(act.source)?;
        to.add(act.at)?;
        to.add(act.record)?;
        to.add(act.brief)?;
    }
    for round in rounds {
        to.add(round.episode)?;
        to.add(round.round)?;
        to.add(round.digest)?;
        to.add(round.score)?;
        to.add(round.head)?;
        to.add(round.at)?;
    }
    Ok(())
}

/// The statement of [`Way::Values`]. Each size is a statement, which a server with groups of all sizes could not prepare.
fn values(size: usize) -> String {
    let acts = size * 12 / 13 + usize::from(size < 13);
    let mut next = 2;
    let mut rows = |rows: usize, types: &[&str]| {
        let mut text = String::new();
        for row in 0..rows {
            text.push_str(if row == 0 { "(" } else { ", (" });
            for (place, kind) in types.iter().enumerate() {
                next += 1;
                let comma = if place == 0 { "" } else { ", " };
                // The first row says what the parameters of all are.
                let kind = if row == 0 { format!("::{kind}") } else { String::new() };
                write!(text, "{comma}${next}{kind}").expect("to memory");
            }
            text.push(')');
        }
        text
    };
    let of_acts = rows(
        acts,
        &["bigint", "integer", "smallint", "smallint", "smallint", "bigint", "text", "text"],
    );
    let of_rounds =
        rows(size - acts, &["bigint", "integer", "bytea", "double precision", "bytea", "bigint"]);
    let mut text = format!(
        "WITH me AS (UPDATE nodes SET committed = committed + 1 WHERE incarnation = $1 AND committed = $2 RETURNING 1),
         a AS (INSERT INTO acts (episode, round, agent, waiting_for, source, at, record, brief)
               SELECT t.* FROM me, (VALUES {of_acts}) AS t)"
    );
    if !of_rounds.is_empty() {
        write!(
            text,
            ", r AS (INSERT INTO rounds (episode, round, digest, score, head, at)
               SELECT t.* FROM me, (VALUES {of_rounds}) AS t)"
        )
        .expect("to memory");
    }
    text + " SELECT count(*) FROM me"
}

/// Rows of `acts` and of `rounds` as `COPY` takes them.
fn binary(acts: &[ActRow<'_>], rounds: &[RoundRow<'_>]) -> [Vec<u8>; 2] {
    fn value(to: &mut Vec<u8>, bytes: &[u8]) {
        to.extend(u32::try_from(bytes.len()).expect("a small value").to_be_bytes());
        to.extend(bytes);
    }
    let begin = |bytes: usize| {
        let mut to = Vec::with_capacity(bytes + 32);
        to.extend(b"PGCOPY\n\xff\r\n\0\0\0\0\0\0\0\0\0");
        to
    };
    let mut of_acts = begin(acts.iter().map(|act| 64 + act.record.len()).sum());
    for act in acts {
        of_acts.extend(8_i16.to_be_bytes());
        value(&mut of_acts, &act.episode.to_be_bytes());
        value(&mut of_acts, &act.round.to_be_bytes());
        value(&mut of_acts, &act.agent.to_be_bytes());
        value(&mut of_acts, &act.waiting_for.to_be_bytes());
        value(&mut of_acts, &act.source.to_be_bytes());
        value(&mut of_acts, &act.at.to_be_bytes());
        value(&mut of_acts, act.record.as_bytes());
        match act.brief {
            Some(brief) => value(&mut of_acts, brief.as_bytes()),
            None => of_acts.extend((-1_i32).to_be_bytes()),
        }
    }
    of_acts.extend((-1_i16).to_be_bytes());
    if rounds.is_empty() {
        return [of_acts, Vec::new()];
    }
    let mut of_rounds = begin(rounds.len() * 128);
    for round in rounds {
        of_rounds.extend(6_i16.to_be_bytes());
        value(&mut of_rounds, &round.episode.to_be_bytes());
        value(&mut of_rounds, &round.round.to_be_bytes());
        value(&mut of_rounds, round.digest);
        value(&mut of_rounds, &round.score.to_be_bytes());
        value(&mut of_rounds, round.head);
        value(&mut of_rounds, &round.at.to_be_bytes());
    }
    of_rounds.extend((-1_i16).to_be_bytes());
    [of_acts, of_rounds]
}

fn text(acts: &[ActRow<'_>], rounds: &[RoundRow<'_>]) -> [Vec<u8>; 2] {
    fn escaped(to: &mut String, text: &str) {
        let mut rest = text;
        while let Some(place) = rest.find(['\\', '\n', '\r', '\t']) {
            to.push_str(&rest[..place]);
            to.push_str(match rest.as_bytes()[place] {
                b'\n' => "\\n",
                b'\r' => "\\r",
                b'\t' => "\\t",
                _ => "\\\\",
            });
            rest = &rest[place + 1..];
        }
        to.push_str(rest);
    }
    fn hex(to: &mut String, bytes: &[u8]) {
        to.push_str("\\\\x");
        for byte in bytes {
            for digit in [byte >> 4, byte & 15] {
                to.push(char::from(b"0123456789abcdef"[usize::from(digit)]));
            }
        }
    }
    let mut of_acts = String::with_capacity(acts.len() * (RECORD.len() + 64));
    for act in acts {
        let ActRow { episode, round, agent, waiting_for, source, at, record, brief } = act;
        write!(of_acts, "{episode}\t{round}\t{agent}\t{waiting_for}\t{source}\t{at}\t")
            .expect("to memory");
        escaped(&mut of_acts, record);
        of_acts.push('\t');
        match brief {
            Some(brief) => escaped(&mut of_acts, brief),
            None => of_acts.push_str("\\N"),
        }
        of_acts.push('\n');
    }
    let mut of_rounds = String::with_capacity(rounds.len() * 200);
    for round in rounds {
        write!(of_rounds, "{}\t{}\t", round.episode, round.round).expect("to memory");
        hex(&mut of_rounds, round.digest);
        write!(of_rounds, "\t{}\t", round.score).expect("to memory");
        hex(&mut of_rounds, round.head);
        writeln!(of_rounds, "\t{}", round.at).expect("to memory");
    }
    [of_acts.into_bytes(), of_rounds.into_bytes()]
}

/// The connections of this process. sqlx does not give them away, and 0.9.0 has no setting for them.
fn sockets(own: &OwnedFd) -> Vec<OwnedFd> {
    let fds = std::fs::read_dir("/proc/self/fd").into_iter().flatten().flatten();
    fds.filter_map(|fd| fd.file_name().to_str()?.parse().ok())
        .filter_map(|fd| pidfd_getfd(own, fd, PidfdGetfdFlags::empty()).ok())
        .filter(|fd| matches!(getpeername(fd), Ok(Some(peer)) if peer.address_family() == AddressFamily::INET))
        .collect()
}

/// Processor time of this process so far.
fn own_time() -> Duration {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    Duration::try_from(time).unwrap_or_default()
}

/// Processor time of a process of this machine so far, where the system tells; else 0.
fn time_of(pid: i32) -> Duration {
    let text = std::fs::read_to_string(format!("/proc/{pid}/schedstat")).unwrap_or_default();
    let ns = text.split(' ').next().and_then(|ns| ns.parse().ok());
    Duration::from_nanos(ns.unwrap_or_default())
}

fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[numbers.len() / 2]
}
