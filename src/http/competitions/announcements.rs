//! `GET` and `POST /api/v1/competitions/{id}/announcements`.

use axum::Json as JsonBody;
use axum::http::StatusCode;
use serde_json::{Value, json};

use super::super::page::{NewestParams, ROWS_MAX};
use super::super::prelude::*;
use crate::store::audit::ShownAction;
use swarmbench_protocol::competition::{Announcement, AnnouncementRequest, Announcements};
use swarmbench_protocol::names::is_plain_text;

/// Action in the audit log.
const ANNOUNCE: &str = "competition.announce";

/// Maximum characters of an announcement.
const ANNOUNCEMENT_CHARS_MAX: usize = 2_000;

/// List the announcements of a competition, newest first.
#[utoipa::path(
    get,
    path = "/api/v1/competitions/{id}/announcements",
    operation_id = "list_announcements",
    tag = "competitions",
    params(NewestParams),
    responses((status = 200, description = "A page of announcements", body = Announcements))
)]
pub(in super::super) async fn list_announcements(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<NewestParams>,
) -> Result<Response, ApiError> {
    let competition = app.competition(&caller, &id).await?;
    let page = params.page(&app)?;
    page.fill(
        ROWS_MAX,
        |before, rows| app.store.actions_in(competition.key, Some(ANNOUNCE), before, rows),
        |ShownAction { number, at, shown, .. }| {
            let text = shown["text"].as_str().unwrap_or_default().to_owned();
            Ok((number, Announcement { at: at.into(), text }))
        },
    )
    .await
}

/// Announce something to all who follow a competition.
///
/// An announcement never changes; correct a mistake with another one. Announcements are part of the organizers' actions
/// (`GET …/actions`) and of the published file.
#[utoipa::path(
    post,
    path = "/api/v1/competitions/{id}/announcements",
    operation_id = "announce",
    tag = "competitions",
    request_body(content = AnnouncementRequest, description = "At most 256 KiB"),
    responses(
        (status = 201, description = "The announcement", body = Announcement),
        (status = 403, description = "`forbidden`: not an organizer's key"),
    )
)]
pub(in super::super) async fn announce(
    State(app): State<App>,
    organizer: Organizer,
    Id(id): Id,
    _: Params<Nothing>,
    Json(AnnouncementRequest { text }, _): Json<AnnouncementRequest>,
) -> Result<(StatusCode, JsonBody<Announcement>), ApiError> {
    check(&text)?;
    detached(async move {
        let competition = app.stored_competition(&id).await?;
        let shown: Value = json!({ "text": text });
        let at = app.clock.wall();
        let detail = shown.clone();
        let entry =
            organizer.audit_entry_shown(&app, ANNOUNCE, &id, detail, (competition.key, shown));
        app.store.keep(vec![entry]).await?;
        Ok((StatusCode::CREATED, JsonBody(Announcement { at: at.into(), text })))
    })
    .await
}

/// Refuses texts that are empty, too long, or have control characters other than line breaks and tabs.
fn check(text: &str) -> Result<(), ApiError> {
    let chars = text.chars().count();
    if text.trim().is_empty() || chars > ANNOUNCEMENT_CHARS_MAX || !is_plain_text(text) {
        let problem = format!("must be 1 to {ANNOUNCEMENT_CHARS_MAX} characters of plain text");
        return Err(ApiError::field("text", problem));
    }
    Ok(())
}
