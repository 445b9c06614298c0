//! `DELETE /api/v1/episodes/{id}`.

use axum::Json;
use serde_json::json;

use super::super::prelude::*;
use crate::episode::Status;
use crate::episode::spec::Visibility;
use swarmbench_protocol::episode::EpisodeSummary;

/// Abort an episode; the journal keeps the rounds that were played.
///
/// Aborting an aborted episode changes nothing.
#[utoipa::path(
    delete,
    path = "/api/v1/episodes/{id}",
    operation_id = "abort_episode",
    tag = "episodes",
    responses(
        (status = 200, description = "The aborted episode", body = EpisodeSummary),
        (status = 403, description = "`forbidden`: not the creator"),
        (status = 409, description = "`episode_over`: the episode has ended in another way"),
    )
)]
pub(in super::super) async fn abort_episode(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Json<EpisodeSummary>, ApiError> {
    let (handle, stored) = app.owned(&caller, id).await?;
    let owner = handle.owner.filter(|_| handle.spec.visibility != Visibility::Sealed);
    let now = app.clock.wall();
    let competition = app.competition_of_game(stored.run).await?;
    let subject = handle.id.as_str();
    let audit_entry =
        caller.audit_foreign(owner, now, "episode.abort", subject, json!({}), competition);
    handle.abort_with(audit_entry.into_iter().collect()).await?;
    let snapshot = handle.snapshot();
    if snapshot.status != Status::Aborted {
        let detail = format!("the episode has ended already, as {}", snapshot.status.name());
        return Err(ApiError::new(Code::EpisodeOver, detail).at_round(snapshot.world.round()));
    }
    Ok(Json(app.summary(&caller, &handle.id).await?))
}
