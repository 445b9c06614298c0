//! `GET /api/v1/competitions`.

use axum::extract::State;
use axum::response::Response;
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::App;
use super::super::auth::Caller;
use super::super::error::ApiError;
use super::super::extract::{Params, page_limit, read_cursor};
use super::super::page::{Page, ROWS_MAX};
use super::super::refusals::{QueryRefusals, TokenRefusals};
use super::shown;
use crate::competitions;
use crate::ids::CompetitionKey;
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
) -> Result<Response, ApiError> {
    caller.may_look_around(&app.access)?;
    let limit = page_limit(&app, params.limit, app.limits.page_items_default)?;
    let mut page = Page::new(&app, read_cursor(params.cursor.as_deref())?, limit).await?;
    let now = app.clock.wall();
    while let Some(rows) = page.wants(ROWS_MAX) {
        let stored = competitions::list(&app.store, page.place().map(CompetitionKey), rows).await?;
        page.add(rows, stored, |stored| Ok((stored.key.0, shown(&stored, now))))?;
    }
    Ok(page.answer())
}
