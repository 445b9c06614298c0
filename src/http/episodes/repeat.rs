//! `POST /api/v1/episodes/{id}/repeat`.

use axum::Json as JsonBody;
use serde_json::json;

use super::super::auth::Subject;
use super::super::checks::checked_reason;
use super::super::prelude::*;
use crate::episode::spec::Visibility;
use crate::run::definition;
use swarmbench_protocol::episode::{EpisodeSummary, VoidRequest};

/// Play a game of an own run again: the same task and seed.
///
/// The game is kept, counts nowhere, and is shown with the reason. A run that has finished continues until the new game has
/// ended. Repeating a voided game changes nothing.
#[utoipa::path(
    post,
    path = "/api/v1/episodes/{id}/repeat",
    operation_id = "repeat_episode",
    tag = "episodes",
    request_body(content = VoidRequest, description = "At most 256 KiB"),
    responses(
        (status = 200, description = "The earlier game, which counts nowhere now", body = EpisodeSummary),
        (status = 403, description = "`forbidden`: not the creator of the run, a game of a competition, or one that the server plays"),
        (status = 409, description = "`episode_over`: the run was aborted, abandoned or closed. `changed`: the game has not ended, \
                                      was repeated too often, or belongs to no run"),
    )
)]
pub(in super::super) async fn repeat_episode(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
    body: Unread,
) -> Result<JsonBody<EpisodeSummary>, ApiError> {
    caller.check_not_judge()?;
    let (stored, spec) = app.known_episode(&caller, id).await?;
    let run = match stored.run {
        Some(run) => app.store.run(run).await?,
        None => None,
    };
    let run = run.map(|run| Ok::<_, ApiError>((definition::read(&run)?, run))).transpose()?;
    let game = app.subject(&stored, &spec);
    // The games of a team are closed to its creator, and the run is not.
    let visibility = run.as_ref().and_then(|(run, _)| Visibility::parse(&run.visibility));
    let of_run = Subject { visibility: visibility.unwrap_or(game.visibility), ..game };
    let forbidden = |detail: &str| Err(ApiError::new(Code::Forbidden, detail));
    if !caller.owns(of_run) && !caller.plays_for_nobody(of_run) {
        return forbidden(
            "only the creator of a run may do this: send its swarm token, or the key with which it was created",
        );
    }
    let (VoidRequest { reason }, _) = body.read(&app).await?;
    let reason = checked_reason(&app, reason)?;
    let Some((definition, run)) = run else {
        let detail = "only a game of a run is played again; this one belongs to none";
        return Err(ApiError::new(Code::Changed, detail));
    };
    if run.attempt.is_some() {
        return forbidden(
            "games of a competition are not played again; after a fault of the server an organizer voids them",
        );
    }
    if definition.is_all_hosted() {
        return forbidden("the server itself plays this run");
    }
    detached(async move {
        let (at, detail) = (app.clock.wall(), json!({ "reason": reason }));
        let (id, competition) = (stored.id.as_str(), run.competition);
        let audit = caller.audit_foreign(run.owner, at, "episode.repeat", id, detail, competition);
        app.runs.repeat(run.run, stored.episode, &reason, audit).await?;
        Ok(JsonBody(app.summary(&caller, &stored.id).await?))
    })
    .await
}
