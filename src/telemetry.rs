//! Logs and metrics.

use std::fmt::Debug;
use std::io::IsTerminal;
use std::sync::OnceLock;

use futures::future::{BoxFuture, FutureExt as _};
use metrics::{Counter, Histogram, counter, histogram};
use metrics_exporter_prometheus::{Matcher, PrometheusBuilder, PrometheusHandle};
use metrics_process::Collector;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tracing::field::Field;
use tracing::{Instrument as _, Span};
use tracing_subscriber::field::MakeExt as _;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::fmt::FormatFields;
use tracing_subscriber::fmt::format::{Writer, debug_fn};
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

use swarmbench_protocol::names::shown;

use crate::fair::Origin;

/// Spawns a part of a request with its log span, its party and its rank.
pub fn spawn<T: Send + 'static>(work: impl Future<Output = T> + Send + 'static) -> JoinHandle<T> {
    tokio::spawn(Origin::current().scope(work).in_current_span().boxed())
}

/// The task of some work panicked, or its runtime is shut down.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("a task was lost")]
pub struct Lost;

/// Runs work in a task of its own, so that it completes: a caller may be dropped at an `await`, as a handler is when its client
/// hangs up.
///
/// # Errors
///
/// The error of the work, or [`Lost`].
pub fn detached<T: Send + 'static, E: From<Lost> + Send + 'static>(
    work: impl Future<Output = Result<T, E>> + Send + 'static,
) -> impl Future<Output = Result<T, E>> + Send {
    let result = detached_by(&|task| drop(tokio::spawn(task)), work);
    async { result.await? }
}

/// Variant of [`detached`] in a task of `spawn`, for work with any result. The task starts at once: the returned future holds
/// its result alone, however large the work is.
///
/// # Errors
///
/// [`Lost`].
pub fn detached_by<T: Send + 'static, W: Future<Output = T> + Send + 'static>(
    spawn: &(dyn Fn(BoxFuture<'static, ()>) + Send + Sync),
    work: W,
) -> impl Future<Output = Result<T, Lost>> + Send + use<T, W> {
    let (done, result) = oneshot::channel();
    let task = async move { drop(done.send(work.await)) };
    spawn(Box::pin(Origin::current().scope(task).in_current_span()));
    async { result.await.map_err(|_| Lost) }
}

/// Spawns blocking work with the log span of the request. Party and rank are not inherited.
pub fn spawn_blocking<T: Send + 'static>(
    work: impl FnOnce() -> T + Send + 'static,
) -> JoinHandle<T> {
    let span = Span::current();
    tokio::task::spawn_blocking(move || span.in_scope(work))
}

/// Histogram buckets of durations.
const SECONDS: [f64; 12] =
    [0.000_5, 0.001, 0.002_5, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1.0, 5.0, 60.0];

/// Histogram buckets of cells in the observations written for a request.
const CELLS: [f64; 6] = [64.0, 1024.0, 8192.0, 32_768.0, 262_144.0, 2_097_152.0];

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum LogFormat {
    /// Lines of text, for people.
    #[default]
    Text,
    /// One JSON object per line, for programs.
    Json,
}

/// Starts logging to standard error. `RUST_LOG` sets the filter; the default is level info.
pub fn start_logs(format: LogFormat) {
    start_logs_of(format, "info");
}

/// Variant of [`start_logs`] with the default filter `usual`.
pub fn start_logs_of(format: LogFormat, usual: &str) {
    let asked = std::env::var("RUST_LOG").ok().filter(|asked| !asked.is_empty());
    let filter: Option<Targets> = asked.and_then(|asked| asked.parse().ok());
    let filter = filter.unwrap_or_else(|| usual.parse().expect("a filter"));
    // rmcp logs whole messages, which contain what agents see.
    let filter = filter.with_target("rmcp", LevelFilter::OFF);
    let layer = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        // The subscriber would panic if standard error had no reader.
        .log_internal_errors(false);
    let logs = tracing_subscriber::registry().with(filter);
    // Tests start logging several times in one process: only the first start has an effect.
    drop(match format {
        LogFormat::Text => logs.with(layer.fmt_fields(fields())).try_init(),
        LogFormat::Json => logs.with(layer.json().flatten_event(true)).try_init(),
    });
}

/// Formats the fields of a text log line. Values may be names or errors from clients: they are escaped, so that they cannot begin a
/// line or control the terminal.
fn fields() -> impl for<'w> FormatFields<'w> + Send + Sync + 'static {
    let field = |out: &mut Writer<'_>, field: &Field, value: &dyn Debug| {
        // Source locations, from libraries that use the `log` crate.
        if field.name().starts_with("log.") {
            return Ok(());
        }
        let value = format!("{value:?}");
        let value = shown(&value).replace('\n', "\\n");
        if field.name() == "message" {
            write!(out, "{value}")
        } else {
            write!(out, "{field}={value}")
        }
    };
    debug_fn(field).delimited(" ")
}

