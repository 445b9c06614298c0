//! `POST /api/v1/clock/confirm`.

use axum::Json;
use axum::extract::State;
use jiff::Timestamp;
use serde_json::json;

use super::App;
use super::auth::Organizer;
use super::error::ApiError;
use super::extract::{Nothing, Params};
use crate::store::clock::CONFIRMED;
use crate::store::entries::{AuditRow, Entry};
use crate::telemetry::detached;
use swarmbench_protocol::clock::ConfirmedClock;

/// Confirm that the clock of the server's host is right.
///
/// While the time of day is in doubt (`/readyz` reports it), the server reveals, closes and abandons nothing because of it, and
/// no attempt starts. After the confirmation the server uses the host's clock. Check that clock first: what is revealed because
/// of a wrong clock stays revealed.
#[utoipa::path(
    post,
    path = "/api/v1/clock/confirm",
    operation_id = "confirm_clock",
    tag = "host",
    responses(
        (status = 200, description = "The time of day, from the host's clock", body = ConfirmedClock),
        (status = 403, description = "`forbidden`: not an organizer's key"),
    )
)]
pub(super) async fn confirm_clock(
    State(app): State<App>,
    organizer: Organizer,
    _: Params<Nothing>,
) -> Result<Json<ConfirmedClock>, ApiError> {
    detached(async move {
        let newest = app.store.newest_entry_at().await?;
        let (before, host) = (app.clock.wall(), app.clock.host());
        let doubt = app.clock.doubt().map(|doubt| doubt.to_string());
        let moved_ms = host.as_millisecond() - before.as_millisecond();
        let detail = json!({
            "moved_ms": moved_ms, "doubt": doubt, "newest_ms": newest.map(Timestamp::as_millisecond),
        });
        let audit_entry = AuditRow {
            at: host,
            who: organizer.key.id.clone(),
            action: CONFIRMED,
            subject: "clock".to_owned(),
            detail,
            shown: None,
        };
        app.store.keep(vec![Entry::Audit(Box::new(audit_entry))]).await?;
        app.clock.confirm();
        tracing::warn!(now = %app.clock.wall(), moved_ms, "an organizer confirmed the clock");
        Ok(Json(ConfirmedClock { now: app.clock.wall().into(), moved_ms, doubt }))
    })
    .await
}
