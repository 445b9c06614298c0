//! `GET /swarm/obs`: the observations that wait for an act.

use axum::extract::State;
use axum::response::Response;
use serde::Deserialize;
use swarmbench_engine::AgentId;
use utoipa::IntoParams;

use super::super::App;
use super::super::agent::obs::{json, observation, with_field};
use super::super::auth::Swarm;
use super::super::error::{ApiError, Code};
use super::super::extract::{Params, wait};
use super::super::openapi::{QueryRefusals, TokenRefusals};
use crate::episode::Snapshot;
use crate::wire::act::SwarmObsResponse;
use crate::wire::problem::Problem;

/// How to look.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct SwarmObsParams {
    /// Return only what was opened since the answer that had this cursor.
    after: Option<String>,
    /// Seconds to wait for at least one observation, up to 60.
    wait: Option<f64>,
    /// How many observations at most, up to 1,024; 256 where it is left out.
    #[param(minimum = 1, maximum = 1024)]
    limit: Option<usize>,
    /// Add the texts for a language model.
    #[serde(default)]
    prompt: bool,
}

/// Look for several seats: the observations that wait for an act, oldest first.
///
/// At least one, unless the time was up or all is over.
#[utoipa::path(
    get,
    path = "/swarm/obs",
    operation_id = "get_swarm_obs",
    tag = "swarm",
    params(SwarmObsParams),
    security(("swarm" = [])),
    responses(
        (status = 200, description = "The observations that wait for an act", body = SwarmObsResponse),
        QueryRefusals,
        TokenRefusals,
        (status = 403, description = "`forbidden`: not a swarm token", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "`template_failed`: prompts were asked for and cannot be made", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in super::super) async fn get_swarm_obs(
    State(app): State<App>,
    swarm: Swarm,
    Params(params): Params<SwarmObsParams>,
) -> Result<Response, ApiError> {
    let patience = wait(&app, params.wait)?;
    let most = app.limits.observations_max;
    let limit = params.limit.unwrap_or(app.limits.observations_default);
    if !(1..=most).contains(&limit) {
        let detail = format!("limit must be from 1 to {most}, is {limit}");
        return Err(ApiError::limit(Code::Malformed, "observations_max", most, detail));
    }
    let after = match &params.after {
        Some(text) => Cursor::parse(text, app.boot)?,
        None => Cursor::START,
    };
    let wanted = |snapshot: &Snapshot| {
        snapshot.status.is_over() || open_seats(&swarm, snapshot, after).next().is_some()
    };
    let snapshot = app.wait_until(&swarm.handle, patience, wanted).await?;
    let mut observations = b"[".to_vec();
    let mut cursor = after;
    for seat in open_seats(&swarm, &snapshot, after).take(limit) {
        let agent = AgentId(seat.agent);
        let body = observation(&app, &swarm.handle, &snapshot, agent, params.prompt).await?;
        if observations.len() > 1 {
            observations.push(b',');
        }
        observations.extend_from_slice(&body);
        cursor = seat;
    }
    observations.push(b']');
    let rest = Rest { cursor: cursor.write(app.boot), finished: snapshot.status.is_over() };
    Ok(json(with_field(&rest, "observations", &observations)))
}

/// What a [`SwarmObsResponse`] has beside observations, which are written out already.
#[derive(serde::Serialize)]
struct Rest {
    cursor: String,
    finished: bool,
}

/// The token's seats that wait for an act and were opened after `after`.
fn open_seats<'a>(
    swarm: &'a Swarm,
    snapshot: &'a Snapshot,
    after: Cursor,
) -> impl Iterator<Item = Cursor> + 'a {
    let own = snapshot.world.agents().filter(|&agent| swarm.covers(agent));
    let waiting = own.filter(|&agent| snapshot.waits_for(agent));
    waiting
        .map(|agent| Cursor { opened: snapshot.opened, agent: agent.0 })
        .filter(move |seat| *seat > after)
}

/// A place in the order in which observations were opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Cursor {
    opened: u64,
    agent: u16,
}

impl Cursor {
    /// Before everything.
    const START: Self = Self { opened: 0, agent: 0 };

    fn write(self, boot: u64) -> String {
        format!("{boot:016x}.{}.{}", self.opened, self.agent)
    }

    /// Reads a cursor. One of an earlier run of the server is before everything: after a restart
    /// all open rounds are opened anew.
    fn parse(text: &str, boot: u64) -> Result<Self, ApiError> {
        let read = || {
            let mut parts = text.split('.');
            let run = u64::from_str_radix(parts.next()?, 16).ok()?;
            let opened = parts.next()?.parse().ok()?;
            let agent = parts.next()?.parse().ok()?;
            parts.next().is_none().then_some((run, Self { opened, agent }))
        };
        let (run, cursor) = read().ok_or_else(|| {
            ApiError::new(Code::Malformed, "after must be the cursor of an earlier answer")
        })?;
        Ok(if run == boot { cursor } else { Self::START })
    }
}
