//! `POST /api/v1/episodes`.

use std::sync::Arc;

use axum::Extension;
use axum::http::HeaderMap;
use swarmbench_engine::{AgentId, Config, Settings, TaskName};

use super::super::answer;
use super::super::checks::short;
use super::super::client::Client;
use super::super::idempotency::{Idempotency, created_before, idempotency};
use super::super::prelude::*;
use super::config;
use crate::episode::actor::Handle;
use crate::episode::quota::Purpose;
use crate::episode::registry::Creation;
use crate::episode::spec::Spec;
use crate::fair::Party;
use crate::hosted;
use crate::ids::{EpisodeId, Token, TokenKind};
use crate::store::entries::{Entry, TokenRow};
use crate::store::tokens::Grant;
use swarmbench_protocol::episode::{CreatedEpisode, EpisodeRequest, SeatToken};

/// Create an episode.
///
/// The tokens are shown this once. A repeat with the same `Idempotency-Key` and body gives the same
/// episode with fresh tokens, and the earlier ones are revoked.
#[utoipa::path(
    post,
    path = "/api/v1/episodes",
    operation_id = "create_episode",
    tag = "episodes",
    params(("Idempotency-Key" = Option<String>, Header, description = "Any text of at most 200 characters that names this creation")),
    request_body(content = EpisodeRequest, description = "At most 256 KiB"),
    security((), ("key" = [])),
    responses(
        (status = 201, description = "The episode, with its tokens", body = CreatedEpisode),
        (status = 403, description = "`forbidden`: a token of an episode creates none; a server without keys is open to programs on its own machine only; the key's share of the journal is used up"),
    )
)]
pub(in super::super) async fn create_episode(
    State(app): State<App>,
    caller: Caller,
    Extension(client): Extension<Client>,
    _: Params<Nothing>,
    headers: HeaderMap,
    Json(request, body): Json<EpisodeRequest>,
) -> Result<Response, ApiError> {
    let creator = caller.creator(&app, client)?;
    let idempotency = idempotency(&headers, creator.0.owner(), &body, &app.limits)?;
    let spec = spec(request, &app)?;
    let shows_seed = caller.is_organizer() || !spec.is_mixed();
    // A repeat must find what the first one creates, also if its client hangs up.
    App::run_detached(async move {
        let _lock = app.creations.lock_key(idempotency.as_ref()).await;
        let find = |key| app.store.created_with(key);
        match created_before(idempotency.as_ref(), find).await? {
            None => new_episode(&app, creator, spec, shows_seed, idempotency).await,
            Some(id) => new_tokens(&app, id, shows_seed).await,
        }
    })
    .await
}

async fn new_tokens(app: &App, id: EpisodeId, shows_seed: bool) -> Result<Response, ApiError> {
    let handle = app.episode(&id).await?;
    let tokens = Tokens::new(app, &handle.spec);
    let (episode, rows) = (handle.key, tokens.rows());
    let entry = Entry::ReplaceTokens { episode, holder: None, tokens: rows };
    app.store.keep(vec![entry]).await?;
    app.tokens.forget(
        |grant| matches!(grant, Grant::Seat { episode, .. } | Grant::Swarm { episode, .. } if *episode == id),
    );
    Ok(created(&handle, &tokens, shows_seed))
}

async fn new_episode(
    app: &App,
    (party, purpose): (Party, Purpose),
    spec: Spec,
    shows_seed: bool,
    idempotency: Option<Idempotency>,
) -> Result<Response, ApiError> {
    // A repeated creation gets that episode, also if it was created under wider limits.
    spec.config.check_new().map_err(|errors| ApiError::settings(errors, ""))?;
    app.check_disk()?;
    let id = EpisodeId::new(app.clock.wall(), &*app.entropy);
    let tokens = Tokens::new(app, &spec);
    let rows = tokens.rows();
    let creation = Creation { id, party, purpose, run: None, spec, tokens: rows, idempotency };
    let handle = app.registry.create(creation).await?;
    Ok(created(&handle, &tokens, shows_seed))
}

/// The tokens of the creator's seats in clear.
struct Tokens {
    seats: Vec<(AgentId, Token)>,
    swarm: Token,
}

impl Tokens {
    fn new(app: &App, spec: &Spec) -> Self {
        let token = |kind| Token::new(kind, &*app.entropy);
        Self {
            seats: (spec.agents().filter(|agent| spec.is_creators(*agent)))
                .map(|agent| (agent, token(TokenKind::Seat)))
                .collect(),
            swarm: token(TokenKind::Swarm),
        }
    }

    fn rows(&self) -> Vec<TokenRow> {
        let seats = self.seats.iter();
        seats
            .map(|(agent, token)| TokenRow {
                hash: token.hash(),
                agent: Some(*agent),
                holder: None,
            })
            .chain([TokenRow { hash: self.swarm.hash(), agent: None, holder: None }])
            .collect()
    }
}

