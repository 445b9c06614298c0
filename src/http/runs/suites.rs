//! `GET /api/v1/suites`.

use axum::Json;

use super::super::error::ApiError;
use super::super::extract::{Nothing, Params};
use swarmbench_protocol::run::{SuiteList, SuiteView};
use swarmbench_protocol::suite::Suite;

/// Show the built-in suites in full, by each rule set.
#[utoipa::path(
    get,
    path = "/api/v1/suites",
    operation_id = "list_suites",
    tag = "runs",
    responses((status = 200, description = "The built-in suites", body = SuiteList))
)]
pub(in super::super) async fn list_suites(_: Params<Nothing>) -> Result<Json<SuiteList>, ApiError> {
    let items = Suite::all_built_in().map(|suite| SuiteView::of(&suite, true)).collect();
    Ok(Json(SuiteList { items, next_cursor: None }))
}
