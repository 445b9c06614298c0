//! `PATCH /api/v1/competitions/{id}/entrants/{entrant}`.

use serde_json::json;

use super::super::prelude::*;
use crate::store::entries::Entry;
use swarmbench_boards::competition::EntrantStatus;
use swarmbench_protocol::competition::{EntrantChange, EntrantSummary};

/// Withdraw or disqualify an entrant, take it back, or answer for its model.
///
/// An entrant that is withdrawn or disqualified stays on the board without a rank, with the reason.
#[utoipa::path(
    patch,
    path = "/api/v1/competitions/{id}/entrants/{entrant}",
    operation_id = "change_entrant",
    tag = "competitions",
    params(
        ("id" = String, Path, description = "The competition's id"),
        ("entrant" = String, Path, description = "The entrant's id"),
    ),
    request_body(content = EntrantChange, description = "At most 256 KiB"),
    security(("key" = [])),
    responses(
        (status = 200, description = "The entrant as it is now", body = EntrantSummary),
        (status = 403, description = "`forbidden`: not an organizer's key"),
    )
)]
pub(in super::super) async fn change_entrant(
    State(app): State<App>,
    organizer: Organizer,
    Ids(id, entrant): Ids,
    _: Params<Nothing>,
    Json(change, _): Json<EntrantChange>,
) -> Result<axum::Json<EntrantSummary>, ApiError> {
    let EntrantChange { status, reason, vouched } = change;
    let status = match status.as_deref() {
        None => None,
        Some(name) => Some(EntrantStatus::parse(name).ok_or_else(|| {
            let names = EntrantStatus::ALL.map(EntrantStatus::name).join(", ");
            ApiError::field("status", format!("must be one of {names}"))
        })?),
    };
    if let Some(reason) = &reason {
        let mut problems = Problems::default();
        problems.text("reason", reason, app.limits.reason_chars_max);
        problems.none_or(Some(()))?;
    }
    match (status, &reason) {
        (Some(EntrantStatus::Disqualified), None) => {
            return Err(ApiError::field("reason", "is missing: everybody is to see why"));
        }
        (None | Some(EntrantStatus::Active), Some(_)) => {
            let problem = "belongs to a status of withdrawn or disqualified";
            return Err(ApiError::field("reason", problem));
        }
        _ => {}
    }
    App::run_detached(async move {
        let competition = app.stored_competition(&id).await?;
        // What two organizers decide at once is decided one after the other.
        let _lock = app.creations.lock(&format!("entrant {entrant}")).await;
        let before = app.entrant(&competition, &entrant).await?;
        let reason = if status.is_some() { reason } else { before.entrant.reason };
        let status = status.unwrap_or(before.entrant.status).name();
        let vouched = vouched.unwrap_or(before.entrant.vouched);
        let detail = json!({
            "competition": id, "status": status, "reason": reason, "vouched": vouched,
        });
        let audit_entry = organizer.audit_entry(&app, "entrant.change", &entrant, detail);
        let entry = Entry::SetEntrant { entry: before.key, status, reason, vouched };
        app.store.keep(vec![entry, audit_entry]).await?;
        let after = app.entrant(&competition, &entrant).await?;
        Ok(axum::Json((&after.entrant).into()))
    })
    .await
}
