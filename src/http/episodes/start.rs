//! `POST /api/v1/episodes/{id}/start`.

use axum::Json;

use super::super::prelude::*;
use swarmbench_protocol::episode::EpisodeSummary;

/// Start an episode that was created with `"start": "manual"`.
///
/// Starting a running episode changes nothing.
#[utoipa::path(
    post,
    path = "/api/v1/episodes/{id}/start",
    operation_id = "start_episode",
    tag = "episodes",
    responses(
        (status = 200, description = "The running episode", body = EpisodeSummary),
        (status = 403, description = "`forbidden`: not the creator"),
        (status = 409, description = "`episode_over`; `seats_open`: some of its seats can still be claimed"),
    )
)]
pub(in super::super) async fn start_episode(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Json<EpisodeSummary>, ApiError> {
    let (handle, _) = app.owned(&caller, id).await?;
    let snapshot = handle.snapshot();
    if snapshot.status.is_over() {
        let error = ApiError::new(Code::EpisodeOver, "the episode has ended and cannot be started");
        return Err(error.at_round(snapshot.world.round()));
    }
    handle.start().await?;
    Ok(Json(app.summary(&caller, &handle.id).await?))
}
