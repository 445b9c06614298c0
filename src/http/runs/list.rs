//! `GET /api/v1/runs`.

use axum::extract::State;
use axum::response::Response;
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::App;
use super::super::auth::Caller;
use super::super::error::ApiError;
use super::super::extract::{Params, one_of, page_limit, read_cursor};
use super::super::page::{LARGE_ROWS_MAX, Page};
use super::super::refusals::{QueryRefusals, TokenRefusals};
use super::Known;
use crate::ids::RunKey;
use crate::run::RunStatus;
use crate::store::runs::RunFilter;
use crate::wire::run::RunList;

/// Which runs to list.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct ListParams {
    /// `running`, `finished`, `aborted`, `abandoned` or `closed`.
    status: Option<String>,
    /// A model's name.
    model: Option<String>,
    /// A suite's name.
    suite: Option<String>,
    /// How many at most, up to 1,000; 50 where it is left out.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// The `next_cursor` of the page before.
    cursor: Option<String>,
}

/// List runs, newest first.
///
/// Runs that the caller may not see before their end are listed after it.
#[utoipa::path(
    get,
    path = "/api/v1/runs",
    operation_id = "list_runs",
    tag = "runs",
    params(ListParams),
    security((), ("seat" = []), ("swarm" = []), ("key" = [])),
    responses(
        (status = 200, description = "A page of runs", body = RunList),
        QueryRefusals,
        TokenRefusals,
    )
)]
pub(in super::super) async fn list_runs(
    State(app): State<App>,
    caller: Caller,
    Params(params): Params<ListParams>,
) -> Result<Response, ApiError> {
    let limit = page_limit(&app, params.limit, app.limits.page_items_default)?;
    one_of("status", params.status.as_deref(), &RunStatus::ALL.map(RunStatus::name))?;
    let mut page = Page::new(&app, read_cursor(params.cursor.as_deref())?, limit).await?;
    let filter = RunFilter {
        status: params.status,
        model: params.model,
        suite: params.suite,
        readable: caller.readable(&app.access),
    };
    // A run may have a thousand games.
    while let Some(rows) = page.wants(LARGE_ROWS_MAX) {
        let stored = app.store.list_runs(&filter, page.place().map(RunKey), rows).await?;
        let keys: Vec<RunKey> = stored.iter().map(|run| run.run).collect();
        let mut games = app.store.games_of_all(&keys).await?;
        page.add(rows, stored, |stored| {
            let games = games.remove(&stored.run).unwrap_or_default();
            Ok((stored.run.0, Known::of(stored)?.summary(&app, &caller, &games)))
        })?;
    }
    Ok(page.answer())
}
