//! `POST /api/v1/competitions/{id}/entrants`.

use std::net::IpAddr;

use axum::Extension;
use axum::http::StatusCode;

use super::super::answer::with_tokens;
use super::super::auth::Credential;
use super::super::client::{Client, neighbours, network};
use super::super::prelude::*;
use super::check_open;
use crate::competitions::new_entrant_id;
use crate::competitions::{self, StoredCompetition};
use crate::ids::{Token, TokenHash, TokenKind};
use crate::keys::{Key, KeyRow, Role};
use crate::store::competitions::Declared;
use crate::store::entries::{EntrantRow, Entry};
use swarmbench_boards::competition::definition::Admission;
use swarmbench_boards::competition::entrant::{CONTACT_CHARS_MAX, Declaration};
use swarmbench_protocol::competition::{CreatedEntrant, EntrantRequest};

/// Enter a competition.
///
/// A caller with a key enters with it; a caller without one gets a key, shown only once, that only starts the entrant's
/// attempts and shows its results. The declaration of the player never changes: another model is another entrant.
#[utoipa::path(
    post,
    path = "/api/v1/competitions/{id}/entrants",
    operation_id = "register_entrant",
    tag = "competitions",
    request_body(content = EntrantRequest, description = "At most 256 KiB, and 64 KiB without a token"),
    responses(
        (status = 201, description = "The entrant, with its key if one was made", body = CreatedEntrant),
        (status = 403, description = "`forbidden`: the token of an episode cannot enter; the invitation code is missing, unknown or used up; the key has the maximum number of entrants"),
        (status = 429, description = "`rate_limited`: the maximum number of entrants per hour has entered from this address"),
        (status = 409, description = "`closed`: the competition takes no more entrants"),
    )
)]
pub(in super::super) async fn register_entrant(
    State(app): State<App>,
    caller: Caller,
    credential: Credential,
    Extension(client): Extension<Client>,
    Id(id): Id,
    _: Params<Nothing>,
    request: Unread,
) -> Result<Response, ApiError> {
    caller.check_not_judge()?;
    let own_key = match &caller {
        Caller::Key(key) => Some(key.clone()),
        Caller::Anonymous { .. } => None,
        Caller::Seat(..) | Caller::Swarm(..) | Caller::Run(..) => {
            let detail =
                "a token of an episode cannot enter a competition; send a key, or no token";
            return Err(ApiError::new(Code::Forbidden, detail));
        }
    };
    // A competition whose id is known may be entered, even on a private server.
    let competition = app.stored_competition(&id).await?;
    check_open(&competition, app.clock.wall())?;
    let (request, body) = request.read::<EntrantRequest>(&app).await?;
    let name = check(&request, &app)?;
    let request = EntrantRequest { name, ..request };
    // The lock makes the limits exact under concurrent entries, and codes usable once.
    detached(async move {
        let _lock = app.lock_entrants(&competition).await;
        let sender = (own_key, credential);
        let registered = register(&app, &competition, sender, client.address, request).await;
        // The memory of the body stays reserved while the request waits, even if its client is gone.
        drop(body);
        registered
    })
    .await
}

/// Stored form of the name; reports all errors of the declaration at once.
fn check(request: &EntrantRequest, app: &App) -> Result<String, ApiError> {
    let mut problems = Problems::default();
    let name = App::entrant_name(&mut problems, &request.name);
    problems.model(&app.limits, &request.model);
    problems.sampling(request.temperature, request.top_p);
    if let Some(meta) = &request.agent_meta {
        problems.agent_meta(&app.limits, meta);
    }
    problems.template(swarmbench_prompt::chosen(request.prompt_template.clone()).as_deref());
    if let Some(contact) = &request.contact {
        problems.text("contact", contact, CONTACT_CHARS_MAX);
    }
    problems.none_or(name)
}

