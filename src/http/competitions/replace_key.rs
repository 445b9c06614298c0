//! `POST /api/v1/competitions/{id}/entrants/{entrant}/key`.

use axum::http::StatusCode;
use serde_json::json;

use super::super::answer::with_tokens;
use super::super::prelude::*;
use super::check_not_erased;
use crate::ids::{Token, TokenKind};
use crate::keys::Role;
use crate::store::entries::Entry;
use swarmbench_protocol::competition::ReplacedKey;

/// Make a new key for an entrant that has lost its own; the lost key is no longer valid, nor are the tokens of what
/// it plays. The entrant continues with new ones: `POST /runs/{id}/token`.
///
/// An entrant that entered with a key of its own gets no other here: revoke that key, and make another one with the same role.
#[utoipa::path(
    post,
    path = "/api/v1/competitions/{id}/entrants/{entrant}/key",
    operation_id = "replace_entrant_key",
    tag = "competitions",
    responses(
        (status = 201, description = "The new key, shown only once", body = ReplacedKey),
        (status = 403, description = "`forbidden`: not an organizer's key"),
        (status = 409, description = "`closed`: the entrant was erased, or entered with a key of its own"),
    )
)]
pub(in super::super) async fn replace_entrant_key(
    State(app): State<App>,
    organizer: Organizer,
    Id((id, entrant)): Id<(String, String)>,
    _: Params<Nothing>,
) -> Result<Response, ApiError> {
    detached(async move {
        let (competition, _lock, stored) = app.lock_entrant(&id, &entrant, check_not_erased).await?;
        let closed = |detail: &str| Err(ApiError::new(Code::Closed, detail));
        let key = app.store.key(stored.owner).await?;
        let key = key.ok_or_else(|| ApiError::not_found("the entrant's key"))?;
        if key.role != Role::Entrant {
            return closed(
                "this entrant entered with a key of its own: revoke that (`swarmbench key revoke`) and make another",
            );
        }
        let token = Token::new(TokenKind::Key, &*app.entropy);
        let replace = Entry::ReplaceKey { id: key.id.clone(), hash: token.hash() };
        let detail = json!({ "competition": id, "key": key.id });
        let shown = (competition.key, json!({}));
        let audit_entry = organizer.audit_entry_shown(&app, "entrant.key", &entrant, detail, shown);
        app.store.keep(vec![replace, audit_entry]).await?;
        app.key_revoked(&key.id).await?;
        let body = ReplacedKey { entrant, key: token.reveal().to_owned() };
        Ok(with_tokens(StatusCode::CREATED, body))
    })
    .await
}
