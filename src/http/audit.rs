//! `GET /api/v1/audit`: what organizers did.

use axum::Json;
use axum::extract::State;
use serde::Deserialize;
use serde_json::json;
use utoipa::IntoParams;

use super::App;
use super::auth::{Caller, Organizer};
use super::error::ApiError;
use super::extract::{Page, Params};
use super::openapi::{QueryRefusals, TokenRefusals};
use crate::journal::{AuditRow, Entry};
use crate::keys::OwnerKey;
use crate::wire::competition::{AuditLog, Deed};
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
) -> Result<Json<AuditLog>, ApiError> {
    let page = Page::read(&app, params.limit, params.cursor.as_deref())?;
    let deeds = app.store.audit(page.before, page.limit + 1).await?;
    let (deeds, next_cursor) = page.cut(deeds, |deed| deed.number);
    let items = deeds.into_iter().map(|deed| Deed {
        at: deed.at,
        who: deed.who,
        action: deed.action,
        subject: deed.subject,
        detail: deed.detail,
    });
    Ok(Json(AuditLog { items: items.collect(), next_cursor }))
}

impl Organizer {
    /// What the organizer does, to be kept with the deed itself.
    pub(super) fn deed(
        &self,
        app: &App,
        action: &'static str,
        subject: &str,
        detail: serde_json::Value,
    ) -> Entry {
        deed(app, &self.0, action, subject, detail)
    }
}

impl Caller {
    /// What an organizer does to something of somebody else, to be kept with the deed itself; none of
    /// anybody else, and of what is the organizer's own.
    pub(super) fn deed_for(
        &self,
        app: &App,
        owner: Option<OwnerKey>,
        action: &'static str,
        subject: &str,
    ) -> Option<Entry> {
        let is_own = matches!(self, Self::Key(key) if owner.is_some() && key.number == owner);
        self.deed(app, action, subject, json!({})).filter(|_| !is_own)
    }

    /// What an organizer does, to be kept with the deed itself; none of anybody else.
    pub(super) fn deed(
        &self,
        app: &App,
        action: &'static str,
        subject: &str,
        detail: serde_json::Value,
    ) -> Option<Entry> {
        match self {
            Self::Key(key) if self.is_organizer() => {
                Some(deed(app, &key.id, action, subject, detail))
            }
            _ => None,
        }
    }
}

fn deed(
    app: &App,
    who: &str,
    action: &'static str,
    subject: &str,
    detail: serde_json::Value,
) -> Entry {
    Entry::Audit(Box::new(AuditRow {
        at: app.clock.now(),
        who: who.to_owned(),
        action,
        subject: subject.to_owned(),
        detail,
    }))
}
