//! `POST /api/v1/competitions/{id}/attempts`.

use std::time::Duration;

use axum::http::HeaderMap;

use super::super::answer;
use super::super::auth::Credential;
use super::super::idempotency::{Idempotency, created_before, idempotency};
use super::super::prelude::*;
use super::super::runs::token::only_token;
use super::check_not_over;
use crate::competitions::{self, StoredCompetition, StoredEntrant};
use crate::episode::quota::Purpose;
use crate::fair::Party;
use crate::ids::Token;
use crate::keys::OwnerKey;
use crate::run::manager::NewRun;
use crate::store::competitions::Declared;
use crate::store::runs::StoredRun;
use swarmbench_boards::competition::EntrantStatus;
use swarmbench_boards::competition::phase::{Started, attempt as choose};
use swarmbench_protocol::competition::{AttemptRequest, StartedAttempt};

/// Value of `Retry-After` while the time of day is in doubt.
const DOUBT_PAUSE: Duration = Duration::from_secs(5);

/// Start an attempt: the next one that is open, or the requested one.
///
/// The swarm token is shown only once. A repeat with the same `Idempotency-Key` and body returns the same attempt with a new
/// token.
#[utoipa::path(
    post,
    path = "/api/v1/competitions/{id}/attempts",
    operation_id = "start_attempt",
    tag = "competitions",
    params(
        ("Idempotency-Key" = Option<String>, Header, description = "Any text of at most 200 characters that names this start"),
    ),
    request_body(content = Option<AttemptRequest>, description = "At most 256 KiB; an empty body starts the next attempt that is open"),
    responses(
        (status = 201, description = "The attempt, with its swarm token", body = StartedAttempt),
        (status = 403, description = "`forbidden`: not the key of an entrant; the entrant was withdrawn or disqualified"),
        (status = 409, description = "`closed`: no attempt is open, or all were started"),
        (status = 503, description = "`unavailable`: the server's clock is in doubt; `overloaded`"),
    )
)]
pub(in super::super) async fn start_attempt(
    State(app): State<App>,
    caller: Caller,
    credential: Credential,
    Id(id): Id,
    _: Params<Nothing>,
    headers: HeaderMap,
    OptionalJson(request, body): OptionalJson<AttemptRequest>,
) -> Result<Response, ApiError> {
    caller.check_not_judge()?;
    let owner = caller.needs_key()?.number;
    let competition = app.competition(&caller, &id).await?;
    let entrant = entrant(&app, &competition, owner, request.entrant.as_deref()).await?;
    let idempotency = idempotency(&headers, owner, &body, &app.limits)?;
    // Idempotency keys are per entrant: two entrants of one owner may use the same key at the same time.
    let of = |key| format!("{}/{key}", entrant.entrant.id);
    let idempotency = idempotency.map(|(key, body)| (of(key), body));
    // A detached task completes the start even if the client hangs up. The lock admits one start per entrant at a time.
    detached(async move {
        let _lock = app.creations.lock(&format!("attempt {}", entrant.entrant.id)).await;
        // The entrant may have been excluded while the request waited for the lock.
        check_active(&app.entrant(&competition, &entrant.entrant.id).await?)?;
        let find = |key| app.store.run_created_with(key);
        match created_before(idempotency.as_ref(), find).await? {
            None => {
                let wanted = request.attempt;
                start(&app, &competition, &entrant, wanted, idempotency, credential).await
            }
            Some(run) => replace_token(&app, &competition, &entrant, run, credential).await,
        }
    })
    .await
}

async fn replace_token(
    app: &App,
    competition: &StoredCompetition,
    entrant: &StoredEntrant,
    run: StoredRun,
    credential: Credential,
) -> Result<Response, ApiError> {
    if let Some(reason) = &run.void_reason {
        let detail = format!(
            "this attempt was voided, start it again with another Idempotency-Key: {reason}"
        );
        return Err(ApiError::new(Code::Closed, detail));
    }
    let number = run.attempt.map_or(0, |(_, number)| number);
    let before = Started { number, replays: run.replays, voided: false, at: run.created_at };
    let token = only_token(app.new_run_tokens(run.run, vec![None], credential, None).await?)?;
    started(competition, entrant, before, run.id, &token)
}

