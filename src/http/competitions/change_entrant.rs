//! `PATCH` and `DELETE /api/v1/competitions/{id}/entrants/{entrant}`.

use serde_json::json;

use super::super::audit::audit_entry;
use super::super::auth::Credential;
use super::super::prelude::*;
use super::check_not_over;
use crate::competitions::StoredEntrant;
use crate::keys::Key;
use crate::store::entries::{EntrantFacts, Entry};
use crate::store::tokens::Grant;
use swarmbench_boards::competition::EntrantStatus;
use swarmbench_boards::competition::entrant::CONTACT_CHARS_MAX;
use swarmbench_protocol::competition::{EntrantChange, EntrantSummary};

/// Change an entrant: organizers decide about it, and an entrant may rename and withdraw itself.
///
/// An entrant that is withdrawn or disqualified stays on the board without a rank, with the reason. Organizers reinstate it
/// with the status `active`, and vouch for its model. A disqualification ends everything that the entrant plays.
#[utoipa::path(
    patch,
    path = "/api/v1/competitions/{id}/entrants/{entrant}",
    operation_id = "change_entrant",
    tag = "competitions",
    request_body(content = EntrantChange, description = "At most 256 KiB"),
    responses(
        (status = 200, description = "The entrant after the change", body = EntrantSummary),
        (status = 403, description = "`forbidden`: not the key of an organizer or of this entrant; a field that only organizers change; the entrant has used up its renamings"),
        (status = 409, description = "`closed`: the competition is over, and names no longer change; or the entrant was erased"),
    )
)]
pub(in super::super) async fn change_entrant(
    State(app): State<App>,
    caller: Caller,
    credential: Credential,
    Id((id, entrant)): Id<(String, String)>,
    _: Params<Nothing>,
    Json(change, _): Json<EntrantChange>,
) -> Result<axum::Json<EntrantSummary>, ApiError> {
    let wanted = Wanted::of(&app, change)?;
    detached(async move {
        let check = |stored: &StoredEntrant| wanted.check(&caller, stored);
        // The lock also keeps others from entering with the same name.
        let (competition, _lock, before) = app.lock_entrant(&id, &entrant, check).await?;
        let mut entries = Vec::from_iter(credential.check());
        let has_contact = wanted.contact.is_some();
        // The audit log does not name the old or the new name: they may be erased.
        let mut rewritten = Vec::new();
        if let Some(name) = wanted.name.filter(|name| *name != before.entrant.name) {
            check_not_over(&competition)?;
            app.check_name_is_free(&competition, Some(before.key), &name).await?;
            let by_itself = !caller.is_organizer();
            entries.push(Entry::RenameEntrant { entry: before.key, name, by_itself });
            if by_itself {
                let key = check_renames(&app, &caller, &before)?;
                let shown = json!({ "rewritten": ["name"] });
                let detail = json!({ "rewritten": ["name"], "competition": id });
                let shown = Some((competition.key, shown));
                entries.push(audit_entry(&app, &key.id, "entrant.rename", &entrant, detail, shown));
            }
            rewritten.push("name");
        }
        if has_contact {
            rewritten.push("contact");
        }
        let Wanted { status, reason, vouched, category, accepts_terms, contact, .. } = wanted;
        // Only organizers change what is in the published file.
        if accepts_terms.is_some() || (status.is_some() && !caller.is_organizer()) {
            check_not_over(&competition)?;
        }
        let is_excluded = status == Some(EntrantStatus::Disqualified);
        let entry = before.key;
        let old = &before.entrant;
        if category.is_some() || accepts_terms.is_some() || contact.is_some() {
            let definition = &competition.definition;
            let mut problems = Problems::default();
            if category.is_some() {
                check_not_over(&competition)?;
                problems.check("category", definition.category_problem(category.as_deref()));
            }
            if accepts_terms.is_some() {
                problems.check("accepts_terms", definition.terms_problem(accepts_terms));
            }
            problems.none_or(Some(()))?;
            entries.push(Entry::DescribeEntrant(Box::new(EntrantFacts {
                entry,
                category: category.clone().or_else(|| old.category.clone()),
                terms: accepts_terms.or(old.terms),
                contact: contact.or(before.contact.clone()).filter(|contact| !contact.is_empty()),
            })));
        }
        let reason = if status.is_some() { reason } else { old.reason.clone() };
        let status = status.unwrap_or(old.status);
        let vouched = vouched.unwrap_or(old.vouched);
        // Unchanged fields are not logged.
        let has_status = (status, &reason) != (old.status, &old.reason);
        let is_moved = category.is_some() && category != old.category;
        let is_decided = has_status || vouched != old.vouched || is_moved;
        let mut shown = json!({});
        if is_decided {
            let status = status.name();
            shown = json!({ "vouched": vouched });
            // After the end the published file contains actions with a status, and no others.
            if has_status {
                shown["status"] = json!(status);
                shown["reason"] = json!(reason);
            }
            if vouched != old.vouched {
                shown["was_vouched"] = json!(old.vouched);
            }
            if is_moved {
                shown["category"] = json!({ "from": old.category, "to": category });
            }
            entries.push(Entry::SetEntrant { entry, status, reason, vouched });
        }
        if !rewritten.is_empty() {
            shown["rewritten"] = json!(rewritten);
        }
        if is_decided || !rewritten.is_empty() {
            let mut detail = shown.clone();
            detail["competition"] = json!(id);
            // Contacts concern organizers alone.
            let is_public = is_decided || rewritten != ["contact"];
            let shown = is_public.then_some((competition.key, shown));
            entries.extend(caller.audit_entry(&app, "entrant.change", &entrant, detail, shown));
        }
        if is_excluded {
            app.exclude(&competition, std::slice::from_ref(&before), entries).await?;
        } else {
            app.store.keep(entries).await?;
        }
        let after = app.entrant(&competition, &entrant).await?;
        Ok(axum::Json((&after.entrant).into()))
    })
    .await
}

