//! `POST /api/v1/keys`.

use axum::http::StatusCode;
use serde_json::json;

use super::super::answer::with_tokens;
use super::super::prelude::*;
use crate::keys::{Key, KeyRow, Role};
use crate::store::entries::Entry;
use swarmbench_protocol::key::{CreatedKey, KeyRequest};

/// Make a key for somebody.
///
/// The key is shown only once. The first key of a server is made on its machine, with `swarmbench key create`.
#[utoipa::path(
    post,
    path = "/api/v1/keys",
    operation_id = "create_key",
    tag = "keys",
    request_body(content = KeyRequest, description = "At most 256 KiB"),
    responses(
        (status = 201, description = "The key", body = CreatedKey),
        (status = 403, description = "`forbidden`: not an organizer's key"),
    )
)]
pub(in super::super) async fn create_key(
    State(app): State<App>,
    organizer: Organizer,
    _: Params<Nothing>,
    Json(request, _): Json<KeyRequest>,
) -> Result<Response, ApiError> {
    let role = request.role.as_deref().unwrap_or(Role::Member.name());
    let role = Role::parse(role).ok_or_else(|| {
        let names = Role::ALL.map(Role::name).join(", ");
        ApiError::field("role", format!("must be one of {names}"))
    })?;
    let now = app.clock.wall();
    if request.expires_at.is_some_and(|at| *at <= now) {
        return Err(ApiError::field("expires_at", "must be in the future"));
    }
    let (key, token) =
        Key::new(role, &request.name, request.expires_at.map(Into::into), now, &*app.entropy)
            .map_err(|problem| ApiError::field("name", problem))?;
    let created = CreatedKey { key: key.summary(now), secret: token.reveal().to_owned() };
    let detail = json!({ "name": key.name, "role": key.role.name() });
    let audit_entry = organizer.audit_entry(&app, "key.create", &key.id, detail);
    let row = KeyRow { key, hash: token.hash(), acts_for: None };
    app.store.keep(vec![Entry::AddKey(Box::new(row)), audit_entry]).await?;
    Ok(with_tokens(StatusCode::CREATED, created))
}