async fn register(
    app: &App,
    competition: &StoredCompetition,
    (own_key, credential): (Option<Key>, Credential),
    address: IpAddr,
    request: EntrantRequest,
) -> Result<Response, ApiError> {
    app.check_disk()?;
    // The lock keeps the competition from being revealed meanwhile.
    let _open = app.runs.block_reveal().await;
    let now = app.clock.wall();
    let competition = &app.stored_competition(&competition.id).await?;
    let definition = &competition.definition;
    check_open(competition, now)?;
    let mut problems = Problems::default();
    problems.check("category", definition.category_problem(request.category.as_deref()));
    problems.check("accepts_terms", definition.terms_problem(request.accepts_terms));
    problems.none_or(Some(()))?;
    let invitation = invitation(app, competition, request.code.as_deref()).await?;
    let number = own_key.as_ref().and_then(|key| key.number);
    let room = app.store.room_for(competition.key, &request.model, number).await?;
    let most = app.limits.entrants_max;
    // Excluded entrants do not count towards the limit.
    if room.active as usize >= most {
        let detail = "the competition has the maximum number of entrants; ask the organizer";
        return Err(ApiError::limit(Code::Forbidden, "entrants_max", most, detail));
    }
    app.check_name_is_free(competition, None, &request.name).await?;
    // Entrants with the same model must spell it in the same way.
    if room.has_look_of_model {
        let problem = "looks like the model of another entrant and is written otherwise: write it as that one, or name it so \
                       that it can be told apart";
        return Err(ApiError::field("model", problem));
    }
    if let Some(number) = number {
        let own = Declared::Short;
        let own = competitions::entrants(&app.store, competition.key, Some(number), own).await?;
        if own.iter().any(|one| one.entrant.erased) {
            let detail = "an entrant of this key was erased here, and does not return: who erases itself leaves this competition for good";
            return Err(ApiError::new(Code::Forbidden, detail));
        }
    }
    if own_key.is_some() && room.of_owner >= definition.entries_per_key {
        let own = room.of_owner;
        let detail = format!("this key has {own} entrants already, the maximum");
        return Err(ApiError::new(Code::Forbidden, detail));
    }
    let is_vouched = own_key.as_ref().is_some_and(|key| key.role == Role::Organizer);
    if !is_vouched && invitation.is_none() {
        app.rates.check_entry(address)?;
        check_reserve(app, competition, room.active as usize, address).await?;
    }
    let mut entries = Vec::from_iter(credential.check());
    let mut secret = None;
    let owner = if let Some(key) = own_key {
        key.id
    } else {
        let (key, token) = Key::new(Role::Entrant, &request.name, None, now, &*app.entropy)
            .map_err(|problem| ApiError::field("name", problem))?;
        let id = key.id.clone();
        entries.push(Entry::AddKey(Box::new(KeyRow { key, hash: token.hash(), acts_for: None })));
        secret = Some(token);
        id
    };
    let declaration = Declaration {
        model: request.model.clone(),
        temperature: request.temperature,
        top_p: request.top_p,
        agent_meta: request.agent_meta.unwrap_or_default(),
        prompt_template: swarmbench_prompt::chosen(request.prompt_template),
        template: None,
    };
    let id = new_entrant_id(now, &*app.entropy);
    entries.push(Entry::AddEntrant(Box::new(EntrantRow {
        id: id.clone(),
        competition: competition.key,
        owner,
        name: request.name,
        model: request.model,
        template: declaration.template_digest(),
        declaration: serde_json::to_string(&declaration).expect("string keys"),
        vouched: is_vouched,
        invitation,
        address: Some(network(address).to_string()),
        category: request.category,
        terms: request.accepts_terms,
        contact: request.contact,
        at: now,
    })));
    app.store.keep(entries).await?;
    let entrant = app.entrant(competition, &id).await?;
    let key = secret.map(|token| token.reveal().to_owned());
    let body = CreatedEntrant { entrant: (&entrant.entrant).into(), key };
    Ok(with_tokens(StatusCode::CREATED, body))
}

/// Refuses an entry without an invitation if the remaining places are reserved. Programs on this machine are exempt.
async fn check_reserve(
    app: &App,
    competition: &StoredCompetition,
    active: usize,
    address: IpAddr,
) -> Result<(), ApiError> {
    let percent = app.limits.reserved_percent as usize;
    let reserved = app.limits.entrants_max * percent / 100;
    let left = app.limits.entrants_max.saturating_sub(active);
    if left > 2 * reserved || address.is_loopback() {
        return Ok(());
    }
    let (texts, other) = neighbours(address);
    // Excluded entrants count, too: a network stays known after abuse.
    if left > reserved && !app.store.is_entered_from(competition.key, &texts, &other).await? {
        return Ok(());
    }
    let detail = "the last places are for entrants with an invitation code, and some of them for networks from which nobody entered; \
                  ask the organizer for a code";
    Err(ApiError::limit(Code::Forbidden, "reserved_percent", percent, detail))
}

/// Invitation of a code. In a competition that anybody may enter, codes are for reserved places.
async fn invitation(
    app: &App,
    competition: &StoredCompetition,
    code: Option<&str>,
) -> Result<Option<TokenHash>, ApiError> {
    let is_open = competition.definition.entry == Admission::Anybody;
    let refused = |detail: &str| {
        Err(if is_open {
            ApiError::field("code", format!("is not needed here, and {detail}"))
        } else {
            ApiError::new(Code::Forbidden, detail)
        })
    };
    let Some(code) = code else {
        return if is_open {
            Ok(None)
        } else {
            refused("this competition is entered with an invitation code, as `code`")
        };
    };
    let token = Token::parse(code.trim()).filter(|token| token.kind() == TokenKind::Invitation);
    let hash = token.map(|token| token.hash());
    let found = match hash {
        Some(hash) => app.store.find_invitation(competition.key, hash).await?,
        None => None,
    };
    match found {
        None => refused("this is no invitation code of this competition"),
        Some(code) if code.entrant.is_some() => {
            refused("this invitation code was used before; each is good once")
        }
        Some(code) if code.revoked_at.is_some() => {
            refused("this invitation code was revoked; ask the organizer for another")
        }
        Some(_) => Ok(hash),
    }
}
