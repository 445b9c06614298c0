//! `GET /api/v1/imports/{id}/scores`.

use axum::Json;

use super::super::episodes::scores::{ScoresParams, places};
use super::super::prelude::*;
use swarmbench_protocol::replay::Scores;

/// Show the score of an imported game in equal steps of rounds.
#[utoipa::path(
    get,
    path = "/api/v1/imports/{id}/scores",
    operation_id = "show_import_scores",
    tag = "data",
    params(ScoresParams),
    responses((status = 200, description = "The scores", body = Scores))
)]
pub(in super::super) async fn show_import_scores(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<ScoresParams>,
) -> Result<Json<Scores>, ApiError> {
    let points = params.points(&app)?;
    let stored = app.import(&caller, &id).await?;
    let (every, places) = places(stored.rounds, points);
    let states: Vec<u32> = std::iter::once(0).chain(places).collect();
    let scores = app.store.imported_scores(stored.key, &states).await?;
    Ok(Json(Scores { episode: stored.id, rounds: stored.rounds, every, scores }))
}
