//! `GET /api/v1/keys`.

use axum::Json;
use axum::extract::State;

use super::super::App;
use super::super::auth::Organizer;
use super::super::error::ApiError;
use super::super::extract::{Nothing, Params};
use super::super::refusals::{QueryRefusals, TokenRefusals};
use crate::wire::key::{KeyList, KeySummary};
use crate::wire::problem::Problem;

/// List all keys that were ever made, oldest first.
#[utoipa::path(
    get,
    path = "/api/v1/keys",
    operation_id = "list_keys",
    tag = "keys",
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
    _: Params<Nothing>,
) -> Result<Json<KeyList>, ApiError> {
    let now = app.clock.wall();
    let items = app.store.keys().await?.iter().map(|key| KeySummary::of(key, now)).collect();
    Ok(Json(KeyList { items, next_cursor: None }))
}
