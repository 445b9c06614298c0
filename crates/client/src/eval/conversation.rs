//! Seats played by a language model: each observation is a question.

use std::collections::BTreeMap;
use std::sync::Arc;

use tokio::sync::Mutex;

use super::harness::{HarnessPlan, Words};
use super::judge::Judge;
use super::memory::{Memory, message};
use super::plan::{ModelPlan, Planned};
use super::stop_reason::StopReason;
use super::system::SystemMessage;
use crate::client::Client;
use crate::drive::{Swarm, Thought};
use crate::llm::{Failure, Model, ModelAnswer, Question};
use swarmbench_engine::{AgentId, AnswerReader, Config, Control, Settings, answer};
use swarmbench_protocol::act::{ActRequest, Harness, SwarmAct, Try, Usage};
use swarmbench_protocol::observation::{Observation, Sight};
use swarmbench_protocol::suite::Suite;

/// A language model on all seats of a run. A question contains the server's prompt of one seat's observation, which
/// holds the memory of that seat, the system message of the model, and what its harness adds: by default nothing.
pub struct Conversation {
    asker: Arc<Asker>,
}

struct Asker {
    model: Model,
    names: Names,
    judge: Arc<Judge>,
    system: Option<SystemMessage>,
    harness: HarnessPlan,
    memory: Memory,
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
    /// A model of a plan that plays a run, or its seats in it, with the id of the run and its token.
    #[must_use]
    pub fn new(
        client: &Client,
        (run, token): (&str, &str),
        (planned, plan): (&Planned, &ModelPlan),
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
        let (system, harness) = (plan.system.clone(), plan.harness);
        let memory = Memory::new(client, token, harness);
        Self { asker: Arc::new(Asker { model, names, judge, system, harness, memory }) }
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
            let asker = Arc::clone(&self.asker);
            Box::pin(async move {
                asker.judge.check()?;
                Ok(vec![asker.ask(seen).await?])
            })
        };
        looked.into_iter().map(begin).collect()
    }

    fn acted(&mut self, act: &SwarmAct) {
        self.asker.memory.acted(act);
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

impl Asker {
    async fn ask(&self, seen: Observation) -> Result<SwarmAct, StopReason> {
        let Observation { sight, moment } = seen;
        let planned = &self.names.planned;
        let game = self.names.of(&sight.episode).await?;
        let Some(prompt) = moment.prompt else {
            return Err(StopReason::Play("the server sent no prompt".to_owned()));
        };
        let recalled = self.memory.recall(&sight).await?;
        let settings = &planned.suite.settings;
        let words = Words {
            scratchpad: self.harness.numbers()[1],
            is_json: settings.answer_reader == AnswerReader::Json.name(),
            commands: settings.control == Control::Centralized.name()
                && AgentId::parse(&sight.agent) == Some(AgentId::COMMANDER),
            sight: &sight,
        };
        let added = words.added(&recalled.scratchpad);
        let (items, history, carried) = recalled.dialogue(sight.round, self.harness.numbers()[0]);
        let whole = [Some(&prompt), added.as_ref()].into_iter().flatten().cloned();
        let mut question = Question {
            game,
            agent: sight.agent.clone(),
            round: sight.round,
            system: self
                .system
                .as_ref()
                .and_then(|all| all.of(&sight.task.name))
                .map(str::to_owned),
            prompt: whole.collect::<Vec<_>>().join("\n\n"),
            items,
            schema: words.schema(),
        };
        let (answer, tries) = self.try_for_valid(&mut question, &sight).await?;
        let ModelAnswer { response, usage, reasoning, failure, items, .. } = answer;
        let scratchpad = words.notes(&response).unwrap_or(recalled.scratchpad);
        let scratchpad = Some(scratchpad).filter(|notes| !notes.is_empty());
        let mut harness = Harness { history, carried, added, scratchpad, tries };
        if harness.fault(sight.round).is_some() {
            // A model may write more than the server stores.
            harness.shorten();
        }
        self.memory.asked(&sight, prompt, items);
        let act = ActRequest {
            round: sight.round,
            // An empty response counts as well: the model said nothing.
            response: Some(response),
            usage: Some(usage),
            reasoning,
            // The server finds the other failures in the text.
            failure: failure.filter(|failure| failure.is_of_client()),
            harness: Some(harness).filter(|harness| *harness != Harness::default()).map(Box::new),
            ..ActRequest::default()
        };
        Ok(SwarmAct::of(sight.episode, sight.agent, act))
    }

    /// Asks until the server would take the answer, as often as the harness says. Returns the last answer, whose usage is the sum
    /// of all, and those before it.
    async fn try_for_valid(
        &self,
        question: &mut Question,
        sight: &Sight,
    ) -> Result<(ModelAnswer, Vec<Try>), StopReason> {
        let mut tries = Vec::new();
        let mut earlier: Option<Usage> = None;
        loop {
            let mut answer = self.model.answer(question).await?;
            let usage = earlier.map_or(answer.usage, |before| sum(before, answer.usage));
            earlier = Some(usage);
            let is_last = tries.len() >= self.harness.numbers()[2] as usize;
            let fault = if is_last { None } else { self.fault(&answer, sight) };
            let Some(told) = fault else {
                answer.usage = usage;
                return Ok((answer, tries));
            };
            let mut response = answer.response;
            // The end has the decision.
            response
                .drain(..response.ceil_char_boundary(response.len().saturating_sub(TRY_BYTES_MAX)));
            question.items.push(message("user", &question.prompt));
            question.items.push(message("assistant", &response));
            question.prompt.clone_from(&told);
            tries.push(Try { response, told });
        }
    }

    /// Reply to an answer that the server would not take, by the server's own reader; `None` if it would take it, and if
    /// the endpoint rejects the question.
    fn fault(&self, answer: &ModelAnswer, sight: &Sight) -> Option<String> {
        let Suite { rules, settings, .. } = &self.names.planned.suite;
        let (task, rules) = (sight.task.name.clone(), rules.clone());
        let settings = Settings { task, rules, ..Settings::from(settings) };
        let config = Config::check(&settings).ok()?;
        let fault = answer::parse(&answer.response, &config, AgentId::parse(&sight.agent)?).fault?;
        let failure = Failure::of(answer.failure, fault);
        let reason = match failure {
            Failure::Rejected => return None,
            Failure::UnknownAction => {
                format!("its action is none of {}", sight.actions.join(", "))
            }
            Failure::NoMarker if config.answer_reader() == AnswerReader::Json => {
                "it has no JSON object with an action or a message".to_owned()
            }
            Failure::NoMarker => "it has no line with ACTION: or MSG:".to_owned(),
            Failure::Truncated => "it was cut at the limit of tokens; be shorter".to_owned(),
            other => format!("it counts as {}", other.words()),
        };
        Some(format!(
            "Your answer is invalid: {reason}. Answer again, in the form that was asked for."
        ))
    }
}

/// Maximum bytes of an invalid answer that is shown to the model again, and stored.
const TRY_BYTES_MAX: usize = 4 * 1024;

/// The usage of an answer and of those before it. The time to the first token is that of the last answer, and the cost is known if
/// that of each is.
fn sum(before: Usage, last: Usage) -> Usage {
    let add = |a: Option<u64>, b: Option<u64>| match (a, b) {
        (Some(a), Some(b)) => Some(a.saturating_add(b)),
        (a, b) => a.or(b),
    };
    Usage {
        prompt_tokens: add(before.prompt_tokens, last.prompt_tokens),
        completion_tokens: add(before.completion_tokens, last.completion_tokens),
        latency_ms: add(before.latency_ms, last.latency_ms),
        first_token_ms: last.first_token_ms,
        cached_tokens: add(before.cached_tokens, last.cached_tokens),
        cache_write_tokens: add(before.cache_write_tokens, last.cache_write_tokens),
        reasoning_tokens: add(before.reasoning_tokens, last.reasoning_tokens),
        cost_nano_usd: (before.cost_nano_usd.zip(last.cost_nano_usd))
            .map(|(before, last)| before.saturating_add(last)),
    }
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
        let plan = self.planned.suite.plan();
        let mut voided = BTreeMap::<u32, u32>::new();
        for game in run.games {
            let Some(episode) = game.episode else { continue };
            // The server hides seeds from the holders of a team; the plan has them.
            let planned = plan.iter().find(|planned| planned.slot == game.slot);
            let earlier = voided.entry(game.slot).or_default();
            let name = match game.seed.or(planned.map(|planned| planned.seed)) {
                Some(seed) if *earlier > 0 => {
                    // The answers of the earlier game are not those of this one.
                    format!("{}/again{earlier}", self.planned.game_name(&game.task, seed))
                }
                Some(seed) => self.planned.game_name(&game.task, seed),
                // The seed is sealed, and nobody else plays this game.
                None => episode.clone(),
            };
            *earlier += u32::from(game.void_reason.is_some());
            known.insert(episode, name);
        }
        let name = known.get(episode).cloned();
        name.ok_or_else(|| StopReason::Play(format!("the run does not list its game {episode}")))
    }
}
