//! `POST /api/v1/competitions/{id}/attempts/{run}/void`.

use serde_json::json;

use super::super::prelude::*;
use crate::run::RunStatus;
use crate::store::competitions::Declared;
use crate::store::entries::Entry;
use swarmbench_protocol::competition::AttemptSummary;
use swarmbench_protocol::episode::VoidRequest;

/// Void an attempt after a fault of the server: it ends, does not count, and may be started again on the same seeds.
///
/// Doing it again changes nothing; the first reason stays.
#[utoipa::path(
    post,
    path = "/api/v1/competitions/{id}/attempts/{run}/void",
    operation_id = "void_attempt",
    tag = "competitions",
    params(
        ("id" = String, Path, description = "The competition's id"),
        ("run" = String, Path, description = "The id of the attempt's run"),
    ),
    request_body(content = VoidRequest, description = "At most 256 KiB"),
    security(("key" = [])),
    responses(
        (status = 200, description = "The attempt does not count", body = AttemptSummary),
        (status = 403, description = "`forbidden`: not an organizer's key"),
    )
)]
pub(in super::super) async fn void_attempt(
    State(app): State<App>,
    organizer: Organizer,
    Ids(id, run): Ids,
    _: Params<Nothing>,
    Json(VoidRequest { reason }, _): Json<VoidRequest>,
) -> Result<axum::Json<AttemptSummary>, ApiError> {
    let mut problems = Problems::default();
    problems.text("reason", &reason, app.limits.reason_chars_max);
    let reason = problems.none_or(Some(reason))?;
    App::run_detached(async move {
        let competition = app.stored_competition(&id).await?;
        let _lock = app.creations.lock(&format!("void {run}")).await;
        let attempts = app.store.attempts(competition.key, None).await?;
        let attempt = attempts.into_iter().find(|attempt| attempt.id == run);
        let attempt = attempt.ok_or_else(|| ApiError::not_found("the attempt"))?;
        if attempt.void_reason.is_none() {
            let detail = json!({ "competition": id, "attempt": attempt.number, "reason": reason });
            let at = app.clock.wall();
            let audit_entries = vec![
                Entry::VoidRun { run: attempt.run, reason, at },
                organizer.audit_entry(&app, "attempt.void", &run, detail),
            ];
            if !app.runs.end_with(attempt.run, RunStatus::Aborted, audit_entries.clone()).await? {
                app.store.keep(audit_entries).await?;
            }
        }
        let field = app.field(competition, Declared::Short).await?;
        let summary = field.summaries()?;
        let summary = summary.into_iter().find(|summary| summary.run == run);
        Ok(axum::Json(summary.ok_or_else(|| ApiError::not_found("the attempt"))?))
    })
    .await
}
