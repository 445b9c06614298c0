//! `POST /api/v1/competitions/{id}/exclusions`: exclusion of many entrants at once.

use std::net::IpAddr;

use axum::Json as JsonBody;
use ipnet::IpNet;
use jiff::Timestamp;
use serde_json::json;
use wildmatch::WildMatch;

use super::super::prelude::*;
use crate::competitions::{self, StoredEntrant};
use crate::store::competitions::Declared;
use crate::store::entries::Entry;
use swarmbench_boards::competition::EntrantStatus;
use swarmbench_protocol::competition::{Exclusion, ExclusionRequest};

/// Maximum entrants in an answer.
const SHOWN_MAX: usize = 1000;

/// Disqualify all active entrants that match a description, after a preview.
///
/// Without `count` the answer is a preview: it shows the matching entrants, and nothing is done. With the `count` of the
/// preview they are disqualified; if their number has changed since, nothing is done.
#[utoipa::path(
    post,
    path = "/api/v1/competitions/{id}/exclusions",
    operation_id = "exclude_entrants",
    tag = "competitions",
    request_body(content = ExclusionRequest, description = "At most 256 KiB"),
    responses(
        (status = 200, description = "The entrants that were excluded, or would be", body = Exclusion),
        (status = 403, description = "`forbidden`: not an organizer's key"),
        (status = 409, description = "`closed`: another number of entrants matches than in the preview"),
    )
)]
pub(in super::super) async fn exclude_entrants(
    State(app): State<App>,
    organizer: Organizer,
    Id(id): Id,
    _: Params<Nothing>,
    Json(request, _): Json<ExclusionRequest>,
) -> Result<JsonBody<Exclusion>, ApiError> {
    let wanted = Description::of(&app, &request)?;
    detached(async move {
        let competition = app.stored_competition(&id).await?;
        // The lock keeps others from entering, and serializes decisions of organizers.
        let _lock = app.lock_entrants(&competition).await;
        let all =
            competitions::entrants(&app.store, competition.key, None, Declared::Short).await?;
        let found: Vec<StoredEntrant> = all.into_iter().filter(|one| wanted.fits(one)).collect();
        let count = u32::try_from(found.len()).unwrap_or(u32::MAX);
        let excluded = match request.count {
            None => false,
            Some(seen) if seen != count => {
                let detail = format!(
                    "{count} entrants fit now, and count is {seen}: look at the preview again, without count"
                );
                return Err(ApiError::new(Code::Closed, detail));
            }
            Some(_) => {
                let reason = request.reason;
                let ids: Vec<&str> = found.iter().map(|one| one.entrant.id.as_str()).collect();
                let detail = json!({ "description": wanted.text, "entrants": ids, "reason": reason });
                let shown = json!({ "entrants": ids, "reason": reason });
                let exclude = |one: &StoredEntrant| Entry::SetEntrant {
                    entry: one.key,
                    status: EntrantStatus::Disqualified.name(),
                    reason: reason.clone(),
                    vouched: one.entrant.vouched,
                };
                let mut entries: Vec<Entry> = found.iter().map(exclude).collect();
                let shown = (competition.key, shown);
                let audit_entry =
                    organizer.audit_entry_shown(&app, "entrants.exclude", &id, detail, shown);
                entries.push(audit_entry);
                app.exclude(&competition, &found, entries).await?;
                true
            }
        };
        let mut items = Vec::with_capacity(found.len().min(SHOWN_MAX));
        for one in found.into_iter().take(SHOWN_MAX) {
            let now = if excluded { app.entrant(&competition, &one.entrant.id).await? } else { one };
            items.push((&now.entrant).into());
        }
        Ok(JsonBody(Exclusion { excluded, count, items }))
    })
    .await
}

/// Description of the entrants.
struct Description {
    /// Description as it was sent, for the audit log.
    text: serde_json::Value,
    network: Option<IpNet>,
    from: Option<Timestamp>,
    before: Option<Timestamp>,
    name: Option<WildMatch>,
}

impl Description {
    fn of(app: &App, request: &ExclusionRequest) -> Result<Self, ApiError> {
        let ExclusionRequest { address, registered_from, registered_before, name, count, reason } =
            request;
        let mut problems = Problems::default();
        let network = address.as_ref().map(|address| {
            address.parse().or_else(|_| address.parse::<IpAddr>().map(IpNet::from)).map_err(|_| {
                let problem = "must be an address or a network, like 203.0.113.7 or 2001:db8::/32";
                problems.refuse("address", problem.to_owned());
            })
        });
        if let Some(name) = name {
            problems.text("name", name, crate::keys::NAME_CHARS_MAX);
        }
        match reason {
            Some(reason) => problems.text("reason", reason, app.limits.reason_chars_max),
            None if count.is_some() => {
                problems.refuse("reason", "is missing: everybody is to see why".to_owned());
            }
            None => {}
        }
        if address.is_none()
            && name.is_none()
            && registered_from.is_none()
            && registered_before.is_none()
        {
            let problem = "is missing: give at least one of address, registered_from, registered_before and name";
            problems.refuse("name", problem.to_owned());
        }
        problems.none_or(Some(Self {
            text: json!({
                "address": address, "registered_from": registered_from,
                "registered_before": registered_before, "name": name,
            }),
            network: network.and_then(Result::ok),
            from: registered_from.map(Into::into),
            before: registered_before.map(Into::into),
            name: name.as_deref().map(WildMatch::new_case_insensitive),
        }))
    }

    fn fits(&self, one: &StoredEntrant) -> bool {
        let entrant = &one.entrant;
        let has_address =
            |network: &IpNet| one.address.is_some_and(|address| network.contains(&address));
        entrant.status == EntrantStatus::Active
            && self.network.as_ref().is_none_or(has_address)
            && self.from.is_none_or(|from| from <= entrant.registered_at)
            && self.before.is_none_or(|before| entrant.registered_at < before)
            && self.name.as_ref().is_none_or(|name| name.matches(&entrant.name))
    }
}
