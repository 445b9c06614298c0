//! `GET /obs`: the current observation of the token's agent.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

use super::super::App;
use super::super::auth::Seat;
use super::super::error::ApiError;
use super::super::extract::{Params, wait};
use super::super::refusals::{QueryRefusals, TokenRefusals};
use super::look::{Look, observation};
use crate::episode::Snapshot;
use crate::wire::observation::Observation;
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
    let look = Look::now(&app, &seat.handle, &snapshot, seat.agent);
    Ok(json(observation(&app, look, params.prompt).await?))
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
