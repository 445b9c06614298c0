//! `GET /obs`: the current observation of the token's agent.

use std::time::Duration;

use serde::Deserialize;
use utoipa::IntoParams;

use super::super::answer::json;
use super::super::auth::TokenSeat;
use super::super::extract::{flag, wait};
use super::super::prelude::*;
use super::observation::{ObservationRequest, observation};
use crate::episode::Snapshot;
use swarmbench_protocol::observation::Observation;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct ObsParams {
    /// Round for `wait`: wait until the open round is later.
    after: Option<u32>,
    /// Maximum number of seconds to wait, up to 60; after that the answer is the current observation.
    wait: Option<f64>,
    /// Whether to add the text for a language model.
    #[serde(default, deserialize_with = "flag")]
    prompt: bool,
}

/// Get the current observation of the token's agent.
///
/// A look never changes anything and never costs a move.
#[utoipa::path(
    get,
    path = "/obs",
    operation_id = "get_obs",
    tag = "agent",
    params(ObsParams),
    responses(
        (status = 200, description = "The current observation", body = Observation),
        (status = 403, description = "`forbidden`: not a seat token"),
        (status = 422, description = "`template_failed`: a prompt was requested and cannot be made"),
    )
)]
pub(in super::super) async fn get_obs(
    State(app): State<App>,
    seat: TokenSeat,
    Params(params): Params<ObsParams>,
) -> Result<Response, ApiError> {
    let wait = wait(&app, params.wait)?;
    Ok(json(see(&app, &seat, params.after, wait, params.prompt).await?))
}

/// Observation of a seat, once the round is past `after` or `wait` has passed.
pub(in super::super) async fn see(
    app: &App,
    seat: &TokenSeat,
    after: Option<u32>,
    wait: Duration,
    prompt: bool,
) -> Result<Vec<u8>, ApiError> {
    let snapshot = match after {
        Some(after) => {
            let wanted = |snapshot: &Snapshot| is_past(snapshot, after);
            Box::pin(app.waits.until(&seat.handle, wait, wanted)).await?
        }
        None => seat.handle.snapshot(),
    };
    let request = ObservationRequest::now(app, &seat.handle, &snapshot, seat.agent);
    observation(app, request, prompt).await
}

/// An episode that is over is past every round.
pub(in super::super) fn is_past(snapshot: &Snapshot, round: u32) -> bool {
    snapshot.status.is_over() || snapshot.world.round() > round
}
