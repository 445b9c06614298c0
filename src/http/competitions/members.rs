//! Members of a team: `/api/v1/competitions/{id}/entrants/{entrant}/members`.

use axum::Json as JsonBody;
use axum::http::StatusCode;
use serde_json::json;

use super::super::answer::with_tokens;
use super::super::auth::Credential;
use super::super::prelude::*;
use super::start::check_active;
use super::{check_not_erased, check_not_over};
use crate::competitions::StoredEntrant;
use crate::keys::{Key, KeyRow, Role};
use crate::store::entries::Entry;
use swarmbench_protocol::competition::{CreatedMember, MemberList, MemberRequest, MemberSummary};
use swarmbench_protocol::names::is_look_alike;

/// List the members of a team, for the team, organizers and judges.
#[utoipa::path(
    get,
    path = "/api/v1/competitions/{id}/entrants/{entrant}/members",
    operation_id = "list_members",
    tag = "competitions",
    responses(
        (status = 200, description = "The members", body = MemberList),
        (status = 403, description = "`forbidden`: not a key of this team"),
    )
)]
pub(in super::super) async fn list_members(
    State(app): State<App>,
    caller: Caller,
    Id((id, entrant)): Id<(String, String)>,
    _: Params<Nothing>,
) -> Result<JsonBody<MemberList>, ApiError> {
    let key = caller.needs_key()?;
    let competition = app.competition(&caller, &id).await?;
    let entrant = app.entrant(&competition, &entrant).await?;
    if !caller.reads_all() && key.number != Some(entrant.owner) {
        return Err(not_the_team());
    }
    let members = app.store.team_keys(entrant.owner).await?;
    Ok(JsonBody(MemberList { items: members.iter().map(summary).collect() }))
}

/// Add a member to a team: it gets its own key, with the same rights as the entrant's key.
///
/// The team or an organizer adds members until the competition is over. A team has at most 20 members besides the one who
/// entered, and its entrant entered without a key of its own.
#[utoipa::path(
    post,
    path = "/api/v1/competitions/{id}/entrants/{entrant}/members",
    operation_id = "add_member",
    tag = "competitions",
    request_body(content = MemberRequest, description = "At most 256 KiB"),
    responses(
        (status = 201, description = "The member, with its key, shown only once", body = CreatedMember),
        (status = 403, description = "`forbidden`: neither a key of this team nor of an organizer; the team is full, was disqualified or has withdrawn"),
        (status = 409, description = "`closed`: the competition is over; the entrant was erased, or entered with a key of its own"),
    )
)]
pub(in super::super) async fn add_member(
    State(app): State<App>,
    caller: Caller,
    credential: Credential,
    Id((id, entrant)): Id<(String, String)>,
    _: Params<Nothing>,
    Json(MemberRequest { name }, _): Json<MemberRequest>,
) -> Result<Response, ApiError> {
    let mut problems = Problems::default();
    let name = App::entrant_name(&mut problems, &name);
    let name = problems.none_or(name)?;
    detached(async move {
        let check = |stored: &StoredEntrant| check_team(&caller, stored);
        let (competition, _lock, stored) = app.lock_entrant(&id, &entrant, check).await?;
        check_not_over(&competition)?;
        let closed = |detail: &str| Err(ApiError::new(Code::Closed, detail));
        check_not_erased(&stored)?;
        check_active(&stored)?;
        let first = app.store.key(stored.owner).await?;
        if first.is_none_or(|key| key.role != Role::Entrant) {
            return closed(
                "this entrant entered with a key of its own, whose other rights are not shared: a team enters without a key, and \
                 gets one",
            );
        }
        let all = app.store.team_keys(stored.owner).await?;
        let mut members = all.iter().filter(|key| key.revoked_at.is_none());
        let now = members.clone().count();
        if members.any(|member| is_look_alike(&member.name, &name)) {
            return Err(ApiError::field("name", "is that of another member of the team"));
        }
        for (count, most, limit, what) in [
            (now, app.limits.members_max, "members_max", "remove one who has left"),
            (all.len(), app.limits.members_ever_max, "members_ever_max", "removed ones count, too"),
        ] {
            if count >= most {
                let detail = format!("the team has {count} members, the maximum: {what}");
                return Err(ApiError::limit(Code::Forbidden, limit, most, detail));
            }
        }
        let (key, token) = Key::new(Role::Entrant, &name, None, app.clock.wall(), &*app.entropy)
            .map_err(|problem| ApiError::field("name", problem))?;
        let member = summary(&key);
        let row = KeyRow { key, hash: token.hash(), acts_for: Some(stored.owner) };
        let mut entries = Vec::from_iter(credential.check());
        entries.push(Entry::AddKey(Box::new(row)));
        let detail = json!({ "competition": id, "member": member.id });
        let shown = Some((competition.key, json!({})));
        entries.extend(caller.audit_entry(&app, "member.add", &entrant, detail, shown));
        app.store.keep(entries).await?;
        let body = CreatedMember { member, key: token.reveal().to_owned() };
        Ok(with_tokens(StatusCode::CREATED, body))
    })
    .await
}

