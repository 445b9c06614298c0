//! `DELETE /api/v1/runs/{id}`.

use axum::Json;

use super::super::prelude::*;
use crate::run::RunStatus;
use crate::store::runs::StoredRun;
use swarmbench_protocol::run::RunDetail;

/// Abort a run and its open games; games that were played stay, and count.
///
/// Aborting an aborted run changes nothing.
#[utoipa::path(
    delete,
    path = "/api/v1/runs/{id}",
    operation_id = "abort_run",
    tag = "runs",
    responses(
        (status = 200, description = "The aborted run", body = RunDetail),
        (status = 403, description = "`forbidden`: not the creator; only an organizer ends an attempt in a competition"),
        (status = 409, description = "`episode_over`: the run has ended in another way"),
    )
)]
pub(in super::super) async fn abort_run(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Json<RunDetail>, ApiError> {
    caller.check_not_judge()?;
    let known = app.known_run(&caller, &id).await?;
    let is_attempt = known.stored.attempt.is_some();
    if !caller.owns(known.subject()) || (is_attempt && !caller.is_organizer()) {
        let detail = if is_attempt {
            "only an organizer ends an attempt in a competition"
        } else {
            "only the creator of a run may do this: send its swarm token, or the key with which it was created"
        };
        return Err(ApiError::new(Code::Forbidden, detail));
    }
    detached(async move {
        let run = known.stored.run;
        let at = app.clock.wall();
        let StoredRun { owner, competition, .. } = known.stored;
        let detail = app.detail_of_run(&known.stored).await?;
        let audit_entry = caller.audit_foreign(owner, at, "run.abort", &id, detail, competition);
        app.runs.end_with(run, RunStatus::Aborted, audit_entry.into_iter().collect()).await?;
        let known = app.known_run(&caller, &id).await?;
        if known.stored.status != RunStatus::Aborted.name() {
            let detail = format!("the run has ended already, as {}", known.stored.status);
            return Err(ApiError::new(Code::EpisodeOver, detail));
        }
        Ok(Json(app.run_detail(&caller, &known, known.open_seeds(&app, &caller)).await?))
    })
    .await
}
