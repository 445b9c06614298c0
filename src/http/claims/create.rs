//! `POST /api/v1/episodes/{id}/claims`.

use axum::http::{HeaderMap, StatusCode};
use swarmbench_engine::AgentId;

use super::super::answer;
use super::super::checks::short;
use super::super::idempotency::{Idempotency, created_before, idempotency};
use super::super::prelude::*;
use crate::episode::actor::{Claim, Claimed, Handle};
use crate::episode::seating::Wanted;
use crate::episode::spec::Spec;
use crate::ids::{Token, TokenKind};
use crate::store::entries::{Holder, TokenRow};
use crate::store::tokens::{Grant, Seats};
use swarmbench_protocol::claim::{ClaimRequest, CreatedClaim};
use swarmbench_protocol::episode::SeatToken;

/// Claim open seats of an episode.
///
/// The tokens are shown only once, and are valid for these seats alone. A repeat with the same `Idempotency-Key` and body
/// returns the same seats with new tokens and revokes the earlier ones. The claim of the last open seat starts the episode,
/// unless its creator wants to start it.
#[utoipa::path(
    post,
    path = "/api/v1/episodes/{id}/claims",
    operation_id = "create_claim",
    tag = "episodes",
    params(
        ("Idempotency-Key" = Option<String>, Header, description = "Any text of at most 200 characters that names this claim"),
    ),
    request_body(content = ClaimRequest, description = "At most 256 KiB"),
    responses(
        (status = 201, description = "The seats, with their tokens", body = CreatedClaim),
        (status = 403, description = "`forbidden`: the token of an episode cannot claim seats; a server without keys is open only to programs on its own machine"),
        (status = 409, description = "`seat_taken`: the seat has a holder, or fewer seats are open than requested; `episode_over`"),
    )
)]
pub(in super::super) async fn create_claim(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
    headers: HeaderMap,
    request: Unread,
) -> Result<Response, ApiError> {
    let (owner, key) = caller.claimant(&app)?;
    let (stored, spec) = app.known_episode(&caller, id).await?;
    let (request, body) = request.read::<ClaimRequest>(&app).await?;
    let idempotency = idempotency(&headers, owner, &body, &app.limits)?;
    let model = request.model.clone().unwrap_or_else(|| "unnamed".to_owned());
    let agent_meta = request.agent_meta.clone().unwrap_or_default();
    let mut problems = Problems::default();
    problems.model(&app.limits, &model);
    problems.agent_meta(&app.limits, &agent_meta);
    let wanted = wanted(&request, &spec, &mut problems);
    let wanted = problems.none_or(wanted)?;
    let at = app.clock.wall();
    let holder = Holder { number: 0, owner, key, model, agent_meta, player: None, at };
    // The scope of a key is its owner and the episode.
    let idempotency = idempotency.map(|(key, body)| (format!("{}/{key}", stored.id), body));
    let handle = app.episode(&stored.id).await?;
    // Detached, so that a repeat finds the first claim even if its client hung up.
    detached(async move {
        let _lock = app.creations.lock_key(idempotency.as_ref()).await;
        let find = |key| app.store.claimed_with(key);
        match created_before(idempotency.as_ref(), find).await? {
            None => new_claim(&app, &handle, holder, wanted, idempotency).await,
            Some(number) => new_tokens(&app, &handle, number).await,
        }
    })
    .await
}

async fn new_tokens(app: &App, handle: &Handle, number: u32) -> Result<Response, ApiError> {
    let agents = app.store.seats_of(handle.key, number).await?;
    let tokens = Tokens::new(app, agents.len());
    let row = |hash, agent| TokenRow { hash, agent, holder: Some(number) };
    let seats = tokens.seats.iter().zip(&agents);
    let rows = seats.map(|(token, agent)| row(token.hash(), Some(*agent)));
    let rows = rows.chain([row(tokens.swarm.hash(), None)]).collect();
    let replaced = app.store.replace_tokens(handle.key, Some(number), rows).await;
    // A failed replacement may have revoked some tokens too.
    app.revoked(|grant| match grant {
        Grant::Seat { episode, agent, .. } => *episode == handle.id && agents.contains(agent),
        Grant::Swarm { episode, seats: Seats::Claimed(seats), .. } => {
            *episode == handle.id && **seats == *agents
        }
        Grant::Swarm { .. } | Grant::Run { .. } | Grant::Key(_) => false,
    })
    .await?;
    replaced?;
    Ok(created(handle, &Claimed { number, agents }, &tokens))
}

async fn new_claim(
    app: &App,
    handle: &Handle,
    holder: Holder,
    wanted: Wanted,
    idempotency: Option<Idempotency>,
) -> Result<Response, ApiError> {
    let count = match wanted {
        Wanted::Seat(_) => 1,
        Wanted::Any(count) => count.into(),
    };
    let tokens = Tokens::new(app, count);
    let seats = tokens.seats.iter().map(Token::hash).collect();
    let claim = Claim { holder, wanted, seats, swarm: tokens.swarm.hash(), idempotency };
    let claimed = handle.claim(claim).await?;
    Ok(created(handle, &claimed, &tokens))
}

/// The tokens of one claim in clear text.
struct Tokens {
    seats: Vec<Token>,
    swarm: Token,
}

impl Tokens {
    fn new(app: &App, seats: usize) -> Self {
        let swarm = app.token(TokenKind::Swarm);
        Self { seats: (0..seats).map(|_| app.token(TokenKind::Seat)).collect(), swarm }
    }
}

fn created(handle: &Handle, claimed: &Claimed, tokens: &Tokens) -> Response {
    let seat = |(agent, token): (&AgentId, &Token)| SeatToken {
        agent: agent.to_string(),
        token: token.reveal().to_owned(),
    };
    let body = CreatedClaim {
        episode: handle.id.to_string(),
        status: handle.snapshot().status,
        claim: claimed.number,
        seats: claimed.agents.iter().zip(&tokens.seats).map(seat).collect(),
        swarm_token: tokens.swarm.reveal().to_owned(),
    };
    answer::with_tokens(StatusCode::CREATED, body)
}

fn wanted(request: &ClaimRequest, spec: &Spec, problems: &mut Problems) -> Option<Wanted> {
    let agents = spec.config.num_agents();
    let seats = request.seats.unwrap_or(1);
    let count = u16::try_from(seats).ok().filter(|count| (1..=agents).contains(count));
    if count.is_none() {
        problems.refuse("seats", format!("must be from 1 to {agents}, is {seats}"));
    }
    let Some(name) = request.agent.as_deref() else { return count.map(Wanted::Any) };
    if request.seats.is_some() {
        problems.refuse("seats", "goes without `agent`, which names one seat");
    }
    let agent = AgentId::parse(name).filter(|agent| agent.0 < agents);
    if agent.is_none() {
        let (last, shown) = (agents - 1, short(name));
        problems.refuse("agent", format!("must be one of Agent_0 to Agent_{last}, is {shown:?}"));
    }
    agent.map(Wanted::Seat)
}
