//! `GET /api/v1/keys/self`.

use axum::Json;

use super::super::auth::needs_token;
use super::super::prelude::*;
use swarmbench_protocol::key::KeySummary;

/// Show the key of the request.
#[utoipa::path(
    get,
    path = "/api/v1/keys/self",
    operation_id = "show_own_key",
    tag = "keys",
    responses(
        (status = 200, description = "The key, without the key itself", body = KeySummary),
        (status = 403, description = "`forbidden`: the token of a game or a run"),
    )
)]
pub(in super::super) async fn show_own_key(
    State(app): State<App>,
    caller: Caller,
    _: Params<Nothing>,
) -> Result<Json<KeySummary>, ApiError> {
    match caller {
        Caller::Key(key) => Ok(Json(key.summary(app.clock.wall()))),
        Caller::Anonymous { .. } => Err(needs_token("a key")),
        _ => Err(ApiError::new(Code::Forbidden, "this is the token of a game or a run, not a key")),
    }
}
