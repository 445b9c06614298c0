//! `GET /api/v1/audit`: what organizers did.

use axum::extract::State;
use axum::response::Response;
use serde::Deserialize;
use utoipa::IntoParams;

use super::App;
use super::auth::{Caller, Organizer};
use super::error::ApiError;
use super::extract::{Params, page_limit, read_cursor};
use super::page::{Page, ROWS_MAX};
use super::refusals::{QueryRefusals, TokenRefusals};
use crate::store::audit::StoredAuditEntry;
use crate::store::entries::{AuditRow, Entry};
use crate::wire::competition::{AuditEntry, AuditLog};
use crate::wire::problem::Problem;

/// Which page is to be shown.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct AuditParams {
    /// How many at most, up to 1,000; 50 where it is left out.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// The `next_cursor` of the page before.
    cursor: Option<String>,
}

/// List what organizers did, newest first.
#[utoipa::path(
    get,
    path = "/api/v1/audit",
    operation_id = "list_audit",
    tag = "competitions",
    params(AuditParams),
    security(("key" = [])),
    responses(
        (status = 200, description = "A page of the audit log", body = AuditLog),
        QueryRefusals,
        TokenRefusals,
        (status = 403, description = "`forbidden`: not an organizer's key", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn list_audit(
    State(app): State<App>,
    _: Organizer,
    Params(params): Params<AuditParams>,
) -> Result<Response, ApiError> {
    let limit = page_limit(&app, params.limit, app.limits.page_items_default)?;
    let mut page = Page::new(&app, read_cursor(params.cursor.as_deref())?, limit).await?;
    while let Some(rows) = page.wants(ROWS_MAX) {
        let audit_entries = app.store.audit(page.place(), rows).await?;
        page.add(rows, audit_entries, |audit_entry| {
            let StoredAuditEntry { number, at, who, action, subject, detail } = audit_entry;
            Ok((number, AuditEntry { at, who, action, subject, detail }))
        })?;
    }
    Ok(page.answer())
}

impl Organizer {
    /// The audit entry of what the organizer does, to be committed with it.
    pub(super) fn audit_entry(
        &self,
        app: &App,
        action: &'static str,
        subject: &str,
        detail: serde_json::Value,
    ) -> Entry {
        audit_entry(app, &self.key.id, action, subject, detail)
    }
}

impl Caller {
    /// The audit entry of what an organizer does, to be committed with it; none for other callers.
    pub(super) fn audit_entry(
        &self,
        app: &App,
        action: &'static str,
        subject: &str,
        detail: serde_json::Value,
    ) -> Option<Entry> {
        match self {
            Self::Key(key) if self.is_organizer() => {
                Some(audit_entry(app, &key.id, action, subject, detail))
            }
            _ => None,
        }
    }
}

fn audit_entry(
    app: &App,
    who: &str,
    action: &'static str,
    subject: &str,
    detail: serde_json::Value,
) -> Entry {
    Entry::Audit(Box::new(AuditRow {
        at: app.clock.wall(),
        who: who.to_owned(),
        action,
        subject: subject.to_owned(),
        detail,
    }))
}
