//! `POST /api/v1/episodes/{id}/void`.

use axum::Json as JsonBody;
use serde_json::json;

use super::super::checks::checked_reason;
use super::super::prelude::*;
use crate::ids::EpisodeId;
use crate::keys::Key;
use crate::store::entries::{AuditRow, Entry};
use swarmbench_protocol::episode::{EpisodeSummary, VoidRequest};

/// Void an episode after a fault of the server: it counts nowhere.
///
/// An episode that has not ended is aborted. While its run is running, the game is played again. Voiding an episode again
/// changes nothing.
#[utoipa::path(
    post,
    path = "/api/v1/episodes/{id}/void",
    operation_id = "void_episode",
    tag = "episodes",
    request_body(content = VoidRequest, description = "At most 256 KiB"),
    responses(
        (status = 200, description = "The episode, which counts nowhere", body = EpisodeSummary),
        (status = 403, description = "`forbidden`: not an organizer's key"),
    )
)]
pub(in super::super) async fn void_episode(
    State(app): State<App>,
    Organizer { key }: Organizer,
    Id(id): Id,
    _: Params<Nothing>,
    Json(VoidRequest { reason }, _): Json<VoidRequest>,
) -> Result<JsonBody<EpisodeSummary>, ApiError> {
    let reason = checked_reason(&app, reason)?;
    detached(async move { void(&app, key, id, reason).await }).await
}

async fn void(
    app: &App,
    key: Key,
    id: String,
    reason: String,
) -> Result<JsonBody<EpisodeSummary>, ApiError> {
    let id = EpisodeId::from_text(id);
    let stored = app.store.find_summary(&id).await?;
    let stored = stored.ok_or_else(|| ApiError::not_found("the episode"))?;
    if stored.void_reason.is_none() {
        let at = app.clock.wall();
        let competition = app.competition_of_game(stored.run).await?;
        let detail = json!({ "reason": reason });
        let audit = AuditRow {
            at,
            who: key.id.clone(),
            action: "episode.void",
            subject: id.to_string(),
            shown: competition.map(|competition| (competition, detail.clone())),
            detail,
        };
        // First it counts for nothing, then it ends: so its run never takes its end for one that counts.
        let void = Entry::VoidEpisode { episode: stored.episode, reason, at };
        app.store.keep(vec![void, Entry::Audit(Box::new(audit))]).await?;
    }
    match stored.run {
        Some(run) => app.runs.advance(run).await?,
        None if stored.ended_at.is_none() => app.episode(&id).await?.abort().await?,
        None => {}
    }
    Ok(JsonBody(app.summary(&Caller::Key(key), &id).await?))
}
