//! `GET /api/v1/runs/{id}/scores`.

use axum::Json;
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::page::items;
use super::super::prelude::*;
use super::games::GamesPage;
use swarmbench_protocol::replay::RunScores;

/// Scores of a game, where the query does not say.
const POINTS_USUAL: u32 = 50;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct RunScoresParams {
    /// Maximum number of scores of a game besides the first and the newest, up to 1,000; 50 by default.
    #[param(minimum = 1, maximum = 1000)]
    points: Option<u32>,
    /// Maximum number of games, up to 200; 50 by default.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// Cursor: the `next_cursor` of the previous page.
    cursor: Option<String>,
}

/// Show the scores of the games of a run in equal steps of rounds.
///
/// The page has the games that were opened and not voided, running ones too, as far as the caller may read them.
#[utoipa::path(
    get,
    path = "/api/v1/runs/{id}/scores",
    operation_id = "show_run_scores",
    tag = "runs",
    params(RunScoresParams),
    responses((status = 200, description = "The scores", body = RunScores))
)]
pub(in super::super) async fn show_run_scores(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<RunScoresParams>,
) -> Result<Json<RunScores>, ApiError> {
    let points = items(&app, "points", params.points.unwrap_or(POINTS_USUAL))?;
    let page = GamesPage::of(params.limit, params.cursor.as_deref())?;
    let known = app.known_run(&caller, &id).await?;
    // Scores and what follows from them tell of a sealed game, as its seed does.
    known.seeds(&app, &caller).await?;
    let (games, next_cursor) = app.games_page(&caller, &known, page, |_| true).await?;
    let mut items = Vec::new();
    for game in &games {
        let stored = app.stored_game(game).await?;
        items.push(app.scores(&stored, points).await?);
    }
    Ok(Json(RunScores { run: known.stored.id.clone(), items, next_cursor }))
}