/// Erase the personal data of an entrant: its name, the address from which it entered, and the key that was made for it.
///
/// An entrant that is erased before the end is withdrawn. Everything that it plays ends. Journals stay unchanged, and so does
/// the published file of a competition that is over, which includes the name. Organizers and the one who entered may erase an
/// entrant, other members of its team may not; it cannot be undone.
#[utoipa::path(
    delete,
    path = "/api/v1/competitions/{id}/entrants/{entrant}",
    operation_id = "erase_entrant",
    tag = "competitions",
    responses(
        (status = 200, description = "The entrant as it is shown from now on", body = EntrantSummary),
        (status = 403, description = "`forbidden`: neither an organizer's key nor the key with which this entrant entered"),
    )
)]
pub(in super::super) async fn erase_entrant(
    State(app): State<App>,
    caller: Caller,
    credential: Credential,
    Id((id, entrant)): Id<(String, String)>,
    _: Params<Nothing>,
) -> Result<axum::Json<EntrantSummary>, ApiError> {
    detached(async move {
        let check = |stored: &StoredEntrant| check_own(&caller, stored);
        let (competition, _lock, before) = app.lock_entrant(&id, &entrant, check).await?;
        if !caller.is_organizer() && !app.is_founder(&caller, &before).await? {
            let detail = "a team is erased with the key with which it entered, or by an organizer; other members can remove themselves";
            return Err(ApiError::new(Code::Forbidden, detail));
        }
        if !before.entrant.erased {
            // The lock keeps the competition from being revealed meanwhile.
            let _open = app.runs.block_reveal().await;
            let (entry, at) = (before.key, app.clock.wall());
            let name = format!("erased {entrant}");
            let mut entries = Vec::from_iter(credential.check());
            entries.push(Entry::EraseEntrant { entry, name, at });
            let competition = app.stored_competition(&id).await?;
            // The reason of a withdrawal may be the entrant's own words, and is replaced; an organizer's decision stays.
            let stays = before.entrant.status == EntrantStatus::Disqualified;
            if competition.revealed_at.is_none() && !stays {
                let status = EntrantStatus::Withdrawn.name();
                let reason = Some("its personal data were erased".to_owned());
                let vouched = before.entrant.vouched;
                entries.push(Entry::SetEntrant { entry, status, reason, vouched });
            }
            let detail = json!({ "competition": id });
            let shown = Some((competition.key, json!({})));
            entries.extend(caller.audit_entry(&app, "entrant.erase", &entrant, detail, shown));
            app.exclude(&competition, std::slice::from_ref(&before), entries).await?;
        }
        // The key that was made for the entrant is no longer valid.
        let is_own =
            |grant: &Grant| matches!(grant, Grant::Key(key) if key.number == Some(before.owner));
        app.revoked(is_own).await?;
        let after = app.entrant(&competition, &entrant).await?;
        Ok(axum::Json((&after.entrant).into()))
    })
    .await
}

