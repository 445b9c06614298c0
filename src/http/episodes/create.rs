//! `POST /api/v1/episodes`.

use std::sync::Arc;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};
use swarmbench_engine::{AgentId, Config, Settings, TaskName};

use super::super::App;
use super::super::auth::Caller;
use super::super::error::{ApiError, Code};
use super::super::extract::{Json, Nothing, Params};
use super::super::limits::Limits;
use super::super::openapi::{BodyRefusals, QueryRefusals, TokenRefusals};
use super::{config, duration};
use crate::episode::actor::Handle;
use crate::episode::registry::Creation;
use crate::episode::spec::{Spec, Visibility};
use crate::house;
use crate::ids::{EpisodeId, Token, TokenKind};
use crate::journal::{Entry, Journal, TokenRow};
use crate::keys::OwnerKey;
use crate::prompt;
use crate::store::tokens::Grant;
use crate::wire::episode::{CreatedEpisode, EpisodeRequest, SeatToken};
use crate::wire::problem::{FieldProblem, Problem};

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
        BodyRefusals,
        QueryRefusals,
        TokenRefusals,
        (status = 403, description = "`forbidden`: a token of an episode creates none; a server without keys is open to programs on its own machine only; the key's share of the journal is used up", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in super::super) async fn create_episode(
    State(app): State<App>,
    caller: Caller,
    _: Params<Nothing>,
    headers: HeaderMap,
    Json(request, body): Json<EpisodeRequest>,
) -> Result<Response, ApiError> {
    let owner = caller.creator(&app)?;
    let key = idempotency_key(&headers, &app.limits)?;
    let spec = spec(request, &app)?;
    let body: [u8; 32] = Sha256::digest(&body).into();
    let shows_seed = caller.is_organizer() || !spec.is_mixed();
    let Some(key) = key else { return new_episode(&app, owner, spec, shows_seed, None).await };
    // Everybody has names of their own.
    let key = idempotency_name(owner, &key);
    // A repeat must find what the first one creates, whoever has hung up meanwhile.
    App::to_its_end(async move { create_or_repeat(&app, owner, spec, shows_seed, key, body).await })
        .await
}

/// Creates an episode, or gives out new tokens for the one that was created with this key and body.
async fn create_or_repeat(
    app: &App,
    owner: Option<OwnerKey>,
    spec: Spec,
    shows_seed: bool,
    key: String,
    body: [u8; 32],
) -> Result<Response, ApiError> {
    let _one_by_one = app.one_by_one(&key).await;
    match app.store.created_with(&key).await? {
        None => new_episode(app, owner, spec, shows_seed, Some((key, body))).await,
        Some((_, first)) if first != body => Err(ApiError::new(
            Code::Invalid,
            "this Idempotency-Key was used with another body; send that body, or another key",
        )),
        Some((id, _)) => {
            let handle = app.episode(&id).await?;
            let tokens = Tokens::new(app, &handle.spec);
            let (episode, tokens_now) = (handle.key, tokens.rows());
            let entry = Entry::ReplaceTokens { episode, holder: None, tokens: tokens_now };
            app.store.keep(vec![entry]).await?;
            app.forget_tokens(
                |grant| matches!(grant, Grant::Seat { episode, .. } | Grant::Swarm { episode, .. } if *episode == id),
            );
            Ok(created(&handle, &tokens, shows_seed))
        }
    }
}

