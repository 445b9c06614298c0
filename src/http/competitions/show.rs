//! `GET /api/v1/competitions/{id}`.

use axum::Json;

use super::super::prelude::*;
use super::shown;
use swarmbench_protocol::competition::Competition;

/// Show a competition; its seeds and salt only after its end.
#[utoipa::path(
    get,
    path = "/api/v1/competitions/{id}",
    operation_id = "show_competition",
    tag = "competitions",
    responses((status = 200, description = "The competition", body = Competition))
)]
pub(in super::super) async fn show_competition(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Json<Competition>, ApiError> {
    let stored = app.competition(&caller, &id).await?;
    Ok(Json(shown(&stored, app.clock.wall())))
}
