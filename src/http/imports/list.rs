//! `GET /api/v1/imports`.

use axum::extract::State;
use axum::response::Response;
use serde::Deserialize;
use swarmbench_engine::TaskName;
use utoipa::IntoParams;

use super::super::App;
use super::super::auth::Caller;
use super::super::error::ApiError;
use super::super::extract::{Params, one_of, page_limit, read_cursor};
use super::super::page::{Page, ROWS_MAX};
use super::super::refusals::{QueryRefusals, TokenRefusals};
use crate::ids::ImportKey;
use crate::store::imports::ImportFilter;
use crate::wire::import::{ImportList, ImportSummary};

/// Which games to list.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct ImportParams {
    /// A task's name.
    task: Option<String>,
    /// A model's name.
    model: Option<String>,
    /// How many at most, up to 1,000; 50 where it is left out.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// The `next_cursor` of the page before.
    cursor: Option<String>,
}

/// List imported games, newest first.
#[utoipa::path(
    get,
    path = "/api/v1/imports",
    operation_id = "list_imports",
    tag = "data",
    params(ImportParams),
    security((), ("seat" = []), ("swarm" = []), ("key" = [])),
    responses(
        (status = 200, description = "A page of imported games", body = ImportList),
        QueryRefusals,
        TokenRefusals,
    )
)]
pub(in super::super) async fn list_imports(
    State(app): State<App>,
    caller: Caller,
    Params(params): Params<ImportParams>,
) -> Result<Response, ApiError> {
    let limit = page_limit(&app, params.limit, app.limits.page_items_default)?;
    one_of("task", params.task.as_deref(), &TaskName::ALL.map(TaskName::name))?;
    let mut page = Page::new(&app, read_cursor(params.cursor.as_deref())?, limit).await?;
    if !caller.may_read_what_is_over(&app.access) {
        return Ok(page.answer());
    }
    let filter = ImportFilter { task: params.task, model: params.model };
    while let Some(rows) = page.wants(ROWS_MAX) {
        let stored = app.store.list_imports(&filter, page.place().map(ImportKey), rows).await?;
        page.add(rows, stored, |stored| Ok((stored.key.0, ImportSummary::from(stored))))?;
    }
    Ok(page.answer())
}