/// Metrics of this process, registered once.
pub fn metrics() -> &'static PrometheusHandle {
    static HANDLE: OnceLock<PrometheusHandle> = OnceLock::new();
    HANDLE.get_or_init(|| {
        let recorder = PrometheusBuilder::new()
            .set_buckets_for_metric(Matcher::Suffix("_seconds".to_owned()), &SECONDS)
            .and_then(|builder| {
                builder.set_buckets_for_metric(Matcher::Suffix("_cells".to_owned()), &CELLS)
            })
            .expect("the buckets are not empty")
            .build_recorder();
        let handle = recorder.handle();
        // A program that embeds the server may have installed a recorder, which stays.
        drop(metrics::set_global_recorder(recorder));
        describe();
        handle
    })
}

/// Metrics that change with every act or observation. Cached, as the look-up costs more than the change.
pub struct Frequent {
    pub acts_valid: Counter,
    pub acts_invalid: Counter,
    pub acts_of_clock: Counter,
    pub cells_async: Histogram,
    pub cells_worker: Histogram,
    pub commits: Counter,
    pub commit_entries: Counter,
    pub commit_seconds: Histogram,
}

/// Records a commit of this many entries.
pub fn note_commit(entries: usize, took: std::time::Duration) {
    let frequent = frequent();
    frequent.commits.increment(1);
    frequent.commit_seconds.record(took);
    frequent.commit_entries.increment(entries as u64);
}

/// Cached [`Frequent`] metrics.
pub fn frequent() -> &'static Frequent {
    static FREQUENT: OnceLock<Frequent> = OnceLock::new();
    FREQUENT.get_or_init(|| {
        metrics();
        Frequent {
            acts_valid: counter!("swarmbench_acts_total", "kind" => "valid"),
            acts_invalid: counter!("swarmbench_acts_total", "kind" => "invalid"),
            acts_of_clock: counter!("swarmbench_acts_total", "kind" => "clock"),
            cells_async: histogram!("swarmbench_look_cells", "thread" => "async"),
            cells_worker: histogram!("swarmbench_look_cells", "thread" => "worker"),
            commits: counter!("swarmbench_commits_total"),
            commit_entries: counter!("swarmbench_commit_entries_total"),
            commit_seconds: histogram!("swarmbench_commit_seconds"),
        }
    })
}

/// All metrics in the text format of Prometheus; metrics of the process are read now.
pub fn render() -> String {
    let handle = metrics();
    process().collect();
    handle.render()
}

/// Metrics of this process: memory, processor time, open files, threads.
fn process() -> &'static Collector {
    static PROCESS: OnceLock<Collector> = OnceLock::new();
    PROCESS.get_or_init(Collector::default)
}

fn describe() {
    process().describe();
    for &(name, description) in COUNTERS {
        metrics::describe_counter!(name, description);
    }
    for &(name, description) in GAUGES {
        metrics::describe_gauge!(name, description);
    }
    for &(name, description) in HISTOGRAMS {
        metrics::describe_histogram!(name, description);
    }
}

const COUNTERS: &[(&str, &str)] = &[
    ("swarmbench_episodes_created_total", "Episodes created."),
    ("swarmbench_episodes_ended_total", "Episodes ended, by status."),
    ("swarmbench_episodes_revived_total", "Episodes recovered after a fault."),
    ("swarmbench_runs_created_total", "Runs created."),
    ("swarmbench_runs_ended_total", "Runs ended, by status."),
    ("swarmbench_evictions_total", "Idle episodes evicted because others needed their memory."),
    ("swarmbench_memory_refusals_total", "Worlds and answers for which no memory was free."),
    ("swarmbench_jobs_refused_total", "Jobs that the database refused; all others were stored."),
    ("swarmbench_games_measured_total", "Games that were measured after their end."),
    ("swarmbench_begin_retries_total", "Retries for the database lock."),
    ("swarmbench_stopped_ms_total", "Time the process was stopped."),
    ("swarmbench_closing_failures_total", "Failed attempts to close a competition."),
    ("swarmbench_rate_limited_total", "Requests refused by a rate limit, by limit."),
    ("swarmbench_rounds_total", "Rounds resolved, by task."),
    ("swarmbench_acts_total", "Acts stored, by kind: valid, invalid, clock (a timeout)."),
    ("swarmbench_act_refusals_total", "Acts refused, by code."),
    ("swarmbench_commits_total", "Transactions committed."),
    ("swarmbench_commit_entries_total", "Journal entries committed."),
    ("swarmbench_commit_failures_total", "Transactions that failed because of the host."),
    ("swarmbench_http_requests_total", "Requests, by route, method and status."),
    ("swarmbench_connections_refused_total", "Connections refused, by limit."),
    ("swarmbench_connections_cut_total", "Connections timed out or evicted, by reason."),
    (
        "swarmbench_forwarded_total",
        "Requests forwarded to the server that plays what they are about.",
    ),
    (
        "swarmbench_cluster_requests_total",
        "Requests of clients about games and runs, by kind of client and by who answered: this server, or another one.",
    ),
    ("swarmbench_forwarded_again_total", "Forwarded requests that another server had to answer."),
    ("swarmbench_takeovers_total", "Dead servers whose work was taken over."),
    ("swarmbench_fenced_total", "1 once this server was excluded by others."),
    ("swarmbench_errors_total", "Answers with a status of 500 or above, by code."),
];

