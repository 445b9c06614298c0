//! `GET /api/v1/competitions`.

use axum::Json;
use axum::extract::State;
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::App;
use super::super::auth::Caller;
use super::super::error::ApiError;
use super::super::extract::{Params, page_limit, read_cursor, write_cursor};
use super::super::refusals::{QueryRefusals, TokenRefusals};
use super::shown;
use crate::journal::CompetitionKey;
use crate::wire::competition::CompetitionList;

/// Which page is to be shown.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct ListParams {
    /// How many at most, up to 1,000; 50 where it is left out.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// The `next_cursor` of the page before.
    cursor: Option<String>,
}

/// List competitions, newest first.
#[utoipa::path(
    get,
    path = "/api/v1/competitions",
    operation_id = "list_competitions",
    tag = "competitions",
    params(ListParams),
    security((), ("key" = [])),
    responses(
        (status = 200, description = "A page of competitions", body = CompetitionList),
        QueryRefusals,
        TokenRefusals,
    )
)]
pub(in super::super) async fn list_competitions(
    State(app): State<App>,
    caller: Caller,
    Params(params): Params<ListParams>,
) -> Result<Json<CompetitionList>, ApiError> {
    caller.may_look_around(&app.access)?;
    let limit = page_limit(&app, params.limit, app.limits.page_items_default)?;
    let before = read_cursor(params.cursor.as_deref())?.map(CompetitionKey);
    let mut stored = app.store.list_competitions(before, limit + 1).await?;
    let has_more = stored.len() > limit as usize;
    stored.truncate(limit as usize);
    let next_cursor = stored.last().filter(|_| has_more).map(|last| write_cursor(last.key.0));
    let now = app.clock.wall();
    let items = stored.iter().map(|stored| shown(stored, now)).collect();
    Ok(Json(CompetitionList { items, next_cursor }))
}
