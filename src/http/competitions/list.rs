//! `GET /api/v1/competitions`.

use super::super::page::{NewestParams, ROWS_MAX};
use super::super::prelude::*;
use super::shown;
use crate::competitions;
use crate::ids::CompetitionKey;
use swarmbench_protocol::competition::CompetitionList;

/// List competitions, newest first.
#[utoipa::path(
    get,
    path = "/api/v1/competitions",
    operation_id = "list_competitions",
    tag = "competitions",
    params(NewestParams),
    responses((status = 200, description = "A page of competitions", body = CompetitionList))
)]
pub(in super::super) async fn list_competitions(
    State(app): State<App>,
    caller: Caller,
    Params(params): Params<NewestParams>,
) -> Result<Response, ApiError> {
    caller.check_may_browse(&app.access)?;
    let page = params.page(&app)?;
    let now = app.clock.wall();
    let all = caller.reads_all();
    let read = |before: Option<i64>, rows| {
        competitions::list(&app.store, all, before.map(CompetitionKey), rows)
    };
    page.fill(ROWS_MAX, read, |stored| Ok((stored.key.0, shown(&stored, now)))).await
}
