//! `GET /api/v1/runs/{id}/metrics`.

use axum::Json;
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::auth::Subject;
use super::super::episodes::metrics::{definition, game_metrics};
use super::super::prelude::*;
use crate::measure::{means, method};
use swarmbench_protocol::metrics::RunMetrics;

/// Games of a page, where the query does not say.
const GAMES_USUAL: u32 = 50;

/// Games of a page at most.
const GAMES_MAX: u32 = 200;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct RunMetricsParams {
    /// `paper` (where it is left out) or `toolkit`.
    definition: Option<String>,
    /// How many games at most, up to 200; 50 where it is left out.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// The `next_cursor` of the page before.
    cursor: Option<String>,
}

/// Show the metrics of the games of a run.
///
/// Games that have ended and were not voided, with their means by task over the games of this page.
#[utoipa::path(
    get,
    path = "/api/v1/runs/{id}/metrics",
    operation_id = "show_run_metrics",
    tag = "runs",
    params(("id" = String, Path, description = "The run's id"), RunMetricsParams),
    security((), ("swarm" = []), ("key" = [])),
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
    let limit = games_limit(params.limit)?;
    let after = slot_after(params.cursor.as_deref())?;
    let known = app.known_run(&caller, &id).await?;
    let games = app.store.games_of(known.stored.run).await?;
    let readable = games.iter().filter(|game| {
        let is_over = game.is_over();
        let subject = Subject { id: Some(&game.id), is_over, ..known.subject() };
        is_over && game.counts() && caller.may_read(&app.access, subject)
    });
    let mut left = readable.filter(|game| after.is_none_or(|after| game.slot > after));
    let mut items = Vec::new();
    let mut last = None;
    for game in left.by_ref().take(limit as usize) {
        let stored = app.store.summary_of(game.episode).await?;
        let stored = stored.ok_or_else(|| ApiError::not_found("the episode"))?;
        let measured = app.measured(&stored).await?;
        items.push(game_metrics(&stored, &measured, definition)?);
        last = Some(game.slot);
    }
    let next_cursor = last.filter(|_| left.next().is_some()).map(slot_cursor);
    let (run, method) = (known.stored.id.clone(), method(definition));
    Ok(Json(RunMetrics { run, method, tasks: means(&items), items, next_cursor }))
}

/// How many games a page has at most, checked.
pub(super) fn games_limit(limit: Option<u32>) -> Result<u32, ApiError> {
    let limit = limit.unwrap_or(GAMES_USUAL);
    if (1..=GAMES_MAX).contains(&limit) {
        return Ok(limit);
    }
    let detail = format!("limit must be from 1 to {GAMES_MAX}, is {limit}");
    Err(ApiError::new(Code::Malformed, detail))
}

/// The cursor behind a slot of the plan.
pub(super) fn slot_cursor(slot: u32) -> String {
    format!("m{slot:x}")
}

/// The slot behind which a page begins, by its cursor.
pub(super) fn slot_after(cursor: Option<&str>) -> Result<Option<u32>, ApiError> {
    let Some(text) = cursor else { return Ok(None) };
    let slot = text.strip_prefix('m').and_then(|slot| u32::from_str_radix(slot, 16).ok());
    let unknown = || ApiError::new(Code::Malformed, "cursor is none of this list");
    slot.ok_or_else(unknown).map(Some)
}
