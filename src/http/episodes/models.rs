//! `GET /api/v1/models`.

use axum::Json;

use super::super::page::{PageParams, page_limit};
use super::super::prelude::*;
use crate::store::episodes::Readable;
use swarmbench_protocol::episode::ModelList;

/// List the models of the games that anyone may read, in order of their names.
///
/// A cursor is the last name of the previous page.
#[utoipa::path(
    get,
    path = "/api/v1/models",
    operation_id = "list_models",
    tag = "episodes",
    params(PageParams),
    responses((status = 200, description = "A page of names", body = ModelList))
)]
pub(in super::super) async fn list_models(
    State(app): State<App>,
    caller: Caller,
    Params(params): Params<PageParams>,
) -> Result<Json<ModelList>, ApiError> {
    let limit = page_limit(&app, params.limit, 1_000)?;
    if let Readable::OnlyOfRun(_) | Readable::Only(_) | Readable::Nothing = caller.readable(&app) {
        return Ok(Json(ModelList { items: Vec::new(), next_cursor: None }));
    }
    let after = params.cursor.unwrap_or_default();
    let mut items = app.store.public_models(&after, limit + 1).await?;
    let has_more = items.len() > limit as usize;
    items.truncate(limit as usize);
    let next_cursor = items.last().filter(|_| has_more).cloned();
    Ok(Json(ModelList { items, next_cursor }))
}
