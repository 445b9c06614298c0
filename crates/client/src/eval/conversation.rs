//! Seats played by a language model: each observation is a question of its own.

use std::collections::BTreeMap;
use std::sync::Arc;

use tokio::sync::Mutex;

use super::judge::Judge;
use super::plan::Planned;
use super::stop_reason::StopReason;
use crate::client::Client;
use crate::drive::{Swarm, Thought};
use crate::llm::{Model, ModelAnswer, Question};
use swarmbench_protocol::act::{ActRequest, SwarmAct};
use swarmbench_protocol::observation::Observation;

/// A language model on all seats of a run. A question contains the server's prompt of one seat's observation, which
/// holds the memory of that seat, and the system message of the model, but no earlier question.
pub struct Conversation {
    model: Model,
    names: Arc<Names>,
    judge: Arc<Judge>,
}

/// The names of games for cassettes, by episode.
struct Names {
    client: Client,
    run: String,
    token: String,
    planned: Planned,
    known: Mutex<BTreeMap<String, String>>,
}

impl Conversation {
    /// A model that plays a run.
    #[must_use]
    pub fn new(
        client: &Client,
        run: &str,
        token: &str,
        planned: &Planned,
        model: Model,
        judge: Arc<Judge>,
    ) -> Self {
        let names = Names {
            client: client.clone(),
            run: run.to_owned(),
            token: token.to_owned(),
            planned: planned.clone(),
            known: Mutex::default(),
        };
        Self { model, names: Arc::new(names), judge }
    }
}

impl Swarm for Conversation {
    type Error = StopReason;

    // Requests in flight are paid for, and the allowance begins no others.
    const WAITS_WHEN_STOPPED: bool = true;

    fn reads_prompts(&self) -> bool {
        true
    }

    fn decide(&mut self, looked: Vec<Observation>) -> Vec<Thought<StopReason>> {
        let begin = |seen: Observation| -> Thought<StopReason> {
            let (model, names) = (self.model.clone(), Arc::clone(&self.names));
            let judge = Arc::clone(&self.judge);
            Box::pin(async move {
                judge.check()?;
                Ok(vec![ask(&model, &names, seen).await?])
            })
        };
        looked.into_iter().map(begin).collect()
    }

    fn waits_for_others(error: &StopReason) -> bool {
        // Requests in flight are paid for, and no others begin.
        matches!(
            error,
            StopReason::Requested
                | StopReason::Budget { .. }
                | StopReason::Model(_)
                | StopReason::Failing { .. }
        )
    }
}

async fn ask(model: &Model, names: &Names, seen: Observation) -> Result<SwarmAct, StopReason> {
    let Observation { sight, moment } = seen;
    let game = names.of(&sight.episode).await?;
    let Some(prompt) = moment.prompt else {
        return Err(StopReason::Play("the server sent no prompt".to_owned()));
    };
    let question = Question {
        game,
        agent: sight.agent.clone(),
        round: sight.round,
        system: names.planned.system_of(&sight.task.name).map(str::to_owned),
        prompt,
    };
    let ModelAnswer { response, usage, reasoning, failure, .. } = model.answer(&question).await?;
    let act = ActRequest {
        round: sight.round,
        // An empty response counts as well: the model said nothing.
        response: Some(response),
        usage: Some(usage),
        reasoning,
        // The server finds the other failures in the text.
        failure: failure.filter(|failure| failure.is_of_client()),
        ..ActRequest::default()
    };
    Ok(SwarmAct::of(sight.episode, sight.agent, act))
}

impl Names {
    /// The name of an episode's game. Games are opened one after another, so an unknown episode means that the run is
    /// read again.
    async fn of(&self, episode: &str) -> Result<String, StopReason> {
        let mut known = self.known.lock().await;
        if let Some(name) = known.get(episode) {
            return Ok(name.clone());
        }
        let run = self.client.run(&self.run, Some(&self.token)).await?;
        for game in run.games {
            let Some(episode) = game.episode else { continue };
            let name = match game.seed {
                Some(seed) => self.planned.game_name(&game.task, seed),
                // The seed is sealed, and nobody else plays this game.
                None => episode.clone(),
            };
            known.insert(episode, name);
        }
        let name = known.get(episode).cloned();
        name.ok_or_else(|| StopReason::Play(format!("the run does not list its game {episode}")))
    }
}