const GAUGES: &[(&str, &str)] = &[
    ("swarmbench_episodes_unfinished", "Episodes that have not ended."),
    ("swarmbench_episodes_in_memory", "Episodes in memory."),
    ("swarmbench_memory_reserved_bytes", "Reserved part of memory_bytes_max."),
    ("swarmbench_backlog_jobs", "Jobs that are queued for the writer."),
    ("swarmbench_database_lost", "1 once a database file was removed or replaced."),
    ("swarmbench_backlog_bytes", "Bytes of the jobs that are queued for the writer."),
    ("swarmbench_heavy_running", "Jobs of heavy work that run."),
    ("swarmbench_heavy_waiting", "Jobs of heavy work that wait."),
    ("swarmbench_clock_in_doubt", "1 while the time of day is in doubt."),
    ("swarmbench_disk_free_percent", "Free space of the database's disk, in percent."),
    ("swarmbench_waits", "Requests that wait for a new state."),
    ("swarmbench_connections", "Open connections."),
    ("swarmbench_nodes", "Servers on the same database."),
    ("swarmbench_places", "Games, runs and competitions that this server has taken."),
    ("swarmbench_lease_seconds", "For how long this server answers if it is not seen again."),
    ("swarmbench_clock_offset_seconds", "How far the clock is ahead of that of the database."),
];

const HISTOGRAMS: &[(&str, &str)] = &[
    ("swarmbench_heavy_seconds", "Duration of a job of heavy work, by kind."),
    ("swarmbench_look_cells", "Cells written for one request, by kind of thread."),
    ("swarmbench_commit_seconds", "Duration of a commit."),
    ("swarmbench_http_request_seconds", "Duration of a request, waits included."),
];

#[cfg(test)]
mod tests {
    use std::io::{Read as _, Seek as _};
    use std::sync::Arc;

    use tracing::{Dispatch, Metadata};

    use super::*;

    #[test]
    fn a_name_begins_no_line_of_the_log() {
        let mut file = Arc::new(tempfile::tempfile().expect("a file"));
        let logs = tracing_subscriber::fmt().fmt_fields(fields()).with_ansi(false);
        let logs = logs.with_writer(Arc::clone(&file)).finish();
        let name = "a\u{1b}[2J\u{202e}\n2026-01-01T00:00:00Z ERROR b";
        tracing::subscriber::with_default(logs, || {
            let _request = tracing::info_span!("request", id = name, who = %name).entered();
            tracing::warn!(%name, quoted = name, plain = ?"b", "of {name}");
        });
        let mut said = String::new();
        file.rewind().and_then(|()| file.read_to_string(&mut said)).expect("text");
        assert_eq!(said.matches('\n').count(), 1, "{said:?}");
        assert!(
            said.contains("plain=\"b\"") && said.contains(r"of a\u001b[2J\u202e\n2026"),
            "{said:?}"
        );
        assert!(!said.contains(['\u{1b}', '\u{202e}']), "{said:?}");
    }

    #[tokio::test]
    async fn parts_of_a_request_are_logged_within_it() {
        let logs = Dispatch::new(tracing_subscriber::registry());
        let _here = tracing::dispatcher::set_default(&logs);
        let name = |logs: &Dispatch| {
            let span = || Span::current().metadata().map(Metadata::name);
            tracing::dispatcher::with_default(logs, span)
        };
        let (task, thread) = {
            let _request = tracing::info_span!("request").entered();
            let there = logs.clone();
            (spawn(async move { name(&logs) }), spawn_blocking(move || name(&there)))
        };
        assert_eq!(task.await.expect("no panic"), Some("request"));
        assert_eq!(thread.await.expect("no panic"), Some("request"));
    }
}
