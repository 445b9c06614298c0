//! `GET /api/v1/imports/{id}/worth`.

use axum::Json;
use swarmbench_engine::TaskName;
use swarmbench_worth::without;

use super::super::prelude::*;
use swarmbench_protocol::worth::GameWorth;

/// Show that an imported game has no worth.
///
/// Its files have no state that can be played on: `missing` says so, and all numbers are null.
#[utoipa::path(
    get,
    path = "/api/v1/imports/{id}/worth",
    operation_id = "show_import_worth",
    tag = "data",
    responses(
        (status = 200, description = "The game without its worth", body = GameWorth),
        (status = 404, description = "`not_found`: no such game"),
    )
)]
pub(in super::super) async fn show_import_worth(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Json<GameWorth>, ApiError> {
    let stored = app.import(&caller, &id).await?;
    let task = TaskName::find(&stored.task).ok_or_else(|| ApiError::not_found("the game"))?;
    let detail = "the files of an imported game have no state that can be played on".to_owned();
    let worth = without(task, stored.rounds, stored.score, detail);
    Ok(Json(GameWorth { episode: Some(stored.id), ..worth }))
}