async fn new_episode(
    app: &App,
    owner: Option<OwnerKey>,
    spec: Spec,
    shows_seed: bool,
    idempotency: Option<(String, [u8; 32])>,
) -> Result<Response, ApiError> {
    let least = app.limits.disk_free_percent_min;
    if app.disk.free_percent().is_some_and(|free| free < f64::from(least)) {
        let detail = format!(
            "less than {least} % of the server's disk is free: what runs goes on, nothing new is created"
        );
        return Err(ApiError::limit(
            Code::Overloaded,
            "disk_free_percent_min",
            least as usize,
            detail,
        )
        .retry_after(std::time::Duration::from_mins(1)));
    }
    let id = EpisodeId::new(app.clock.now(), &*app.entropy);
    let tokens = Tokens::new(app, &spec);
    let creation = Creation { id, owner, run: None, spec, tokens: tokens.rows(), idempotency };
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
        status: handle.snapshot().status.into(),
        config: config(&handle.spec, shows_seed),
        seats: tokens.seats.iter().map(seat).collect(),
        swarm_token: tokens.swarm.reveal().to_owned(),
    };
    let mut response = (StatusCode::CREATED, axum::Json(body)).into_response();
    let location = format!("/api/v1/episodes/{}", handle.id);
    if let Ok(location) = HeaderValue::try_from(location) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    // Tokens must not lie in caches on the way.
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}

/// The name that the caller has for what is created.
pub(in super::super) fn idempotency_key(
    headers: &HeaderMap,
    limits: &Limits,
) -> Result<Option<String>, ApiError> {
    let Some(value) = headers.get("idempotency-key") else { return Ok(None) };
    let most = limits.idempotency_key_chars_max;
    match value.to_str() {
        Ok(key) if (1..=most).contains(&key.len()) => Ok(Some(key.to_owned())),
        _ => Err(ApiError::new(
            Code::Malformed,
            format!("Idempotency-Key must be 1 to {most} printable ASCII characters"),
        )),
    }
}

/// A name that the holder of a key has for something, among the names of all.
pub(in super::super) fn idempotency_name(owner: Option<OwnerKey>, name: &str) -> String {
    match owner {
        Some(OwnerKey(number)) => format!("{number}/{name}"),
        None => format!("/{name}"),
    }
}

/// Checks what is told of who plays.
pub(in super::super) fn check_player(
    model: Option<&str>,
    agent_meta: Option<&serde_json::Map<String, serde_json::Value>>,
    limits: &Limits,
    mut refuse: impl FnMut(&str, String),
) {
    if let Some(model) = model
        && (!(1..=limits.model_chars_max).contains(&model.chars().count())
            || model.chars().any(char::is_control))
    {
        let most = limits.model_chars_max;
        refuse("model", format!("must be 1 to {most} characters without control characters"));
    }
    let meta_bytes =
        agent_meta.map_or(0, |meta| serde_json::to_vec(meta).map_or(0, |json| json.len()));
    if meta_bytes > limits.agent_meta_bytes_max {
        let most = limits.agent_meta_bytes_max;
        refuse("agent_meta", format!("must be at most {most} bytes of JSON, is {meta_bytes}"));
    }
}