/// Entrant of the key: the named one, or the only one.
pub(super) async fn entrant(
    app: &App,
    competition: &StoredCompetition,
    owner: Option<OwnerKey>,
    id: Option<&str>,
) -> Result<StoredEntrant, ApiError> {
    let own = match owner {
        Some(owner) => {
            competitions::entrants(&app.store, competition.key, Some(owner), Declared::Short)
                .await?
        }
        None => Vec::new(),
    };
    let count = own.len();
    let mut found = own.into_iter().filter(|entrant| id.is_none_or(|id| id == entrant.entrant.id));
    match (found.next(), id) {
        (Some(_), None) if count > 1 => {
            Err(ApiError::field("entrant", format!("is missing: this key has {count} entrants")))
        }
        (Some(entrant), _) => Ok(entrant),
        (None, _) => {
            let detail = "this key has no such entrant here; register with POST …/entrants first";
            Err(ApiError::new(Code::Forbidden, detail))
        }
    }
}

/// Refuses entrants that were withdrawn or disqualified.
pub(super) fn check_active(entrant: &StoredEntrant) -> Result<(), ApiError> {
    if entrant.entrant.status == EntrantStatus::Active {
        return Ok(());
    }
    let reason = entrant.entrant.reason.as_deref().unwrap_or("no reason was given");
    let detail = format!("this entrant is {}: {reason}", entrant.entrant.status.name());
    Err(ApiError::new(Code::Forbidden, detail))
}

async fn start(
    app: &App,
    competition: &StoredCompetition,
    entrant: &StoredEntrant,
    wanted: Option<u32>,
    idempotency: Option<Idempotency>,
    Credential(credential): Credential,
) -> Result<Response, ApiError> {
    let entrant = &app.entrant(competition, &entrant.entrant.id).await?;
    // The lock keeps the competition from being revealed, and windows from changing, between the check of the time and the new
    // run.
    let _open = app.runs.block_reveal().await;
    let competition = &app.stored_competition(&competition.id).await?;
    check_not_over(competition)?;
    if let Some(doubt) = app.clock.doubt() {
        return Err(ApiError::new(Code::Unavailable, doubt.to_string()).retry_after(DOUBT_PAUSE));
    }
    let attempts = app.store.attempts_of(entrant.key).await?;
    let earlier: Vec<Started> = attempts
        .iter()
        .map(|attempt| Started {
            number: attempt.number,
            replays: attempt.replays,
            voided: attempt.void_reason.is_some(),
            at: attempt.created_at,
        })
        .collect();
    let definition = &competition.definition;
    let chosen = choose(definition, wanted, &earlier, app.clock.wall())
        .map_err(|why| ApiError::new(Code::Closed, why.to_string()))?;
    let Started { number, replays, .. } = chosen;
    let declaration = &entrant.entrant.declaration;
    let run = definition.run(&competition.id, declaration, number, &competition.sealed);
    let definition = run.ok_or_else(|| ApiError::new(Code::Internal, "there is no attempt"))?;
    let attempt = Some((entrant.key, number));
    let purpose = Purpose::Usual;
    let party = Party::entrant(competition.key, entrant.owner);
    let new = NewRun { party, purpose, definition, attempt, replays, idempotency, credential };
    let (run, tokens) = app.runs.create(new).await?;
    app.check_not_excluded(competition, entrant, run.run).await?;
    let token = only_token(tokens)?;
    started(competition, entrant, chosen, run.id, &token)
}

fn started(
    competition: &StoredCompetition,
    entrant: &StoredEntrant,
    started: Started,
    run: String,
    token: &Token,
) -> Result<Response, ApiError> {
    let definition = &competition.definition;
    let window = definition.window(started.number);
    let window = window.ok_or_else(|| ApiError::new(Code::Internal, "there is no attempt"))?;
    let body = StartedAttempt {
        attempt: started.attempt(),
        on_spare_seeds: started.replays.is_some(),
        entrant: entrant.entrant.id.clone(),
        run,
        games: definition.games(),
        closes_at: window.closes_at.into(),
        swarm_token: token.reveal().to_owned(),
    };
    Ok(answer::created(&format!("/api/v1/runs/{}", body.run), &body))
}
