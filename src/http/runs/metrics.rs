//! `GET /api/v1/runs/{id}/metrics`.

use axum::Json;
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::episodes::metrics::{definition, game_metrics};
use super::super::prelude::*;
use super::games::GamesPage;
use crate::measure::{means, method};
use crate::store::games::StoredGame;
use swarmbench_protocol::metrics::RunMetrics;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct RunMetricsParams {
    /// Definition: `paper` (the default) or `toolkit`.
    definition: Option<String>,
    /// Maximum number of games, up to 200; 50 by default.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// Cursor: the `next_cursor` of the previous page.
    cursor: Option<String>,
}

/// Show the metrics of the games of a run.
///
/// The page has the games that have ended and were not voided, with means by task over its games.
#[utoipa::path(
    get,
    path = "/api/v1/runs/{id}/metrics",
    operation_id = "show_run_metrics",
    tag = "runs",
    params(RunMetricsParams),
    responses(
        (status = 200, description = "The metrics", body = RunMetrics),
        (status = 503, description = "`overloaded`: too many episodes are being replayed"),
    )
)]
pub(in super::super) async fn show_run_metrics(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<RunMetricsParams>,
) -> Result<Json<RunMetrics>, ApiError> {
    let definition = definition(params.definition.as_deref())?;
    let page = GamesPage::of(params.limit, params.cursor.as_deref())?;
    let known = app.known_run(&caller, &id).await?;
    // Scores and what follows from them tell of a sealed game, as its seed does.
    known.seeds(&app, &caller).await?;
    let (games, next_cursor) = app.games_page(&caller, &known, page, StoredGame::is_over).await?;
    let mut items = Vec::new();
    for game in &games {
        let stored = app.stored_game(game).await?;
        let measured = app.measured(&stored).await?;
        items.push(game_metrics(&stored, &measured, definition)?);
    }
    let (run, method) = (known.stored.id.clone(), method(definition));
    Ok(Json(RunMetrics { run, method, tasks: means(&items), items, next_cursor }))
}