/// Checks everything that was asked for; all that is wrong is named at once.
fn spec(request: EpisodeRequest, app: &App) -> Result<Spec, ApiError> {
    let limits = &app.limits;
    let mut problems = Vec::new();
    let mut refuse = |field: &str, problem: String| {
        problems.push(FieldProblem { field: field.to_owned(), problem });
    };
    let defaults = Settings::default();
    let settings = Settings {
        task: request.task.clone().unwrap_or_default(),
        rules: request.rules.unwrap_or(defaults.rules),
        control: request.control.unwrap_or(defaults.control),
        seed: request.seed.unwrap_or_else(|| drawn_seed(app)),
        num_agents: request.num_agents.unwrap_or(defaults.num_agents),
        width: request.width.unwrap_or(defaults.width),
        height: request.height.unwrap_or(defaults.height),
        view_size: request.view_size.unwrap_or(defaults.view_size),
        memory: request.memory.unwrap_or(defaults.memory),
        max_round: request.max_round.unwrap_or(defaults.max_round),
        noise: request.noise.unwrap_or(defaults.noise),
        max_delay: request.max_delay.unwrap_or(defaults.max_delay),
    };
    let checked = if request.task.is_some() {
        Config::check(&settings).map_err(|errors| {
            for error in errors.0 {
                refuse(error.field, error.problem);
            }
        })
    } else {
        refuse("task", "is missing".to_owned());
        Err(())
    };
    let mut seconds = |field: &str, value: Option<f64>, default: f64, low: f64, high: f64| {
        let value = value.unwrap_or(default);
        if !(low..=high).contains(&value) {
            refuse(field, format!("must be from {low} to {high} seconds, is {value}"));
        }
        duration(value.clamp(low, high))
    };
    let bank = seconds("bank_s", request.bank_s, 0.0, 0.0, 604_800.0);
    let idle = seconds("idle_timeout_s", request.idle_timeout_s, 86_400.0, 1.0, 31_536_000.0);
    let round_deadline = request
        .round_deadline_s
        .map(|value| seconds("round_deadline_s", Some(value), 0.0, 0.05, 86_400.0));
    let fill_after =
        request.fill_after_s.map(|value| seconds("fill_after_s", Some(value), 0.0, 0.0, 604_800.0));
    let start = request.start.as_deref().unwrap_or("now");
    if !["now", "manual"].contains(&start) {
        refuse("start", format!("must be one of now, manual, is {:?}", short(start)));
    }
    let usual = if app.has_keys { Visibility::Owner } else { Visibility::Public };
    let visibility = request.visibility.as_deref().unwrap_or(usual.name());
    let found = Visibility::ALL.into_iter().find(|known| known.name() == visibility);
    if visibility == "sealed" {
        refuse("visibility", "sealed is set by competitions only; use public or owner".to_owned());
    } else if found.is_none() {
        refuse("visibility", format!("must be one of public, owner, is {:?}", short(visibility)));
    }
    check_player(request.model.as_deref(), request.agent_meta.as_ref(), limits, &mut refuse);
    let agent_meta = request.agent_meta.unwrap_or_default();
    if let Some(template) = &request.prompt_template
        && let Err(error) = prompt::check(template)
    {
        refuse("prompt_template", error.to_string());
    }
    let open = request.open_seats.unwrap_or(0);
    let agents = settings.num_agents;
    if !(0..=agents).contains(&open) {
        refuse(
            "open_seats",
            format!("must be from 0 to the number of agents, {agents}, is {open}"),
        );
    }
    if fill_after.is_some() && open == 0 {
        refuse("fill_after_s", "goes with `open_seats`: no seat is open".to_owned());
    } else if fill_after.is_some_and(|after| after >= idle) {
        refuse("fill_after_s", "must be less than idle_timeout_s".to_owned());
    }
    if request.fill_with.is_some() && fill_after.is_none() {
        refuse("fill_with", "goes with `fill_after_s`".to_owned());
    }
    if request.player.is_some() && open > 0 && open == agents {
        let problem = "has no seat to play: all are open; `fill_with` names who fills open ones";
        refuse("player", problem.to_owned());
    }
    let task = request.task.as_deref().and_then(TaskName::parse);
    let mut built_in = |field: &str, name: Option<&str>| {
        house::player(name, task?).map_err(|problem| refuse(field, problem)).ok()
    };
    let fill_with = fill_after.and_then(|_| built_in("fill_with", request.fill_with.as_deref()));
    let player = request.player.as_deref().and_then(|name| built_in("player", Some(name)));
    let (Ok(checked), Some(visibility), true) = (checked, found, problems.is_empty()) else {
        return Err(ApiError::fields(problems));
    };
    let usual = || player.as_ref().map_or("unnamed".to_owned(), |name| format!("built-in/{name}"));
    let model = request.model.unwrap_or_else(usual);
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
        custom_template: request.prompt_template.is_some(),
        prompt_template: request.prompt_template.as_deref().unwrap_or(prompt::BUILT_IN).into(),
        run: None,
        salt: None,
        closes_at: None,
        open_seats: (own..agents).map(AgentId).collect(),
        fill_after,
        fill_with,
        player,
    })
}

fn short(text: &str) -> String {
    text.chars().take(40).collect()
}

/// A seed that nobody can foresee: 53 random bits.
fn drawn_seed(app: &App) -> i64 {
    let mut bytes = [0; 8];
    app.entropy.fill(&mut bytes);
    i64::from_le_bytes(bytes) & ((1 << 53) - 1)
}
