//! `GET /api/v1/imports`.

use axum::Json;
use axum::extract::State;
use serde::Deserialize;
use swarmbench_engine::TaskName;
use utoipa::IntoParams;

use super::super::App;
use super::super::auth::Caller;
use super::super::error::{ApiError, Code};
use super::super::extract::Params;
use super::super::openapi::{QueryRefusals, TokenRefusals};
use crate::journal::ImportKey;
use crate::store::imports::ImportFilter;
use crate::wire::import::ImportList;

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
) -> Result<Json<ImportList>, ApiError> {
    let malformed = |detail: String| ApiError::new(Code::Malformed, detail);
    let most = app.limits.page_items_max;
    let limit = params.limit.unwrap_or(app.limits.page_items_default);
    if !(1..=most).contains(&limit) {
        let detail = format!("limit must be from 1 to {most}, is {limit}");
        return Err(ApiError::limit(Code::Malformed, "page_items_max", most as usize, detail));
    }
    if params.task.as_ref().is_some_and(|task| TaskName::parse(task).is_none()) {
        let names = TaskName::ALL.map(TaskName::name).join(", ");
        return Err(malformed(format!("task must be one of {names}")));
    }
    let before = match &params.cursor {
        None => None,
        Some(cursor) => Some(read_cursor(cursor).ok_or_else(|| {
            malformed("cursor must be the next_cursor of an earlier page".to_owned())
        })?),
    };
    if !caller.may_read_what_is_over(&app.access) {
        return Ok(Json(ImportList { items: Vec::new(), next_cursor: None }));
    }
    let filter = ImportFilter { task: params.task, model: params.model };
    let mut stored = app.store.list_imports(&filter, before, limit + 1).await?;
    let has_more = stored.len() > limit as usize;
    stored.truncate(limit as usize);
    let next_cursor = stored.last().filter(|_| has_more).map(|last| write_cursor(last.key));
    let items = stored.into_iter().map(Into::into).collect();
    Ok(Json(ImportList { items, next_cursor }))
}

fn write_cursor(key: ImportKey) -> String {
    format!("i{:x}", key.0)
}

fn read_cursor(text: &str) -> Option<ImportKey> {
    i64::from_str_radix(text.strip_prefix('i')?, 16).ok().filter(|key| *key >= 0).map(ImportKey)
}
