//! `DELETE /api/v1/keys/{id}`.

use axum::Json;
use serde_json::json;

use super::super::prelude::*;
use crate::keys::Role;
use crate::store::entries::Entry;
use swarmbench_protocol::key::KeySummary;

/// Revoke a key: it gives no access any more.
///
/// Episodes that were created with it continue, and their tokens stay valid; an organizer may abort them. Revoking a key again
/// changes nothing.
#[utoipa::path(
    delete,
    path = "/api/v1/keys/{id}",
    operation_id = "revoke_key",
    tag = "keys",
    responses(
        (status = 200, description = "The revoked key", body = KeySummary),
        (status = 403, description = "`forbidden`: not an organizer's key"),
    )
)]
pub(in super::super) async fn revoke_key(
    State(app): State<App>,
    organizer: Organizer,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Json<KeySummary>, ApiError> {
    // Detached, as the revoked key must be removed from the cache even if the client hangs up.
    detached(async move {
        let now = app.clock.wall();
        let find = async || {
            let key = app.store.keys().await?.into_iter().find(|key| key.id == id);
            key.ok_or_else(|| ApiError::not_found("the key"))
        };
        let key = find().await?;
        if key.revoked_at.is_none() {
            let entrant = match key.number.filter(|_| key.role == Role::Entrant) {
                Some(number) => app.store.entrant_of_key(number).await?,
                None => None,
            };
            let audit_entry = match entrant {
                // The entry is shown to the entrant, who can no longer play and needs the reason.
                Some((competition, entrant)) => {
                    let shown = (competition, json!({ "entrant": entrant }));
                    organizer.audit_entry_shown(&app, "key.revoke", &id, json!({}), shown)
                }
                None => organizer.audit_entry(&app, "key.revoke", &id, json!({})),
            };
            app.store.keep(vec![Entry::RevokeKey { id: id.clone(), at: now }, audit_entry]).await?;
        }
        app.key_revoked(&id).await?;
        let key = find().await?;
        Ok(Json(key.summary(now)))
    })
    .await
}