fn created(handle: &Handle, tokens: &Tokens, shows_seed: bool) -> Response {
    let seat = |(agent, token): &(AgentId, Token)| SeatToken {
        agent: agent.to_string(),
        token: token.reveal().to_owned(),
    };
    let body = CreatedEpisode {
        id: handle.id.to_string(),
        status: handle.snapshot().status,
        config: config(&handle.spec, shows_seed),
        seats: tokens.seats.iter().map(seat).collect(),
        swarm_token: tokens.swarm.reveal().to_owned(),
    };
    answer::created(&format!("/api/v1/episodes/{}", handle.id), body)
}

/// Validates the request; all errors are reported at once.
fn spec(request: EpisodeRequest, app: &App) -> Result<Spec, ApiError> {
    let mut problems = Problems::default();
    let usual = Settings::default();
    let settings = Settings {
        task: request.task.clone().unwrap_or_default(),
        rules: request.rules.clone().unwrap_or_else(|| usual.rules.clone()),
        seed: request.seed.unwrap_or_else(|| drawn_seed(app)),
        ..request.over(usual)
    };
    let checked = if request.task.is_some() {
        Config::check(&settings).map_err(|errors| {
            for error in errors.0 {
                problems.refuse(error.field, error.problem);
            }
        })
    } else {
        problems.refuse("task", "is missing");
        Err(())
    };
    let (round_deadline, bank, idle) =
        problems.clocks(request.round_deadline_s, request.bank_s, request.idle_timeout_s);
    let fill_after = request
        .fill_after_s
        .map(|value| problems.seconds("fill_after_s", Some(value), 0.0, 0.0, 604_800.0));
    let start = request.start.as_deref().unwrap_or("now");
    if !["now", "manual"].contains(&start) {
        problems.refuse("start", format!("must be one of now, manual, is {:?}", short(start)));
    }
    let visibility = problems.visibility(app, request.visibility.as_deref());
    let open = request.open_seats.unwrap_or(0);
    let agents = settings.num_agents;
    if !(0..=agents).contains(&open) {
        let problem = format!("must be from 0 to the number of agents, {agents}, is {open}");
        problems.refuse("open_seats", problem);
    }
    if fill_after.is_some() && open == 0 {
        problems.refuse("fill_after_s", "goes with `open_seats`: no seat is open");
    } else if fill_after.is_some_and(|after| after >= idle) {
        problems.refuse("fill_after_s", "must be less than idle_timeout_s");
    }
    if request.fill_with.is_some() && fill_after.is_none() {
        problems.refuse("fill_with", "goes with `fill_after_s`");
    }
    if request.player.is_some() && open > 0 && open == agents {
        let problem = "has no seat to play: all are open; `fill_with` names who fills open ones";
        problems.refuse("player", problem);
    }
    let task = request.task.as_deref().and_then(TaskName::parse);
    let mut built_in = |field: &str, name: &str| {
        hosted::player(name, task?).map_err(|problem| problems.refuse(field, problem)).ok()
    };
    let fill_with = fill_after.and_then(|_| {
        built_in("fill_with", request.fill_with.as_deref().unwrap_or(hosted::DEFAULT_PLAYER))
    });
    let player = request.player.as_deref().and_then(|name| built_in("player", name));
    let usual = || player.as_ref().map_or("unnamed".to_owned(), |name| format!("built-in/{name}"));
    let model = request.model.unwrap_or_else(usual);
    problems.model(&app.limits, &model);
    let agent_meta = request.agent_meta.unwrap_or_default();
    problems.agent_meta(&app.limits, &agent_meta);
    let template = swarmbench_prompt::chosen(request.prompt_template);
    problems.template(template.as_deref());
    let (checked, visibility) = problems.none_or(checked.ok().zip(visibility))?;
    let agents = checked.num_agents();
    let own = agents.saturating_sub(u16::try_from(open).unwrap_or(agents));
    Ok(Spec {
        config: Arc::new(checked),
        round_deadline,
        bank,
        manual_start: start == "manual",
        idle_timeout: idle,
        visibility,
        model,
        agent_meta,
        custom_template: template.is_some(),
        prompt_template: template.as_deref().unwrap_or(swarmbench_prompt::BUILT_IN).into(),
        prompt_revision: swarmbench_prompt::REVISION,
        run: None,
        salt: None,
        closes_at: None,
        open_seats: (own..agents).map(AgentId).collect(),
        fill_after,
        fill_with,
        player,
    })
}

/// A seed that cannot be predicted: 53 random bits.
fn drawn_seed(app: &App) -> i64 {
    let mut bytes = [0; 8];
    app.entropy.fill(&mut bytes);
    i64::from_le_bytes(bytes) & ((1 << 53) - 1)
}
