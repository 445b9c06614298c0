//! `GET /api/v1/episodes/{id}`.

use axum::Json;

use super::super::prelude::*;
use swarmbench_protocol::episode::EpisodeSummary;

/// Show an episode.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}",
    operation_id = "show_episode",
    tag = "episodes",
    responses((status = 200, description = "The episode", body = EpisodeSummary))
)]
pub(in super::super) async fn show_episode(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Json<EpisodeSummary>, ApiError> {
    let (stored, spec) = app.known_episode(&caller, id).await?;
    let permit = app.permit_of_game(&caller, &stored, &spec).await?;
    Ok(Json(app.summary_of(&caller, &stored, &spec, permit)?))
}
