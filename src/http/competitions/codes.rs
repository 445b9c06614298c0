//! `/api/v1/competitions/{id}/codes`: creation, listing and revocation of invitation codes.

use axum::http::StatusCode;
use serde_json::{Value, json};

use super::super::answer::with_tokens;
use super::super::page::{PageParams, ROWS_MAX};
use super::super::prelude::*;
use super::check_open;
use crate::competitions::StoredCompetition;
use crate::ids::{Token, TokenHash, TokenKind};
use crate::keys::NAME_CHARS_MAX;
use crate::store::competitions::StoredInvitation;
use crate::store::entries::Entry;
use swarmbench_protocol::competition::{
    CodesRequest, InvitationCode, InvitationCodes, InvitationList, InvitationSummary,
    RevokeCodesRequest,
};
use swarmbench_protocol::names;

/// Maximum codes of one request.
const CODES_MAX: usize = 1000;

/// Make invitation codes, each good for one entrant.
///
/// The codes are shown only once; the server stores only their hashes.
#[utoipa::path(
    post,
    path = "/api/v1/competitions/{id}/codes",
    operation_id = "create_codes",
    tag = "competitions",
    request_body(content = CodesRequest, description = "At most 256 KiB"),
    responses(
        (status = 201, description = "The codes", body = InvitationCodes),
        (status = 403, description = "`forbidden`: not an organizer's key"),
        (status = 409, description = "`closed`: the competition takes no more entrants"),
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
    check_open(&stored, now)?;
    let tokens: Vec<Token> =
        labels.iter().map(|_| Token::new(TokenKind::Invitation, &*app.entropy)).collect();
    let codes = tokens.iter().zip(&labels).map(|(token, label)| (token.hash(), label.clone()));
    let entry = Entry::AddInvitations { competition: stored.key, codes: codes.collect(), at: now };
    let detail = codes_detail(labels.len());
    let shown = (stored.key, detail.clone());
    let audit_entry = organizer.audit_entry_shown(&app, "competition.codes", &id, detail, shown);
    app.store.keep(vec![entry, audit_entry]).await?;
    let items = tokens
        .iter()
        .zip(labels)
        .map(|(token, label)| InvitationCode { label, code: token.reveal().to_owned() });
    let body = InvitationCodes { items: items.collect() };
    Ok(with_tokens(StatusCode::CREATED, body))
}

/// List the invitation codes of a competition by their labels, with the entrants that used them.
#[utoipa::path(
    get,
    path = "/api/v1/competitions/{id}/codes",
    operation_id = "list_codes",
    tag = "competitions",
    params(PageParams),
    responses(
        (status = 200, description = "The codes, without the codes themselves", body = InvitationList),
        (status = 403, description = "`forbidden`: not the key of an organizer or a judge"),
    )
)]
pub(in super::super) async fn list_codes(
    State(app): State<App>,
    _: Overseer,
    Id(id): Id,
    Params(params): Params<PageParams>,
) -> Result<Response, ApiError> {
    let stored = app.stored_competition(&id).await?;
    let page = params.page(&app)?;
    let mut place = page.place().unwrap_or(0);
    page.fill(
        ROWS_MAX,
        |after, rows| {
            let skip = u32::try_from(after.unwrap_or(0)).unwrap_or(u32::MAX);
            app.store.list_invitations(stored.key, skip, rows)
        },
        |row| {
            place += 1;
            Ok((place, summary(row)))
        },
    )
    .await
}

/// Revoke unused invitation codes: all with a label, or single codes.
///
/// An entrant that has entered with a code stays; exclude the entrant instead. Revoking a code again changes nothing.
#[utoipa::path(
    post,
    path = "/api/v1/competitions/{id}/codes/revoke",
    operation_id = "revoke_codes",
    tag = "competitions",
    request_body(content = RevokeCodesRequest, description = "At most 256 KiB"),
    responses(
        (status = 200, description = "The codes that were revoked", body = InvitationList),
        (status = 403, description = "`forbidden`: not an organizer's key"),
    )
)]
pub(in super::super) async fn revoke_codes(
    State(app): State<App>,
    organizer: Organizer,
    Id(id): Id,
    _: Params<Nothing>,
    Json(request, _): Json<RevokeCodesRequest>,
) -> Result<axum::Json<InvitationList>, ApiError> {
    let RevokeCodesRequest { labels, codes } = request;
    let count = labels.len() + codes.len();
    if !(1..=CODES_MAX).contains(&count) {
        let problem = format!("must be 1 to {CODES_MAX} together with codes, are {count}");
        return Err(ApiError::field("labels", problem));
    }
    detached(async move {
        let stored = app.stored_competition(&id).await?;
        // The lock keeps entrants from using the codes meanwhile.
        let _lock = app.lock_entrants(&stored).await;
        let mut found = Vec::new();
        for (place, label) in labels.iter().enumerate() {
            let unused = app.store.unused_invitations(stored.key, label).await?;
            if unused.is_empty() {
                let problem = format!("there is no unused code with the label {label:?}");
                return Err(ApiError::field(&format!("labels[{place}]"), problem));
            }
            found.extend(unused);
        }
        for (place, code) in codes.iter().enumerate() {
            let named = named(&app, &stored, code).await?;
            found.push(
                named.map_err(|problem| ApiError::field(&format!("codes[{place}]"), problem))?,
            );
        }
        let at = app.clock.wall();
        let new = found.iter().filter(|code| code.revoked_at.is_none());
        let hashes: Vec<TokenHash> = new.map(|code| code.hash).collect();
        if !hashes.is_empty() {
            let detail = codes_detail(hashes.len());
            let shown = (stored.key, detail.clone());
            let audit_entry =
                organizer.audit_entry_shown(&app, "competition.codes.revoke", &id, detail, shown);
            app.store.keep(vec![Entry::RevokeInvitations { hashes, at }, audit_entry]).await?;
        }
        let revoked = |code: StoredInvitation| {
            let revoked_at = code.revoked_at.or(Some(at));
            summary(StoredInvitation { revoked_at, ..code })
        };
        let items = found.into_iter().map(revoked).collect();
        Ok(axum::Json(InvitationList { items, next_cursor: None }))
    })
    .await
}

/// Detail of the audit log. It omits labels, which may have to be erased.
fn codes_detail(count: usize) -> Value {
    json!({ "codes": count })
}

/// Unused code of this competition, or the problem with it.
async fn named(
    app: &App,
    competition: &StoredCompetition,
    code: &str,
) -> Result<Result<StoredInvitation, String>, ApiError> {
    let token = Token::parse(code.trim()).filter(|token| token.kind() == TokenKind::Invitation);
    let found = match token {
        Some(token) => app.store.find_invitation(competition.key, token.hash()).await?,
        None => None,
    };
    Ok(match found {
        None => Err("is no invitation code of this competition".to_owned()),
        Some(StoredInvitation { entrant: Some(entrant), .. }) => {
            Err(format!("was used by {entrant}: exclude that entrant instead"))
        }
        Some(code) => Ok(code),
    })
}

fn summary(code: StoredInvitation) -> InvitationSummary {
    let state = match (&code.entrant, code.revoked_at) {
        (Some(_), _) => "used",
        (None, Some(_)) => "revoked",
        (None, None) => "unused",
    };
    InvitationSummary {
        label: code.label,
        state: state.to_owned(),
        entrant: code.entrant,
        created_at: code.created_at.into(),
        revoked_at: code.revoked_at.map(Into::into),
    }
}
