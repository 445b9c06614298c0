//! Health, readiness, metrics.

use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use axum::Json;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use super::App;
use super::error::{ApiError, Code};
use crate::host::DiskSpace;
use crate::telemetry;

/// Health of the server.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub(super) struct Health {
    /// Always `ok`.
    status: &'static str,
    /// Version of the server.
    version: &'static str,
}

const OK: Health = Health { status: "ok", version: env!("CARGO_PKG_VERSION") };

/// Check that the process is alive.
#[utoipa::path(
    get,
    path = "/healthz",
    operation_id = "show_health",
    tag = "host",
    responses((status = 200, description = "The process is alive", body = Health))
)]
pub(super) async fn show_health() -> Json<Health> {
    Json(OK)
}

/// Check whether the server can be used.
///
/// The server can be used while the database answers, its files are where they were, no commit has failed or waits for long, the
/// time of day is certain, a server of a cluster has its lease, and the episodes that were running before a restart run again, except
/// those that take long to replay. Otherwise the detail names every problem.
#[utoipa::path(
    get,
    path = "/readyz",
    operation_id = "show_readiness",
    tag = "host",
    responses(
        (status = 200, description = "The server can be used", body = Health),
        (status = 503, description = "`unavailable`: the server cannot be used yet, or not any more; `overloaded`"),
    )
)]
pub(super) async fn show_readiness(State(app): State<App>) -> Result<Json<Health>, ApiError> {
    let problems = problems(&app);
    if problems.is_empty() {
        app.store.ping().await?;
        return Ok(Json(OK));
    }
    let error = ApiError::new(Code::Unavailable, problems.join("; "));
    Err(error.retry_after(Duration::from_secs(1)))
}

/// Problems that keep the server from being used, a short sentence each.
fn problems(app: &App) -> Vec<String> {
    let mut problems = Vec::new();
    if let Err(lost) = app.store.check_files() {
        problems.push(format!("{lost}: nothing is acknowledged any more"));
    }
    let writer = app.store.writer();
    if writer.has_failed() {
        problems.push(
            "a commit failed: nothing is acknowledged until the server is restarted".to_owned(),
        );
    }
    if app.forwarder.as_ref().is_some_and(|forwarder| forwarder.check_may_answer().is_err()) {
        problems.push(
            "the database was not reached for so long that other servers may have taken over what this one plays".to_owned(),
        );
    }
    problems.extend(writer.blocked().map(|blocked| blocked.to_string()));
    problems.extend(app.clock.doubt().map(|doubt| doubt.to_string()));
    if !app.ready.load(Ordering::Acquire) {
        problems.push("unfinished episodes are still being recovered".to_owned());
    }
    problems
}

/// Show metrics for Prometheus.
#[utoipa::path(
    get,
    path = "/metrics",
    operation_id = "show_metrics",
    tag = "host",
    responses((status = 200, description = "Metrics in the Prometheus text format", body = String, content_type = "text/plain"))
)]
pub(super) async fn show_metrics(State(app): State<App>) -> Response {
    // Gauges are of the process. Another server of it would set them before they are read.
    static SCRAPE: Mutex<()> = Mutex::new(());
    let _alone = SCRAPE.lock().unwrap_or_else(PoisonError::into_inner);
    #[expect(clippy::cast_precision_loss, reason = "a gauge is a double")]
    {
        metrics::gauge!("swarmbench_episodes_unfinished").set(app.registry.unfinished() as f64);
        metrics::gauge!("swarmbench_episodes_in_memory").set(app.registry.in_memory() as f64);
        metrics::gauge!("swarmbench_memory_reserved_bytes")
            .set(app.registry.budget().used() as f64);
        let writer = app.store.writer();
        metrics::gauge!("swarmbench_clock_in_doubt")
            .set(f64::from(u8::from(app.clock.doubt().is_some())));
        metrics::gauge!("swarmbench_backlog_jobs").set(writer.backlog_jobs() as f64);
        metrics::gauge!("swarmbench_backlog_bytes").set(writer.backlog_bytes() as f64);
        let (running, waiting) = app.workers.load();
        metrics::gauge!("swarmbench_heavy_running").set(running as f64);
        metrics::gauge!("swarmbench_heavy_waiting").set(waiting as f64);
    }
    if let Some(free) = app.disk.space().map(DiskSpace::free_percent) {
        metrics::gauge!("swarmbench_disk_free_percent").set(free);
    }
    let text = telemetry::render();
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], text).into_response()
}
