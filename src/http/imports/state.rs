//! `GET /api/v1/imports/{id}/state`.

use axum::Json;

use super::super::episodes::state::StateParams;
use super::super::prelude::*;
use super::unreadable;
use crate::dataset::imported;
use swarmbench_protocol::episode::State as StateBody;

/// Show a state of an imported game, as it was recorded.
#[utoipa::path(
    get,
    path = "/api/v1/imports/{id}/state",
    operation_id = "show_imported_state",
    tag = "data",
    params(StateParams),
    responses(
        (status = 200, description = "The state", body = StateBody),
        (status = 404, description = "`not_found`: no such game, or no such round of it"),
        (status = 422, description = "`invalid`: an earlier version stored more than the limit `import_state_bytes_max`"),
    )
)]
pub(in super::super) async fn show_imported_state(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<StateParams>,
) -> Result<Json<StateBody>, ApiError> {
    let stored = app.import(&caller, &id).await?;
    let round = params.round.unwrap_or(stored.rounds);
    if round > stored.rounds {
        let detail = format!("the game has {} rounds, and no round {round}", stored.rounds);
        return Err(ApiError::new(Code::NotFound, detail).at_round(stored.rounds));
    }
    let (state, memory) = app.imported_state(&stored, round).await?;
    let shown = app.heavy.render(move || {
        let _memory = memory;
        imported::state(&stored.task, &state)
    });
    Ok(Json(shown.await?.map_err(unreadable)?))
}
