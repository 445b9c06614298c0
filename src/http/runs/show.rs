//! `GET /api/v1/runs/{id}`.

use axum::Json;

use super::super::prelude::*;
use swarmbench_protocol::run::RunDetail;

/// Show a run, its results and its games.
#[utoipa::path(
    get,
    path = "/api/v1/runs/{id}",
    operation_id = "show_run",
    tag = "runs",
    responses((status = 200, description = "The run", body = RunDetail))
)]
pub(in super::super) async fn show_run(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Json<RunDetail>, ApiError> {
    let known = app.known_run(&caller, &id).await?;
    let seeds = known.seeds(&app, &caller).await?;
    Ok(Json(app.run_detail(&caller, &known, seeds).await?))
}
