//! `GET /api/v1/imports/{id}`.

use axum::Json;

use super::super::prelude::*;
use swarmbench_protocol::import::ImportSummary;

/// Show an imported game.
#[utoipa::path(
    get,
    path = "/api/v1/imports/{id}",
    operation_id = "show_import",
    tag = "data",
    responses((status = 200, description = "The game", body = ImportSummary))
)]
pub(in super::super) async fn show_import(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Json<ImportSummary>, ApiError> {
    Ok(Json(app.import(&caller, &id).await?.into()))
}
