//! `GET /obs`: the current observation of the token's agent.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use swarmbench_engine::AgentId;
use utoipa::IntoParams;

use super::super::App;
use super::super::auth::Seat;
use super::super::error::ApiError;
use super::super::extract::{Params, wait};
use super::super::refusals::{QueryRefusals, TokenRefusals};
use crate::clock::{millis, until};
use crate::episode::Snapshot;
use crate::episode::actor::Handle;
use crate::prompt::{self, tasks};
use crate::wire::episode::EpisodeResult;
use crate::wire::observation::{Moment, Observation, Sight};
use crate::wire::problem::Problem;

/// How to look.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct ObsParams {
    /// With `wait`: wait until the round is past this one.
    after: Option<u32>,
    /// Seconds to wait at most, up to 60; the answer is then the current observation.
    wait: Option<f64>,
    /// Add the text for a language model.
    #[serde(default)]
    prompt: bool,
}

/// Look: the current observation of the token's agent.
///
/// Never changes anything and never costs a move.
#[utoipa::path(
    get,
    path = "/obs",
    operation_id = "get_obs",
    tag = "agent",
    params(ObsParams),
    security(("seat" = [])),
    responses(
        (status = 200, description = "The current observation", body = Observation),
        QueryRefusals,
        TokenRefusals,
        (status = 403, description = "`forbidden`: not a seat token", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "`template_failed`: a prompt was asked for and cannot be made", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in super::super) async fn get_obs(
    State(app): State<App>,
    seat: Seat,
    Params(params): Params<ObsParams>,
) -> Result<Response, ApiError> {
    let wait = wait(&app, params.wait)?;
    let snapshot = match params.after {
        Some(after) => {
            let wanted = |snapshot: &Snapshot| is_past(snapshot, after);
            app.wait_until(&seat.handle, wait, wanted).await?
        }
        None => seat.handle.snapshot(),
    };
    let body = observation(&app, &seat.handle, &snapshot, seat.agent, params.prompt).await?;
    Ok(json(body))
}

/// An answer whose body is written out already.
pub(in super::super) fn json(body: Vec<u8>) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], body).into_response()
}

/// An object as JSON, with one more field whose value is written out already.
pub(in super::super) fn with_field(object: &impl Serialize, name: &str, value: &[u8]) -> Vec<u8> {
    let mut body = serde_json::to_vec(object).expect("string keys");
    let end = body.pop();
    debug_assert!(end == Some(b'}') && body.len() > 1, "an object with fields");
    body.reserve(name.len() + value.len() + 8);
    body.extend_from_slice(b",\"");
    body.extend_from_slice(name.as_bytes());
    body.extend_from_slice(b"\":");
    body.extend_from_slice(value);
    body.push(b'}');
    body
}

/// Whether there is more to see than in round `round`.
pub(in super::super) fn is_past(snapshot: &Snapshot, round: u32) -> bool {
    snapshot.status.is_over() || snapshot.world.round() > round
}

/// An observation as JSON. Its larger part is written once a round and shared.
pub(in super::super) async fn observation(
    app: &App,
    handle: &Handle,
    snapshot: &Snapshot,
    agent: AgentId,
    with_prompt: bool,
) -> Result<Vec<u8>, ApiError> {
    let acted = snapshot.has_acted(agent);
    written(app, handle, snapshot, agent, acted, with_prompt).await
}

/// The observation of a seat that waited for an act when it was looked at, as it was then: it may have acted
/// while others were written out.
pub(in super::super) async fn waiting_observation(
    app: &App,
    handle: &Handle,
    snapshot: &Snapshot,
    agent: AgentId,
    with_prompt: bool,
) -> Result<Vec<u8>, ApiError> {
    written(app, handle, snapshot, agent, false, with_prompt).await
}

async fn written(
    app: &App,
    handle: &Handle,
    snapshot: &Snapshot,
    agent: AgentId,
    acted: bool,
    with_prompt: bool,
) -> Result<Vec<u8>, ApiError> {
    let mut moment = moment(app, handle, snapshot, agent, acted);
    if with_prompt {
        let sight = sight(handle, snapshot, agent);
        let spec = std::sync::Arc::clone(&handle.spec);
        let work = move || prompt::render(&spec.prompt_template, &sight, &spec.config);
        moment.prompt = Some(app.render(work).await??);
    }
    let sight = snapshot.written[agent.index()].get_or_init(|| {
        Bytes::from(serde_json::to_vec(&sight(handle, snapshot, agent)).expect("string keys"))
    });
    let moment = serde_json::to_vec(&moment).expect("string keys");
    // Two objects are joined to one: `{…` and `,…}`.
    let mut body = Vec::with_capacity(sight.len() + moment.len());
    body.extend_from_slice(&sight[..sight.len() - 1]);
    body.push(b',');
    body.extend_from_slice(&moment[1..]);
    Ok(body)
}

fn sight(handle: &Handle, snapshot: &Snapshot, agent: AgentId) -> Sight {
    Sight::of(
        &snapshot.world.observe(agent),
        handle.id.to_string(),
        tasks::description(&handle.spec.config),
        snapshot.status.into(),
        result(snapshot),
    )
}

/// How an episode ended, as it is shown.
pub(in super::super) fn result(snapshot: &Snapshot) -> Option<EpisodeResult> {
    snapshot.outcome.map(|outcome| EpisodeResult {
        reason: outcome.ending.name().to_owned(),
        score: snapshot.world.score(),
        rounds: snapshot.world.round(),
        journal_head: snapshot.head.to_string(),
    })
}

fn moment(app: &App, handle: &Handle, snapshot: &Snapshot, agent: AgentId, acted: bool) -> Moment {
    let deadline = snapshot.deadline(&handle.spec, agent);
    let Some(deadline) = deadline else { return Moment { acted, ..Moment::default() } };
    let left = until(app.clock.now(), deadline);
    // The round's own clock runs first, then the bank.
    let bank = snapshot.banks[agent.index()].min(left);
    Moment {
        acted,
        deadline: Some(app.clock.to_wall(deadline)),
        remaining_ms: Some(millis(left)),
        bank_ms: Some(millis(bank)),
        prompt: None,
    }
}
