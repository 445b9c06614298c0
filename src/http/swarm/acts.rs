//! `GET /swarm/acts`: earlier acts of a seat, for a program that goes on with its dialogue.

use std::collections::VecDeque;

use axum::Json;
use serde::Deserialize;
use swarmbench_engine::AgentId;
use utoipa::IntoParams;

use super::super::auth::Swarm;
use super::super::extract::flag;
use super::super::prelude::*;
use super::Source;
use crate::episode::Status;
use crate::store::records::TimedAct;
use swarmbench_protocol::act::{Harness, SeatAct, SeatActs};
use swarmbench_replay::shown_act;

/// Bytes of texts after which no older act is added: a full one is smaller.
const TEXT_BYTES_MAX: usize = 1024 * 1024;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct SwarmActsParams {
    /// Id of the episode.
    episode: String,
    /// Name of an agent whose seat the token holds.
    agent: String,
    /// Number of resolved rounds, up to 20; 1 by default.
    #[param(minimum = 1, maximum = 20)]
    last: Option<usize>,
    /// Round before which these rounds are; that which is open by default.
    before: Option<u32>,
    /// Whether to add the texts for a language model.
    #[serde(default, deserialize_with = "flag")]
    prompt: bool,
}

/// Get the acts of one seat in the last resolved rounds, with what its program kept for its next question.
///
/// Only the holder of the seat may read them so, also while the game is sealed. The answer has about 1 MiB: `before` with the round
/// of its first act continues to older acts that did not fit.
#[utoipa::path(
    get,
    path = "/swarm/acts",
    operation_id = "get_swarm_acts",
    tag = "swarm",
    params(SwarmActsParams),
    responses(
        (status = 200, description = "The acts, oldest first", body = SeatActs),
        (status = 403, description = "`forbidden`: not a swarm token, or not of this seat"),
        (status = 404, description = "`not_found`: no such episode or agent"),
        (status = 422, description = "`template_failed`: prompts were requested and cannot be made"),
        (status = 503, description = "`overloaded`: too many episodes are being replayed"),
    )
)]
pub(in super::super) async fn get_swarm_acts(
    State(app): State<App>,
    swarm: Swarm,
    Params(params): Params<SwarmActsParams>,
) -> Result<Json<SeatActs>, ApiError> {
    let most = usize::from(Harness::ROUNDS_MAX);
    let last = params.last.unwrap_or(1);
    if !(1..=most).contains(&last) {
        let detail = format!("last must be from 1 to {most}, is {last}");
        return Err(ApiError::new(Code::Malformed, detail));
    }
    let mut source = Source::of(&app, swarm).await?;
    let seated = source.find(&app, &params.episode).await?;
    let seated = seated.ok_or_else(|| ApiError::not_found("the episode"))?;
    let handle = &seated.handle;
    let agents = handle.spec.config.num_agents();
    let agent = AgentId::parse(&params.agent).filter(|agent| agent.0 < agents);
    let agent = agent.ok_or_else(|| ApiError::not_found("the agent"))?;
    if !seated.holds(agent) {
        let detail = format!("this token is not valid for the seat of {agent}");
        return Err(ApiError::new(Code::Forbidden, detail));
    }
    let resolved = handle.snapshot().world.round();
    let end = params.before.unwrap_or(resolved).min(resolved);
    let mut acts = VecDeque::with_capacity(last);
    let mut bytes = 0;
    for round in (0..end).rev().take(last) {
        let Some(TimedAct { record, at }) = app.store.timed_act(handle.key, round, agent).await?
        else {
            continue;
        };
        // A prompt is made for acts of models alone.
        let prompt = if params.prompt && record.response.is_some() {
            let world = app.state_at(handle, round, None).await?;
            Some(app.sight(handle, world, agent, (Status::Running, None)).await?.1?)
        } else {
            None
        };
        let texts = [&prompt, &record.response, &record.reasoning].into_iter().flatten();
        let of_harness = record.harness.iter().flat_map(|harness| harness.texts());
        bytes += texts.map(String::as_str).chain(of_harness).map(str::len).sum::<usize>();
        acts.push_front(SeatAct { round, prompt, act: shown_act(record, Some(at.into())) });
        if bytes > TEXT_BYTES_MAX {
            break;
        }
    }
    Ok(Json(SeatActs { acts: acts.into() }))
}
