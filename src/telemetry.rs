//! Logs and metrics.

use std::io::IsTerminal;
use std::sync::OnceLock;

use metrics_exporter_prometheus::{Matcher, PrometheusBuilder, PrometheusHandle};
use metrics_process::Collector;
use tokio::task::JoinHandle;
use tracing::{Instrument as _, Span};

use crate::fair;

/// Runs a part of a request in a task of its own, whose log lines have the request's id as well.
/// It has the party and rank of the request.
pub fn spawn<T: Send + 'static>(work: impl Future<Output = T> + Send + 'static) -> JoinHandle<T> {
    tokio::spawn(fair::inherit(work).in_current_span())
}

/// The same for work that keeps a thread busy.
pub fn spawn_blocking<T: Send + 'static>(
    work: impl FnOnce() -> T + Send + 'static,
) -> JoinHandle<T> {
    let span = Span::current();
    tokio::task::spawn_blocking(move || span.in_scope(work))
}

/// Buckets of durations, in seconds.
const SECONDS: [f64; 12] =
    [0.000_5, 0.001, 0.002_5, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1.0, 5.0, 60.0];

/// Buckets of cells that are written for a request.
const CELLS: [f64; 6] = [64.0, 1024.0, 8192.0, 32_768.0, 262_144.0, 2_097_152.0];

/// How logs are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// For people.
    #[default]
    Text,
    /// One JSON object a line, for programs.
    Json,
}

/// Starts writing logs to the standard error. `RUST_LOG` says which, by default those of level info.
pub fn start_logs(format: LogFormat) {
    start_logs_of(format, "info");
}

/// Starts writing logs as [`start_logs`] does, where `RUST_LOG` is silent those that match `usual`.
pub fn start_logs_of(format: LogFormat, usual: &str) {
    use tracing_subscriber::{EnvFilter, fmt};
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(usual));
    let colors = std::io::stderr().is_terminal();
    let builder = fmt().with_env_filter(filter).with_writer(std::io::stderr).with_ansi(colors);
    // A second start in one process, as tests do, leaves the first.
    drop(match format {
        LogFormat::Text => builder.try_init(),
        LogFormat::Json => builder.json().flatten_event(true).try_init(),
    });
}

/// The metrics of this process, described once.
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
        // Another recorder, of a program that embeds this one, would continue counting.
        drop(metrics::set_global_recorder(recorder));
        describe();
        handle
    })
}

/// All metrics in the text format of Prometheus, those of the process read at this moment.
#[must_use]
pub fn render() -> String {
    let handle = metrics();
    process().collect();
    handle.render()
}

/// What the host knows of this process: memory, time on the processors, open files, threads.
fn process() -> &'static Collector {
    static PROCESS: OnceLock<Collector> = OnceLock::new();
    PROCESS.get_or_init(Collector::default)
}

fn describe() {
    use metrics::{describe_counter, describe_gauge, describe_histogram};
    process().describe();
    describe_counter!("swarmbench_episodes_created_total", "Episodes created.");
    describe_counter!("swarmbench_episodes_ended_total", "Episodes ended, by status.");
    describe_counter!(
        "swarmbench_episodes_revived_total",
        "Episodes recovered from the journal as their actor had ended by a fault."
    );
    describe_counter!("swarmbench_runs_created_total", "Runs created.");
    describe_counter!("swarmbench_runs_ended_total", "Runs ended, by status.");
    describe_gauge!("swarmbench_episodes_unfinished", "Episodes that have not ended.");
    describe_gauge!("swarmbench_episodes_in_memory", "Episodes in memory.");
    describe_gauge!(
        "swarmbench_memory_reserved_bytes",
        "Memory of worlds and large answers, of memory_bytes_max."
    );
    describe_counter!(
        "swarmbench_evictions_total",
        "Idle episodes that left memory because others needed it."
    );
    describe_counter!(
        "swarmbench_memory_refusals_total",
        "Worlds and answers for which no memory was free."
    );
    describe_gauge!("swarmbench_backlog_jobs", "Jobs that are queued for the writer.");
    describe_gauge!(
        "swarmbench_database_lost",
        "1 once a file of the database was removed, renamed or replaced under the server."
    );
    describe_gauge!(
        "swarmbench_backlog_bytes",
        "Bytes of the jobs that are queued for the writer."
    );
    describe_counter!(
        "swarmbench_jobs_refused_total",
        "Jobs that the database refused; all others were kept."
    );
    describe_counter!(
        "swarmbench_begin_retries_total",
        "Tries to begin a transaction while another program held the lock of the database."
    );
    describe_gauge!("swarmbench_heavy_running", "Pieces of heavy work that are being done.");
    describe_gauge!("swarmbench_heavy_waiting", "Pieces of heavy work that wait for their turn.");
    describe_histogram!(
        "swarmbench_heavy_seconds",
        "How long a piece of heavy work takes, by kind."
    );
    describe_histogram!(
        "swarmbench_look_cells",
        "Cells of observations that are written for one request, by thread: async, worker."
    );
    describe_gauge!(
        "swarmbench_clock_in_doubt",
        "1 as long as the time of day is in doubt, and nothing irreversible happens because of it."
    );
    describe_counter!(
        "swarmbench_stopped_ms_total",
        "Milliseconds in which the process did not run, and no player's clock."
    );
    describe_counter!(
        "swarmbench_closing_failures_total",
        "Competitions that could not be closed, by try."
    );
    describe_gauge!("swarmbench_disk_free_percent", "How much of the database's disk is free.");
    describe_counter!(
        "swarmbench_rate_limited_total",
        "Requests refused for their number, by limit."
    );
    describe_counter!("swarmbench_rounds_total", "Rounds resolved, by task.");
    describe_counter!(
        "swarmbench_acts_total",
        "Acts kept, by kind: valid, invalid (a language model's answer that was none), clock (ran out)."
    );
    describe_counter!("swarmbench_act_refusals_total", "Acts refused, by code.");
    describe_gauge!("swarmbench_waits", "Requests that wait for something to happen.");
    describe_counter!("swarmbench_commits_total", "Transactions committed.");
    describe_counter!("swarmbench_commit_entries_total", "Journal entries committed.");
    describe_counter!(
        "swarmbench_commit_failures_total",
        "Transactions that failed: the host's fault."
    );
    describe_histogram!("swarmbench_commit_seconds", "How long a commit takes.");
    describe_counter!("swarmbench_http_requests_total", "Requests, by route, method and status.");
    describe_histogram!(
        "swarmbench_http_request_seconds",
        "How long a request takes, waits included."
    );
    describe_gauge!("swarmbench_connections", "Open connections.");
    describe_counter!(
        "swarmbench_connections_refused_total",
        "Connections for which there was no place, by reason: server, address."
    );
    describe_counter!(
        "swarmbench_connections_cut_total",
        "Connections ended as a part took too long, by reason: head, body, idle, write; or to make room for another client: room."
    );
    describe_counter!("swarmbench_errors_total", "Answers with a status of 500 or above, by code.");
}

#[cfg(test)]
mod tests {
    use tracing::{Dispatch, Metadata};

    use super::*;

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
