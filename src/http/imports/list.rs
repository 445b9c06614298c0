//! `GET /api/v1/imports`.

use swarmbench_engine::TaskName;

use super::super::extract::one_of;
use super::super::page::{ROWS_MAX, list_params};
use super::super::prelude::*;
use crate::ids::ImportKey;
use crate::store::imports::ImportFilter;
use swarmbench_protocol::any_case;
use swarmbench_protocol::import::{ImportList, ImportSummary};

list_params! {
    /// Filters and page of the list.
    ImportParams {
        /// Name of a task.
        #[serde(default, deserialize_with = "any_case::task")]
        task,
        /// Name of a model.
        model,
    }
}

/// List imported games, newest first.
#[utoipa::path(
    get,
    path = "/api/v1/imports",
    operation_id = "list_imports",
    tag = "data",
    params(ImportParams),
    responses((status = 200, description = "A page of imported games", body = ImportList))
)]
pub(in super::super) async fn list_imports(
    State(app): State<App>,
    caller: Caller,
    Params(params): Params<ImportParams>,
) -> Result<Response, ApiError> {
    one_of("task", params.task.as_deref(), &TaskName::ALL.map(TaskName::name))?;
    let page = params.page(&app)?;
    if !caller.may_read_ended(&app.access) {
        return Ok(page.answer());
    }
    let filter = ImportFilter { task: params.task, model: params.model };
    let read =
        |before: Option<i64>, rows| app.store.list_imports(&filter, before.map(ImportKey), rows);
    page.fill(ROWS_MAX, read, |stored| Ok((stored.key.0, ImportSummary::from(stored)))).await
}
