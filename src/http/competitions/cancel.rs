//! `POST /api/v1/competitions/{id}/cancel`.

use axum::Json as JsonBody;
use serde_json::json;

use super::super::checks::checked_reason;
use super::super::prelude::*;
use super::{check_open, shown};
use crate::run::RunStatus;
use crate::store::entries::Entry;
use swarmbench_boards::competition::export::CANCEL;
use swarmbench_protocol::competition::{CancelRequest, Competition};

/// Cancel a competition that has not closed: nobody can enter or start an attempt any more, and running attempts end.
///
/// The seeds are published at the time at which the competition would have closed. A repeat changes nothing, and the first
/// reason stays.
#[utoipa::path(
    post,
    path = "/api/v1/competitions/{id}/cancel",
    operation_id = "cancel_competition",
    tag = "competitions",
    request_body(content = CancelRequest, description = "At most 256 KiB"),
    responses(
        (status = 200, description = "The competition", body = Competition),
        (status = 403, description = "`forbidden`: not an organizer's key"),
        (status = 409, description = "`closed`: the competition has closed already"),
    )
)]
pub(in super::super) async fn cancel_competition(
    State(app): State<App>,
    organizer: Organizer,
    Id(id): Id,
    _: Params<Nothing>,
    Json(CancelRequest { reason }, _): Json<CancelRequest>,
) -> Result<JsonBody<Competition>, ApiError> {
    let reason = checked_reason(&app, reason)?;
    detached(async move {
        let cancelled = {
            // The lock waits for attempts that are being started, and blocks further ones.
            let _closed = app.runs.block_entries().await;
            let competition = app.stored_competition(&id).await?;
            let at = app.clock.wall();
            if competition.cancelled.is_none() {
                check_open(&competition, at)?;
                let detail = json!({ "reason": reason });
                let shown = (competition.key, detail.clone());
                let audit_entry = organizer.audit_entry_shown(&app, CANCEL, &id, detail, shown);
                let cancel = Entry::CancelCompetition { competition: competition.key, reason, at };
                app.store.keep(vec![cancel, audit_entry]).await?;
            }
            competition.key
        };
        // A repeated request ends the runs that were left when the server stopped.
        for attempt in app.store.running_attempts(cancelled).await? {
            app.runs.end(attempt, RunStatus::Aborted).await?;
        }
        let competition = app.stored_competition(&id).await?;
        Ok(JsonBody(shown(&competition, app.clock.wall())))
    })
    .await
}
