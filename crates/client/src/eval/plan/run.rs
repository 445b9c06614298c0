//! A run of a plan: its player, its games, its identity, and the request that creates it.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};
use swarmbench_boards::run::SYSTEM_MESSAGE;
use swarmbench_engine::{Seed, Settings, TaskName};
use swarmbench_players::{BuiltIn, find};
use swarmbench_prompt::Identity;
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::run::{OwnSettings, OwnSuite, RunRequest, SuiteRequest};
use swarmbench_protocol::suite::{Suite, digest_of_template};

use super::super::experiment::Price;
use super::settings::{setting_text, value};
use super::suite::ranges;
use crate::eval::entry::Entry;
use crate::eval::system::SystemMessage;
use crate::llm::Api;

/// The field of `agent_meta` with the identity of a run.
pub const META: &str = "eval";

/// A part of every identity, raised whenever the same description means another run.
const FORMAT: u32 = 1;

/// Seconds until an interrupted run is abandoned: 90 days. The server's default is a day, which may pass before there
/// is a new budget.
const IDLE_TIMEOUT_S: f64 = 90.0 * 86_400.0;

/// A language model and its requests.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelPlan {
    /// The name on boards.
    pub name: String,
    /// The name at the endpoint.
    pub model: String,
    /// The address of the endpoint, if one was named.
    pub api_base: Option<String>,
    /// The environment variable with its key, if one was named.
    pub api_key_env: Option<String>,
    /// The interface of the endpoint.
    pub api: Api,
    /// Further headers, by name, as they were given: with the names of environment variables, not their values.
    pub headers: BTreeMap<String, String>,
    /// Concurrent requests to this model, if it has its own limit.
    pub requests: Option<u32>,
    /// The sampling temperature.
    pub temperature: Option<f64>,
    /// The nucleus of sampling.
    pub top_p: Option<f64>,
    /// The maximum number of tokens of an answer.
    pub max_tokens: Option<u64>,
    /// Further fields of each request.
    pub extra: Map<String, Value>,
    /// The system message.
    pub system: Option<SystemMessage>,
    /// The price of its tokens, if known, which is no part of the identity.
    pub price: Option<Price>,
}

/// Built-in players.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlayerPlan {
    /// The name of a player, or `default` for each task's own.
    pub name: String,
    /// The seed of the players' own choices.
    pub seed: u64,
    /// The player of each task.
    pub by_task: BTreeMap<TaskName, &'static str>,
}

impl PlayerPlan {
    /// The built-in players by task.
    #[must_use]
    pub fn players(&self) -> BTreeMap<TaskName, &'static BuiltIn> {
        let known =
            self.by_task.iter().filter_map(|(&task, name)| Some((task, find(name, task).ok()?)));
        known.collect()
    }
}

/// The player of a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Who {
    /// A language model.
    Model(Box<ModelPlan>),
    /// Built-in players.
    Player(PlayerPlan),
}

/// A run of a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Planned {
    /// The player.
    pub who: Who,
    /// The suite of games.
    pub suite: Suite,
    /// A custom prompt template for a model.
    pub template: Option<String>,
    /// True if a recording answers in place of the model.
    pub is_replay: bool,
    /// The competition and the entrant of an attempt. Its suite has no seeds, as they are sealed.
    pub entry: Option<Box<Entry>>,
}

impl Planned {
    /// The player's name on boards.
    #[must_use]
    pub fn name(&self) -> String {
        match &self.who {
            Who::Model(model) => model.name.clone(),
            Who::Player(player) => format!("built-in/{}", player.name),
        }
    }