/// Refuses callers other than organizers and the holder of the entrant's key.
fn check_own(caller: &Caller, entrant: &StoredEntrant) -> Result<(), ApiError> {
    caller.check_not_judge()?;
    let key = caller.needs_key()?;
    if caller.is_organizer() || key.number == Some(entrant.owner) {
        return Ok(());
    }
    let detail = "an entrant is changed with its own key, or that of an organizer";
    Err(ApiError::new(Code::Forbidden, detail))
}

/// Checked change.
struct Wanted {
    name: Option<String>,
    status: Option<EntrantStatus>,
    reason: Option<String>,
    vouched: Option<bool>,
    category: Option<String>,
    accepts_terms: Option<u32>,
    contact: Option<String>,
}

impl Wanted {
    fn of(app: &App, change: EntrantChange) -> Result<Self, ApiError> {
        let EntrantChange { name, status, reason, vouched, category, accepts_terms, contact } =
            change;
        let status = match status.as_deref() {
            None => None,
            Some(name) => Some(EntrantStatus::parse(name).ok_or_else(|| {
                let names = EntrantStatus::ALL.map(EntrantStatus::name).join(", ");
                ApiError::field("status", format!("must be one of {names}"))
            })?),
        };
        let mut problems = Problems::default();
        let name = name.and_then(|name| App::entrant_name(&mut problems, &name));
        if let Some(reason) = &reason {
            problems.text("reason", reason, app.limits.reason_chars_max);
        }
        if let Some(contact) = contact.as_ref().filter(|contact| !contact.is_empty()) {
            problems.text("contact", contact, CONTACT_CHARS_MAX);
        }
        match (status, &reason) {
            (Some(EntrantStatus::Disqualified), None) => {
                problems.refuse("reason", "is missing: everybody is to see why".to_owned());
            }
            (None | Some(EntrantStatus::Active), Some(_)) => {
                let problem = "belongs to a status of withdrawn or disqualified";
                problems.refuse("reason", problem.to_owned());
            }
            _ => {}
        }
        problems.none_or(Some(Self {
            name,
            status,
            reason,
            vouched,
            category,
            accepts_terms,
            contact,
        }))
    }

    /// Refuses changes of this entrant that the caller may not make.
    fn check(&self, caller: &Caller, entrant: &StoredEntrant) -> Result<(), ApiError> {
        check_own(caller, entrant)?;
        let is_again = self.name.is_some()
            || self.contact.is_some()
            || self.status == Some(EntrantStatus::Active);
        if entrant.entrant.erased && (is_again || !caller.is_organizer()) {
            let detail =
                "this entrant was erased, which cannot be undone: it may enter another competition";
            return Err(ApiError::new(Code::Closed, detail));
        }
        let refused = |detail: &str| Err(ApiError::new(Code::Forbidden, detail));
        if caller.is_organizer() {
            let own = caller.needs_key()?.number == Some(entrant.owner);
            return if self.accepts_terms.is_some() && !own {
                refused("an entrant accepts terms itself, with its own key")
            } else {
                Ok(())
            };
        }
        if self.category.is_some() {
            return refused("only an organizer moves an entrant to another category");
        }
        if self.vouched.is_some() {
            return refused("only an organizer vouches for a model");
        }
        let is_contact = self.contact.is_some()
            && (&self.name, self.status, self.accepts_terms) == (&None, None, None);
        if entrant.entrant.status == EntrantStatus::Disqualified && !is_contact {
            return refused("this entrant is disqualified: only an organizer changes it");
        }
        match self.status {
            None | Some(EntrantStatus::Withdrawn) => Ok(()),
            Some(EntrantStatus::Active) => refused("only an organizer takes an entrant back"),
            Some(EntrantStatus::Disqualified) => {
                refused("only an organizer disqualifies an entrant")
            }
        }
    }
}

/// Key of an entrant that may rename itself once more.
fn check_renames<'c>(
    app: &App,
    caller: &'c Caller,
    entrant: &StoredEntrant,
) -> Result<&'c Key, ApiError> {
    let most = app.limits.renames_max;
    if entrant.renames >= most {
        let detail = format!("this entrant has had {most} other names, the maximum");
        return Err(ApiError::limit(Code::Forbidden, "renames_max", most as usize, detail));
    }
    caller.needs_key()
}
