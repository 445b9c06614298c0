//! `GET /api/v1/keys`.

use axum::extract::State;
use axum::response::Response;

use super::super::App;
use super::super::auth::Organizer;
use super::super::error::ApiError;
use super::super::extract::{PageParams, Params};
use super::super::page::ROWS_MAX;
use super::super::refusals::{QueryRefusals, TokenRefusals};
use crate::keys::OwnerKey;
use crate::wire::key::KeyList;
use crate::wire::problem::Problem;

/// List all keys that were ever made, oldest first.
#[utoipa::path(
    get,
    path = "/api/v1/keys",
    operation_id = "list_keys",
    tag = "keys",
    params(PageParams),
    security(("key" = [])),
    responses(
        (status = 200, description = "The keys, without the keys themselves", body = KeyList),
        QueryRefusals,
        TokenRefusals,
        (status = 403, description = "`forbidden`: not an organizer's key", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in super::super) async fn list_keys(
    State(app): State<App>,
    _: Organizer,
    Params(params): Params<PageParams>,
) -> Result<Response, ApiError> {
    let now = app.clock.wall();
    let mut page = params.page(&app).await?;
    while let Some(rows) = page.wants(ROWS_MAX) {
        let keys = app.store.list_keys(page.place().map(OwnerKey), rows).await?;
        page.add(rows, keys, |key| {
            Ok((key.number.map_or(0, |number| number.0), key.summary(now)))
        })?;
    }
    Ok(page.answer())
}