    /// The tasks of its suite.
    pub fn tasks(&self) -> impl Iterator<Item = TaskName> + '_ {
        self.suite.tasks.iter().filter_map(|task| TaskName::parse(task))
    }

    /// The value of one of [`axes`](super::axes) as text, if the run has one.
    #[must_use]
    pub fn setting(&self, axis: &str) -> Option<String> {
        self.value(axis).as_ref().map(setting_text)
    }

    /// The value of one of [`axes`](super::axes), if the run has one.
    #[must_use]
    pub fn value(&self, axis: &str) -> Option<Value> {
        let Suite { rules, settings, .. } = &self.suite;
        value(axis, rules, &settings.into(), self.sampling())
    }

    /// The temperature and `top_p` of a model; none for built-in players.
    pub(in crate::eval) fn sampling(&self) -> [Option<f64>; 2] {
        match &self.who {
            Who::Model(model) => [model.temperature, model.top_p],
            Who::Player(_) => [None, None],
        }
    }

    /// The system message of a model.
    fn system(&self) -> Option<&SystemMessage> {
        match &self.who {
            Who::Model(model) => model.system.as_ref(),
            Who::Player(_) => None,
        }
    }

    /// The system message of a model in a task, if any.
    #[must_use]
    pub fn system_of(&self, task: &str) -> Option<&str> {
        self.system()?.of(task)
    }

    /// The identity of a model's prompt.
    #[must_use]
    pub fn prompt(&self) -> Identity {
        let system = self.system().map(|system| system.json().to_string());
        let own =
            Identity::of(self.template.as_deref(), swarmbench_prompt::REVISION, system.as_deref());
        match &self.entry {
            Some(entry) => entry.prompt(own.system),
            None => own,
        }
    }

    /// The part of the identity beside suite, sampling and template, for `agent_meta`.
    fn meta(&self) -> Map<String, Value> {
        let fields = match &self.who {
            Who::Model(plan) => vec![
                ("model", (plan.model != plan.name).then(|| json!(plan.model))),
                ("max_tokens", plan.max_tokens.map(|tokens| json!(tokens))),
                ("extra", (!plan.extra.is_empty()).then(|| json!(plan.extra))),
                ("replay", self.is_replay.then_some(json!(true))),
                // Servers of other versions may word prompts differently.
                ("prompt_revision", Some(json!(swarmbench_prompt::REVISION))),
            ],
            Who::Player(PlayerPlan { seed, by_task, .. }) => {
                let by_task: BTreeMap<_, _> =
                    by_task.iter().map(|(task, name)| (task.name(), name)).collect();
                vec![("players", Some(json!(by_task))), ("player_seed", Some(json!(seed)))]
            }
        };
        fields.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect()
    }

    /// The identity: the first 16 hexadecimal digits of the SHA-256 of the player, the games and their settings. The
    /// endpoint's address, interface and headers, the number of concurrent requests and the budget are no part of it.
    #[must_use]
    pub fn identity(&self) -> String {
        let mut text =
            json!([FORMAT, self.name(), self.suite, self.sampling(), self.template, self.meta()]);
        if let (Some(system), Value::Array(parts)) = (self.system(), &mut text) {
            parts.push(system.json());
        }
        data_encoding::HEXLOWER.encode(&Sha256::digest(text.to_string())[..8])
    }

    /// The request that creates the run with `parallel` open games.
    #[must_use]
    pub fn request(&self, parallel: u32) -> RunRequest {
        let Suite { name, tasks, seeds, rules, settings, .. } = &self.suite;
        let suite = if Suite::BUILT_IN.contains(&name.as_str()) {
            SuiteRequest::Named(name.clone())
        } else {
            SuiteRequest::Own(Box::new(OwnSuite {
                name: name.clone(),
                tasks: Some(tasks.clone()),
                seeds: seeds.iter().map(|&seed| seed.into()).collect(),
                settings: Some(OwnSettings::from(&Settings::from(settings))),
            }))
        };
        let [temperature, top_p] = self.sampling();
        let system = self.system().map(|system| (SYSTEM_MESSAGE.to_owned(), system.json()));
        let mut eval = self.meta();
        eval.insert("identity".to_owned(), json!(self.identity()));
        RunRequest {
            suite: Some(suite),
            rules: Some(rules.clone()),
            model: Some(self.name()),
            temperature,
            top_p,
            agent_meta: Some(Carried::from(
                [(META.to_owned(), Value::Object(eval))]
                    .into_iter()
                    .chain(system)
                    .collect::<Map<_, _>>(),
            )),
            prompt_template: self.template.clone(),
            parallel: Some(parallel),
            idle_timeout_s: Some(IDLE_TIMEOUT_S),
            ..RunRequest::default()
        }
    }

    /// The number of games.
    #[must_use]
    pub fn games(&self) -> usize {
        let seeds = self.entry.as_ref().map_or(self.suite.seeds.len(), |entry| entry.seeds());
        self.suite.tasks.len() * seeds
    }

    /// The seeds in short, or the number of sealed ones.
    #[must_use]
    pub fn seeds(&self) -> String {
        match &self.entry {
            Some(entry) => format!("{} sealed", entry.seeds()),
            None => ranges(&self.suite.seeds),
        }
    }

    /// The maximum number of rounds of all games.
    #[must_use]
    pub fn rounds_max(&self) -> u64 {
        self.games() as u64 * u64::try_from(self.suite.settings.max_round).unwrap_or(0)
    }

    /// The maximum number of acts; a model is asked once for each.
    #[must_use]
    pub fn acts_max(&self) -> u64 {
        self.rounds_max() * u64::try_from(self.suite.settings.num_agents).unwrap_or(0)
    }

    /// The name of a game on cassettes, the same whenever and wherever it is played.
    #[must_use]
    pub fn game_name(&self, task: &str, seed: Seed) -> String {
        let Suite { rules, settings, .. } = &self.suite;
        let template = self.template.as_deref().map(digest_of_template);
        let text = json!([rules, settings, template]).to_string();
        let digest = data_encoding::HEXLOWER.encode(&Sha256::digest(text)[..6]);
        format!("{task}/{seed}/{digest}")
    }
}
