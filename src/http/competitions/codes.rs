//! `POST /api/v1/competitions/{id}/codes`.

use axum::http::StatusCode;
use serde_json::json;

use super::super::answer::with_tokens;
use super::super::prelude::*;
use crate::ids::{Token, TokenKind};
use crate::keys::NAME_CHARS_MAX;
use crate::store::entries::Entry;
use swarmbench_protocol::competition::{CodesRequest, InvitationCode, InvitationCodes};
use swarmbench_protocol::names;

/// Codes that are made at once.
const CODES_MAX: usize = 1000;

/// Make invitation codes, each good for one entrant.
///
/// They are shown only once; only their hashes are stored.
#[utoipa::path(
    post,
    path = "/api/v1/competitions/{id}/codes",
    operation_id = "create_codes",
    tag = "competitions",
    params(("id" = String, Path, description = "The competition's id")),
    request_body(content = CodesRequest, description = "At most 256 KiB"),
    security(("key" = [])),
    responses(
        (status = 201, description = "The codes", body = InvitationCodes),
        (status = 403, description = "`forbidden`: not an organizer's key"),
        (status = 409, description = "`closed`: nobody enters it any more"),
    )
)]
pub(in super::super) async fn create_codes(
    State(app): State<App>,
    organizer: Organizer,
    Id(id): Id,
    _: Params<Nothing>,
    Json(request, _): Json<CodesRequest>,
) -> Result<Response, ApiError> {
    let stored = app.stored_competition(&id).await?;
    let labels = request.labels;
    if !(1..=CODES_MAX).contains(&labels.len()) {
        let is = labels.len();
        return Err(ApiError::field("labels", format!("must be 1 to {CODES_MAX}, are {is}")));
    }
    for (place, label) in labels.iter().enumerate() {
        if let Err(problem) = names::check(label, NAME_CHARS_MAX) {
            return Err(ApiError::field(&format!("labels[{place}]"), problem));
        }
    }
    let now = app.clock.wall();
    if stored.definition.closes_at <= now {
        let detail = format!("the competition closed at {}", stored.definition.closes_at);
        return Err(ApiError::new(Code::Closed, detail));
    }
    let tokens: Vec<Token> =
        labels.iter().map(|_| Token::new(TokenKind::Invitation, &*app.entropy)).collect();
    let codes = tokens.iter().zip(&labels).map(|(token, label)| (token.hash(), label.clone()));
    let entry = Entry::AddInvitations { competition: stored.key, codes: codes.collect(), at: now };
    let audit_entry =
        organizer.audit_entry(&app, "competition.codes", &id, json!({ "labels": labels }));
    app.store.keep(vec![entry, audit_entry]).await?;
    let items = tokens
        .iter()
        .zip(labels)
        .map(|(token, label)| InvitationCode { label, code: token.reveal().to_owned() });
    let body = InvitationCodes { items: items.collect() };
    Ok(with_tokens(StatusCode::CREATED, body))
}
