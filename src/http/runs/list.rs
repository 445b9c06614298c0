//! `GET /api/v1/runs`.

use axum::Json;
use axum::extract::State;
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::App;
use super::super::auth::Caller;
use super::super::error::ApiError;
use super::super::extract::{Params, one_of, page_limit, read_cursor, write_cursor};
use super::super::refusals::{QueryRefusals, TokenRefusals};
use super::Known;
use crate::journal::RunKey;
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
) -> Result<Json<RunList>, ApiError> {
    let limit = page_limit(&app, params.limit, app.limits.page_items_default)?;
    one_of("status", params.status.as_deref(), &RunStatus::ALL.map(RunStatus::name))?;
    let before = read_cursor(params.cursor.as_deref())?.map(RunKey);
    let filter = RunFilter {
        status: params.status,
        model: params.model,
        suite: params.suite,
        readable: caller.readable(&app.access),
    };
    let mut stored = app.store.list_runs(&filter, before, limit + 1).await?;
    let has_more = stored.len() > limit as usize;
    stored.truncate(limit as usize);
    let next_cursor = stored.last().filter(|_| has_more).map(|last| write_cursor(last.run.0));
    let keys: Vec<RunKey> = stored.iter().map(|run| run.run).collect();
    let mut games = app.store.games_of_all(&keys).await?;
    let items = stored.into_iter().map(|stored| {
        let games = games.remove(&stored.run).unwrap_or_default();
        Ok(Known::of(stored)?.summary(&app, &caller, &games))
    });
    Ok(Json(RunList { items: items.collect::<Result<_, ApiError>>()?, next_cursor }))
}