/// Remove a member from a team: revokes its key and the tokens of everything that the team plays.
///
/// The team continues with new tokens: `POST /runs/{id}/token`. Organizers and the one who entered remove any member; other
/// members remove only themselves.
#[utoipa::path(
    delete,
    path = "/api/v1/competitions/{id}/entrants/{entrant}/members/{member}",
    operation_id = "remove_member",
    tag = "competitions",
    responses(
        (status = 200, description = "The member", body = MemberSummary),
        (status = 403, description = "`forbidden`: not the key of this member, of the one who entered, or of an organizer"),
    )
)]
pub(in super::super) async fn remove_member(
    State(app): State<App>,
    caller: Caller,
    credential: Credential,
    Id((id, entrant, member)): Id<(String, String, String)>,
    _: Params<Nothing>,
) -> Result<JsonBody<MemberSummary>, ApiError> {
    // A detached task removes the revoked key from the cache, even if the client hangs up.
    detached(async move {
        let check = |stored: &StoredEntrant| check_team(&caller, stored);
        let (competition, _lock, stored) = app.lock_entrant(&id, &entrant, check).await?;
        let is_own = matches!(&caller, Caller::Key(key) if key.id == member);
        if !is_own && !caller.is_organizer() && !app.is_founder(&caller, &stored).await? {
            let detail = "a member is removed with its own key, with that with which the team entered, or by an organizer";
            return Err(ApiError::new(Code::Forbidden, detail));
        }
        let find = async || {
            let keys = app.store.team_keys(stored.owner).await?;
            let found = keys.into_iter().find(|key| key.id == member);
            found.ok_or_else(|| ApiError::not_found("the member"))
        };
        if find().await?.revoked_at.is_none() {
            let at = app.clock.wall();
            let mut entries = Vec::from_iter(credential.check());
            entries.push(Entry::RevokeKey { id: member.clone(), at });
            let detail = json!({ "competition": id, "member": member });
            let shown = Some((competition.key, json!({})));
            entries.extend(caller.audit_entry(&app, "member.remove", &entrant, detail, shown));
            app.store.keep(entries).await?;
        }
        app.key_revoked(&member).await?;
        Ok(JsonBody(summary(&find().await?)))
    })
    .await
}

/// Refuses callers other than the team and organizers.
fn check_team(caller: &Caller, entrant: &StoredEntrant) -> Result<(), ApiError> {
    caller.check_not_judge()?;
    let key = caller.needs_key()?;
    if caller.is_organizer() || key.number == Some(entrant.owner) {
        return Ok(());
    }
    Err(not_the_team())
}

fn not_the_team() -> ApiError {
    let detail = "members of a team are shown to and changed by the team itself, with one of its keys, and organizers";
    ApiError::new(Code::Forbidden, detail)
}

fn summary(key: &Key) -> MemberSummary {
    MemberSummary {
        id: key.id.clone(),
        name: key.name.clone(),
        added_at: key.created_at.into(),
        removed_at: key.revoked_at.map(Into::into),
    }
}
