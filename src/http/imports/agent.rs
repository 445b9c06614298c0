//! `GET /api/v1/imports/{id}/rounds/{round}/agents/{agent}`.

use std::time::Duration;

use axum::Json;
use jiff::Timestamp;
use serde::Deserialize;
use swarmbench_engine::AgentId;

use super::super::extract::AgentPlace;
use super::super::prelude::*;
use super::unreadable;
use crate::dataset::format::AgentAt;
use crate::dataset::imported::{Unreadable, each_act, game_row};
use crate::store::entries::ImportedRound;
use swarmbench_clock::millis;
use swarmbench_protocol::act::Usage;
use swarmbench_protocol::failure::Failure;
use swarmbench_protocol::replay::{AgentRound, ShownAct};

/// Show the prompt, answer and act of an agent of an imported game in a round, as far as the files have them.
///
/// The files do not have its messages with their senders.
#[utoipa::path(
    get,
    path = "/api/v1/imports/{id}/rounds/{round}/agents/{agent}",
    operation_id = "show_import_agent_round",
    tag = "data",
    params(
        ("round" = u32, Path, description = "The round: 0 up to the number of rounds"),
        ("agent" = String, Path, description = "The agent's name in the files, or `Agent_5` for the sixth of them"),
    ),
    responses(
        (status = 200, description = "The act of the agent, with its prompt and answer", body = AgentRound),
        (status = 404, description = "`not_found`: no such game, round or agent"),
        (status = 422, description = "`invalid`: an earlier version stored more than the limit `import_state_bytes_max`"),
    )
)]
pub(in super::super) async fn show_import_agent_round(
    State(app): State<App>,
    caller: Caller,
    AgentPlace { id, round, agent }: AgentPlace,
    _: Params<Nothing>,
) -> Result<Json<AgentRound>, ApiError> {
    let stored = app.import(&caller, &id).await?;
    if round > stored.rounds {
        let detail = format!("the game has {} rounds, and no round {round}", stored.rounds);
        return Err(ApiError::new(Code::NotFound, detail).at_round(stored.rounds));
    }
    let (state, memory) = app.imported_state(&stored, round).await?;
    let task = stored.task.clone();
    let found = app.heavy.render(move || {
        let _memory = memory;
        act_of(&task, &state, &agent)
    });
    let found = found.await?.map_err(unreadable)?;
    let (agent, act) = found.ok_or_else(|| ApiError::not_found("the agent"))?;
    let prompt = act.as_ref().and_then(|act| act.prompt.clone());
    Ok(Json(AgentRound {
        episode: stored.id,
        round,
        agent,
        observation: None,
        inbox: None,
        prompt,
        prompt_problem: None,
        act: act.map(shown),
    }))
}

/// Name of an agent in the files, and its act in a state; `None` if there is no such agent.
fn act_of(
    task: &str,
    state: &ImportedRound,
    agent: &str,
) -> Result<Option<(String, Option<FoundRow>)>, Unreadable> {
    let agents = game_row(task, state)?.agents;
    let by_name = agents.iter().find(|known| known.id == agent);
    let by_place = || agents.get(AgentId::parse(agent)?.index());
    let Some(AgentAt { id, .. }) = by_name.or_else(by_place) else { return Ok(None) };
    let mut act = None;
    each_act(state, u32::try_from(agents.len()).unwrap_or(u32::MAX), |row: FoundRow| {
        if act.is_none() && row.agent_id == *id {
            act = Some(row);
        }
        Ok(())
    })?;
    Ok(Some((id.clone(), act)))
}

/// Fields of an act in the files that are shown.
#[derive(Deserialize)]
struct FoundRow {
    agent_id: String,
    timestamp: Option<f64>,
    prompt: Option<String>,
    response: Option<String>,
    action: Option<String>,
    message: Option<String>,
    api_call_time: Option<f64>,
    failure: Option<Failure>,
}

fn shown(row: FoundRow) -> ShownAct {
    let latency = row.api_call_time.and_then(|s| Duration::try_from_secs_f64(s).ok());
    let usage = latency.map(|time| Usage { latency_ms: Some(millis(time)), ..Usage::default() });
    let at = row.timestamp.and_then(|s| Duration::try_from_secs_f64(s).ok());
    let at = at.and_then(|since| Timestamp::from_millisecond(millis(since).try_into().ok()?).ok());
    let text = |text: Option<String>| text.filter(|text| !text.is_empty());
    ShownAct {
        source: None,
        action: text(row.action),
        message: text(row.message),
        to: None,
        valid: None,
        failure: row.failure,
        response: text(row.response),
        reasoning: None,
        harness: None,
        usage,
        bank_spent_ms: None,
        at: at.map(Into::into),
    }
}
