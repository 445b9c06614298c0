//! `GET /api/v1/episodes/{id}/state`.

use axum::Json;
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::prelude::*;
use swarmbench_protocol::episode::State as StateBody;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct StateParams {
    /// Number of rounds that led to the state; the current state by default.
    pub(in super::super) round: Option<u32>,
}

/// Show the whole world after any round.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}/state",
    operation_id = "show_state",
    tag = "episodes",
    params(StateParams),
    responses(
        (status = 200, description = "The state", body = StateBody),
        (status = 403, description = "`forbidden`: only the creator may read it before the end"),
        (status = 404, description = "`not_found`: no such episode, or the round has not come yet"),
        (status = 503, description = "`overloaded`: too many states of earlier rounds are requested"),
    )
)]
pub(in super::super) async fn show_state(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<StateParams>,
) -> Result<Json<StateBody>, ApiError> {
    let handle = app.readable(&caller, id).await?;
    let now = handle.snapshot().world.clone();
    let round = params.round.unwrap_or(now.round());
    if round > now.round() {
        let detail =
            format!("the episode stands at round {}; round {round} is not resolved", now.round());
        return Err(ApiError::new(Code::NotFound, detail).at_round(now.round()));
    }
    let world = if round == now.round() { now } else { app.state_at(&handle, round, None).await? };
    Ok(Json(world.spectator_view().into()))
}
