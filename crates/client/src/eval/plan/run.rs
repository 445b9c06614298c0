//! A run of a plan: its player, its games, its identity, and the request that creates it.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};
use swarmbench_boards::run::{SYSTEM_MESSAGE, sampling};
use swarmbench_engine::{Seed, Settings, TaskName};
use swarmbench_players::{BuiltIn, find};
use swarmbench_prompt::Identity;
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::run::{HolderRequest, OwnSettings, OwnSuite, RunRequest, SuiteRequest};
use swarmbench_protocol::suite::{Suite, digest_of_template};

use super::super::experiment::Price;
use super::settings::{setting_text, value};
use super::suite::ranges;
use super::teams::{MemberPlan, MemberPlayer, TeamPlan};
use crate::eval::entry::Entry;
use crate::eval::harness::HarnessPlan;
use crate::eval::system::SystemMessage;
use crate::llm::{Api, Sampling};

/// The field of `agent_meta` with the identity of a run.
pub const META: &str = swarmbench_boards::run::EVALUATION;

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
    /// The sampling parameters.
    pub sampling: Sampling,
    /// True if streams are asked for, which is no part of the identity.
    pub stream: bool,
    /// Further fields of each request.
    pub extra: Map<String, Value>,
    /// The system message.
    pub system: Option<SystemMessage>,
    /// The harness beside the system message.
    pub harness: HarnessPlan,
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
    /// Several players, each on its own seats.
    Team(TeamPlan),
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
            Who::Team(team) => team.name.clone(),
        }
    }

    /// The language models that play, each with the number of its seats.
    #[must_use]
    pub fn models(&self) -> Vec<(&ModelPlan, usize)> {
        match &self.who {
            Who::Model(model) => {
                let agents = usize::try_from(self.suite.settings.num_agents).unwrap_or(0);
                vec![(model, agents)]
            }
            Who::Player(_) => Vec::new(),
            Who::Team(team) => {
                team.models().map(|(member, model)| (model, member.seats.len())).collect()
            }
        }
    }

    /// The same games, with `model` on all seats: what its questions are made of.
    pub(in crate::eval) fn of_model(&self, model: &ModelPlan) -> Self {
        Self { who: Who::Model(Box::new(model.clone())), ..self.clone() }
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

    /// The temperature and `top_p` that all models share; none for built-in players.
    pub(in crate::eval) fn sampling(&self) -> [Option<f64>; 2] {
        let models = self.models();
        let shared = |of: fn(&ModelPlan) -> Option<f64>| {
            let (first, _) = models.first()?;
            of(first).filter(|_| models.iter().all(|(model, _)| of(model) == of(first)))
        };
        [shared(|model| model.sampling.temperature), shared(|model| model.sampling.top_p)]
    }

    /// The system message of a model.
    fn system(&self) -> Option<&SystemMessage> {
        match &self.who {
            Who::Model(model) => model.system.as_ref(),
            Who::Player(_) | Who::Team(_) => None,
        }
    }

    /// The identity of a model's prompt.
    #[must_use]
    pub fn prompt(&self) -> Identity {
        let system = self.system().map(|system| system.json().to_string());
        let own =
            Identity::of(self.template.as_deref(), swarmbench_prompt::REVISION, system.as_deref());
        let own = match &self.entry {
            Some(entry) => entry.prompt(own.system),
            None => own,
        };
        own.with_harness(Some(&json!(self.meta()).to_string()))
    }

    /// The name of the prompt, as boards show it; `None` for built-in players.
    #[must_use]
    pub fn prompts(&self) -> Option<String> {
        let has_models = !self.models().is_empty();
        has_models.then(|| self.of_each(|run| Some(run.prompt().to_string())))?
    }

    /// A description of the model; of a team the one that all its models share, or else each with the name of its member.
    fn of_each(&self, tell: impl Fn(&Self) -> Option<String>) -> Option<String> {
        let Who::Team(team) = &self.who else { return tell(self) };
        let models = team.models();
        let told: Vec<_> =
            models.map(|(member, model)| (&member.name, tell(&self.of_model(model)))).collect();
        let (_, first) = told.first()?;
        if told.iter().all(|(_, text)| text == first) {
            return first.clone();
        }
        let named =
            told.iter().filter_map(|(name, text)| Some(format!("{name}: {}", text.as_ref()?)));
        Some(named.collect::<Vec<_>>().join("; "))
    }

    /// The part of the identity beside suite, sampling and template, for `agent_meta`.
    fn meta(&self) -> Map<String, Value> {
        let mut meta = match &self.who {
            Who::Model(plan) => {
                let mut meta = json!(plan.sampling);
                meta["model"] = json!((plan.model != plan.name).then_some(&plan.model));
                meta["extra"] = json!((!plan.extra.is_empty()).then_some(&plan.extra));
                meta["harness"] = json!(plan.harness.meta(&self.suite.settings.answer_reader));
                meta
            }
            Who::Player(PlayerPlan { seed, by_task, .. }) => {
                let by_task: BTreeMap<_, _> =
                    by_task.iter().map(|(task, name)| (task.name(), name)).collect();
                json!({ "players": by_task, "player_seed": seed })
            }
            Who::Team(_) => json!({}),
        };
        meta["replay"] = json!(self.is_replay.then_some(true));
        // Servers of other versions may word prompts differently.
        let has_models = !self.models().is_empty();
        meta["prompt_revision"] = json!(has_models.then_some(swarmbench_prompt::REVISION));
        let Value::Object(mut meta) = meta else { return Map::new() };
        meta.retain(|_, value| !value.is_null());
        meta
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
        if let (Who::Team(_), Value::Array(parts)) = (&self.who, &mut text) {
            parts.push(json!(self.holders()));
        }
        data_encoding::HEXLOWER.encode(&Sha256::digest(text.to_string())[..8])
    }

    /// The holders of a team; `None` for other players.
    fn holders(&self) -> Option<Vec<HolderRequest>> {
        let Who::Team(team) = &self.who else { return None };
        let holder = |member: &MemberPlan| {
            let seats = member.seats.iter().map(|&seat| seat.into()).collect();
            let named = HolderRequest {
                name: Some(member.name.clone()),
                seats,
                ..HolderRequest::default()
            };
            match &member.player {
                MemberPlayer::BuiltIn(player) => {
                    HolderRequest { player: Some(player.clone()), ..named }
                }
                MemberPlayer::Model(model) => {
                    let alone = self.of_model(model);
                    HolderRequest {
                        model: Some(model.name.clone()),
                        temperature: model.sampling.temperature,
                        top_p: model.sampling.top_p,
                        agent_meta: Some(alone.agent_meta(alone.meta())),
                        ..named
                    }
                }
            }
        };
        Some(team.members.iter().map(holder).collect())
    }

    /// Declaration of a player: its evaluation, and its system message.
    fn agent_meta(&self, eval: Map<String, Value>) -> Carried {
        let system = self.system().map(|system| (SYSTEM_MESSAGE.to_owned(), system.json()));
        let eval = (META.to_owned(), Value::Object(eval));
        Carried::from([eval].into_iter().chain(system).collect::<Map<_, _>>())
    }

    /// The sampling of a model beside temperature and `top_p`, as boards show it. Those of a team's models are with it where they
    /// differ, as the team has none then.
    #[must_use]
    pub fn further_sampling(&self) -> Option<String> {
        let shared = self.sampling();
        self.of_each(|run| {
            let mut meta = run.meta();
            for ((name, own), shared) in
                ["temperature", "top_p"].into_iter().zip(run.sampling()).zip(shared)
            {
                if let Some(own) = own.filter(|_| shared.is_none()) {
                    meta.insert(name.to_owned(), json!(own));
                }
            }
            sampling(&meta)
        })
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
        let holders = self.holders();
        let [temperature, top_p] = if holders.is_some() { [None; 2] } else { self.sampling() };
        let mut eval = self.meta();
        eval.insert("identity".to_owned(), json!(self.identity()));
        RunRequest {
            suite: Some(suite),
            rules: Some(rules.clone()),
            model: Some(self.name()),
            temperature,
            top_p,
            agent_meta: Some(self.agent_meta(eval)),
            holders,
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

    /// The maximum number of acts of `seats` seats; a model is asked once for each.
    #[must_use]
    pub fn acts_max(&self, seats: usize) -> u64 {
        self.rounds_max() * seats as u64
    }

    /// The name of a game on cassettes, the same whenever and wherever it is played.
    #[must_use]
    pub fn game_name(&self, task: &str, seed: Seed) -> String {
        let Suite { rules, settings, .. } = &self.suite;
        let template = self.template.as_deref().map(digest_of_template);
        let mut text = json!([rules, settings, template]);
        if let (Who::Team(team), Value::Array(parts)) = (&self.who, &mut text) {
            // In another team the same prompt is another moment.
            let members = team.members.iter();
            parts.extend(members.map(|member| json!([member.shown(), member.name, member.seats])));
        }
        let text = text.to_string();
        let digest = data_encoding::HEXLOWER.encode(&Sha256::digest(text)[..6]);
        format!("{task}/{seed}/{digest}")
    }
}
