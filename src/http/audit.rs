//! `GET /api/v1/audit`: what organizers did.

use axum::extract::State;
use axum::response::Response;

use super::App;
use super::auth::{Caller, Organizer, Overseer};
use super::error::ApiError;
use super::extract::Params;
use super::page::{NewestParams, ROWS_MAX};
use crate::ids::CompetitionKey;
use crate::store::audit::StoredAuditEntry;
use crate::store::entries::{AuditRow, Entry};
use swarmbench_protocol::competition::{AuditEntry, AuditLog};

/// List the audit log, newest first: actions of organizers, what judges read of sealed games, and entrants' own renames.
#[utoipa::path(
    get,
    path = "/api/v1/audit",
    operation_id = "list_audit",
    tag = "competitions",
    params(NewestParams),
    responses(
        (status = 200, description = "A page of the audit log", body = AuditLog),
        (status = 403, description = "`forbidden`: not the key of an organizer or a judge"),
    )
)]
pub(super) async fn list_audit(
    State(app): State<App>,
    _: Overseer,
    Params(params): Params<NewestParams>,
) -> Result<Response, ApiError> {
    let page = params.page(&app)?;
    page.fill(
        ROWS_MAX,
        |before, rows| app.store.audit(before, rows),
        |audit_entry| {
            let StoredAuditEntry { number, at, who, action, subject, detail } = audit_entry;
            Ok((number, AuditEntry { at: at.into(), who, action, subject, detail }))
        },
    )
    .await
}

impl Organizer {
    /// Audit entry of an organizer's action in a competition. `shown` is its public part.
    pub(super) fn audit_entry_shown(
        &self,
        app: &App,
        action: &'static str,
        subject: &str,
        detail: serde_json::Value,
        shown: (CompetitionKey, serde_json::Value),
    ) -> Entry {
        audit_entry(app, &self.key.id, action, subject, detail, Some(shown))
    }

    /// The audit entry of what the organizer does, to be committed with it.
    pub(super) fn audit_entry(
        &self,
        app: &App,
        action: &'static str,
        subject: &str,
        detail: serde_json::Value,
    ) -> Entry {
        audit_entry(app, &self.key.id, action, subject, detail, None)
    }
}

impl Caller {
    /// The audit entry of what an organizer or a judge does, to be committed with it; none for other callers. Everybody sees `shown` of
    /// it in its competition.
    pub(super) fn audit_entry(
        &self,
        app: &App,
        action: &'static str,
        subject: &str,
        detail: serde_json::Value,
        shown: Option<(CompetitionKey, serde_json::Value)>,
    ) -> Option<Entry> {
        match self {
            Self::Key(key) if self.reads_all() => {
                Some(audit_entry(app, &key.id, action, subject, detail, shown))
            }
            _ => None,
        }
    }
}

/// Audit entry of an action by the holder of the key `who`, committed together with the action.
pub(super) fn audit_entry(
    app: &App,
    who: &str,
    action: &'static str,
    subject: &str,
    detail: serde_json::Value,
    shown: Option<(CompetitionKey, serde_json::Value)>,
) -> Entry {
    Entry::Audit(Box::new(AuditRow {
        at: app.clock.wall(),
        who: who.to_owned(),
        action,
        subject: subject.to_owned(),
        detail,
        shown,
    }))
}
