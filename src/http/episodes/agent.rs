//! `GET /api/v1/episodes/{id}/rounds/{round}/agents/{agent}`.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use axum::Json;
use swarmbench_engine::{AgentId, World};

use super::super::agent::observation::result;
use super::super::extract::AgentPlace;
use super::super::prelude::*;
use crate::episode::Status;
use crate::episode::actor::Handle;
use crate::store::port::EpisodeStore;
use crate::store::records::TimedAct;
use swarmbench_prompt::{TemplateError, tasks};
use swarmbench_protocol::episode::EpisodeResult;
use swarmbench_protocol::observation::Sight;
use swarmbench_protocol::replay::{AgentRound, InboxMessage};
use swarmbench_replay::{agent_round, inbox, shown_act};

/// Show the knowledge of an agent in a round, and its act.
///
/// The answer has its observation, the messages that it read with their senders, the text for a language model, and its act
/// with the answer and the reasons. Whoever may read the journal may read this.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}/rounds/{round}/agents/{agent}",
    operation_id = "show_agent_round",
    tag = "episodes",
    params(
        ("round" = u32, Path, description = "The round that the observation answers: 0 up to the number of resolved rounds"),
        ("agent" = String, Path, description = "The agent's name"),
    ),
    responses(
        (status = 200, description = "The knowledge of the agent and its act", body = AgentRound),
        (status = 403, description = "`forbidden`: only the creator may read it before the end"),
        (status = 404, description = "`not_found`: no such episode or agent, or the round has not come yet"),
        (status = 503, description = "`overloaded`: too many episodes are being replayed"),
    )
)]
pub(in super::super) async fn show_agent_round(
    State(app): State<App>,
    caller: Caller,
    AgentPlace { id, round, agent }: AgentPlace,
    _: Params<Nothing>,
) -> Result<Json<AgentRound>, ApiError> {
    let stored = app.journaled_episode(&caller, id).await?;
    let handle = app.episode(&stored.id).await?;
    let agents = handle.spec.config.num_agents();
    let agent = AgentId::parse(&agent).filter(|agent| agent.0 < agents);
    let agent = agent.ok_or_else(|| ApiError::not_found("the agent"))?;
    let snapshot = handle.snapshot();
    let newest = snapshot.world.round();
    let (world, status, result) = match round.cmp(&newest) {
        std::cmp::Ordering::Less => {
            (app.state_at(&handle, round, None).await?, Status::Running, None)
        }
        std::cmp::Ordering::Equal => {
            (Arc::clone(&snapshot.world), snapshot.status, result(&snapshot))
        }
        std::cmp::Ordering::Greater => {
            let detail =
                format!("the episode stands at round {newest}; round {round} is not resolved");
            return Err(ApiError::new(Code::NotFound, detail).at_round(newest));
        }
    };
    let inbox = app.inbox(&handle, &world, agent).await?;
    let act = if round < newest {
        app.store
            .timed_act(handle.key, round, agent)
            .await?
            .map(|TimedAct { record, at }| shown_act(record, Some(at.into())))
    } else {
        None
    };
    let (sight, prompt) = app.sight(&handle, world, agent, (status, result)).await?;
    let prompt = prompt.map_err(|problem| problem.to_string());
    Ok(Json(agent_round(sight, inbox, Some(prompt), act)))
}

impl App {
    /// What an agent sees of a state, and the text of it for a language model.
    pub(in super::super) async fn sight(
        &self,
        handle: &Handle,
        world: Arc<World>,
        agent: AgentId,
        (status, result): (Status, Option<EpisodeResult>),
    ) -> Result<(Sight, Result<String, TemplateError>), ApiError> {
        let (id, spec) = (handle.id.to_string(), Arc::clone(&handle.spec));
        let write = move || {
            let description = tasks::description(&spec.config);
            let sight = Sight::of(&world.observe(agent), id, description, status, result);
            let prompt = swarmbench_prompt::render(&spec.prompt_template, &sight, &spec.config);
            (sight, prompt)
        };
        self.heavy.render(write).await
    }

    /// The messages that an agent reads with a state.
    async fn inbox(
        &self,
        handle: &Handle,
        world: &World,
        agent: AgentId,
    ) -> Result<Vec<InboxMessage>, ApiError> {
        let heard = world.heard().filter(|heard| heard.receiver == agent);
        let heard: BTreeSet<_> = heard.map(|heard| (heard.sent, heard.sender)).collect();
        let mut sent = BTreeMap::new();
        if handle.spec.config.settings().noise > 0.0 {
            let rounds: BTreeSet<u32> = heard.iter().map(|(round, _)| *round).collect();
            // The acts of one round at a time are in memory.
            for round in rounds {
                let acts = self.store.acts(handle.key, round, round + 1).await?;
                let acts = acts.into_iter().flat_map(|(_, acts)| acts);
                let messages = acts.map(|(sender, act)| ((round, sender), act.record.message));
                sent.extend(messages.filter(|(act, _)| heard.contains(act)));
            }
        }
        Ok(inbox(world, agent, |round, sender| sent.get(&(round, sender)).cloned().flatten()))
    }
}
