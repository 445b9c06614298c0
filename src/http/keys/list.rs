//! `GET /api/v1/keys`.

use super::super::page::{PageParams, ROWS_MAX};
use super::super::prelude::*;
use crate::keys::{Key, OwnerKey};
use swarmbench_protocol::key::KeyList;

/// List all keys that were ever made, oldest first.
#[utoipa::path(
    get,
    path = "/api/v1/keys",
    operation_id = "list_keys",
    tag = "keys",
    params(PageParams),
    responses(
        (status = 200, description = "The keys, without the keys themselves", body = KeyList),
        (status = 403, description = "`forbidden`: not an organizer's key"),
    )
)]
pub(in super::super) async fn list_keys(
    State(app): State<App>,
    _: Organizer,
    Params(params): Params<PageParams>,
) -> Result<Response, ApiError> {
    let now = app.clock.wall();
    let read = |after: Option<i64>, rows| app.store.list_keys(after.map(OwnerKey), rows);
    let show = |key: Key| Ok((key.number.map_or(0, |number| number.0), key.summary(now)));
    params.page(&app)?.fill(ROWS_MAX, read, show).await
}
