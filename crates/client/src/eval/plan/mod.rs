//! The runs of an experiment, in the order in which they are played.
//!
//! - `run`: a run, its identity and the request that creates it.
//! - `settings`: the combinations of settings.
//! - `suite`: suites and their names.
//! - `problems`: the faults of an experiment.
//! - `attempt`: the plan of an attempt in a competition.

mod attempt;
mod problems;
mod run;
mod settings;
mod suite;

use std::collections::BTreeSet;
use std::fmt;

use serde_json::Value;
use swarmbench_engine::{Settings, TaskName};
use swarmbench_protocol::suite::Suite;

use crate::llm::Api;

use super::experiment::{Experiment, List, ModelEntry, Shape};
use problems::Problems;
pub use run::{META, ModelPlan, Planned, PlayerPlan, Who};
pub(super) use settings::value;
pub use settings::{axes, setting_text};
use settings::{combinations, standard};
use suite::named;
pub use suite::ranges;

/// The name of all players or all tasks.
pub const ALL: &str = "all";

/// Maximum number of open games of a run.
pub const PARALLEL_MAX: u32 = 64;

/// Maximum number of concurrent requests to an endpoint or a model.
pub const REQUESTS_MAX: u32 = 4096;

/// Maximum number of models of one endpoint that play at the same time.
pub const MODELS_AT_ONCE_MAX: u32 = 16;

/// The faults of an experiment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlanError(pub Vec<String>);

impl fmt::Display for PlanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.join("\n       "))
    }
}

impl std::error::Error for PlanError {}

/// The runs of an experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The name of the experiment.
    pub name: String,
    /// The purpose of the experiment.
    pub description: Option<String>,
    /// The runs in order, without duplicates.
    pub runs: Vec<Planned>,
    /// The tasks of all runs.
    pub tasks: Vec<TaskName>,
    /// The settings that differ between runs.
    pub varied: Vec<&'static str>,
    /// The shape of the board.
    pub shape: Shape,
}

impl Plan {
    /// Builds the runs of an experiment, and checks everything that can be checked before the first game. `template`
    /// is the text of its prompt template.
    ///
    /// # Errors
    /// All problems; those of settings are worded as by the server.
    pub fn of(experiment: &Experiment, template: Option<&str>) -> Result<Self, PlanError> {
        let mut problems = Problems::default();
        let mut runs = all_runs(experiment, template, &mut problems);
        for run in &runs {
            problems.check(run);
        }
        problems.namesakes(&runs);
        problems.at_once(experiment);
        problems.numbers(experiment, &runs);
        let mut known = BTreeSet::new();
        runs.retain(|run| known.insert(run.identity()));
        problems.none()?;
        let tasks: BTreeSet<TaskName> = runs.iter().flat_map(Planned::tasks).collect();
        let is_varied =
            |axis: &&str| runs.iter().any(|run| run.setting(axis) != runs[0].setting(axis));
        Ok(Self {
            name: experiment.name.clone().unwrap_or_else(|| "evaluation".to_owned()),
            description: experiment.description.clone(),
            tasks: TaskName::ALL.into_iter().filter(|task| tasks.contains(task)).collect(),
            varied: axes().filter(is_varied).collect(),
            shape: experiment.board.unwrap_or_default(),
            runs,
        })
    }

    /// The same plan with a recording in place of all models. These runs have other identities: the models did not
    /// play them.
    #[must_use]
    pub fn replayed(mut self) -> Self {
        for run in &mut self.runs {
            run.is_replay = matches!(run.who, Who::Model(_));
        }
        self
    }

    /// The settings that all runs share and that differ from the standard setting, by name.
    #[must_use]
    pub fn shared(&self) -> Vec<(&'static str, Value)> {
        let Suite { rules, settings, .. } = standard();
        let usual = Settings::from(&settings);
        let shared = axes().filter(|axis| !self.varied.contains(axis));
        let values = shared.map(|axis| (axis, self.runs[0].value(axis)));
        values
            .filter(|(axis, own)| *own != value(axis, &rules, &usual, [None, None]))
            .filter_map(|(axis, own)| Some((axis, own?)))
            .collect()
    }
}

/// The runs of an experiment, duplicates included.
fn all_runs(
    experiment: &Experiment,
    template: Option<&str>,
    problems: &mut Problems,
) -> Vec<Planned> {
    let asked = problems.tasks(experiment.tasks.as_ref());
    let models = experiment.models.as_ref().map_or(&[][..], |List(models)| models);
    let players = problems.players(experiment, asked.as_deref());
    problems.nobody(models, &players);
    problems.system(experiment, models);
    let seeds = problems.seeds(experiment.seeds.as_ref());
    let combinations = combinations(experiment);
    // Without any valid task name, all tasks are used, so that the settings are checked all the same.
    let tasks = asked.filter(|tasks| !tasks.is_empty());
    let tasks = tasks.unwrap_or_else(|| TaskName::ALL.to_vec());
    let planned = |who, suite: &Suite, tasks: &[TaskName], template: Option<&str>| Planned {
        who,
        suite: named(suite.clone(), tasks, &seeds),
        template: template.map(str::to_owned),
        is_replay: false,
        entry: None,
    };
    let mut runs = Vec::new();
    for entry in models {
        for (suite, temperature, top_p) in &combinations {
            let who = Who::Model(Box::new(model(experiment, entry, &tasks, *temperature, *top_p)));
            runs.push(planned(who, suite, &tasks, template));
        }
    }
    for player in players {
        let tasks: Vec<TaskName> = player.by_task.keys().copied().collect();
        for (suite, ..) in &combinations {
            runs.push(planned(Who::Player(player.clone()), suite, &tasks, None));
        }
    }
    runs
}

fn model(
    experiment: &Experiment,
    entry: &ModelEntry,
    tasks: &[TaskName],
    temperature: Option<f64>,
    top_p: Option<f64>,
) -> ModelPlan {
    // The experiment's key and headers are for the experiment's address only.
    let shared_api = experiment.api.unwrap_or_default();
    let is_shared = entry.api_base.is_none() && entry.api.is_none_or(|api| api == shared_api);
    let shared_key = experiment.api_key_env.clone().filter(|_| is_shared);
    let shared_headers = experiment.headers.clone().filter(|_| is_shared);
    ModelPlan {
        name: entry.name.clone(),
        model: entry.model.clone().unwrap_or_else(|| entry.name.clone()),
        api_base: entry
            .api_base
            .clone()
            .or_else(|| experiment.api_base.clone().filter(|_| is_shared)),
        api_key_env: entry.api_key_env.clone().or(shared_key),
        api: entry.api.unwrap_or(if is_shared { shared_api } else { Api::default() }),
        headers: entry.headers.clone().or(shared_headers).unwrap_or_default(),
        requests: entry.requests,
        temperature: entry.temperature.or(temperature),
        top_p: entry.top_p.or(top_p),
        max_tokens: entry.max_tokens.or(experiment.max_tokens),
        price: entry.price.or(experiment.price),
        extra: entry.extra.clone().or_else(|| experiment.extra.clone()).unwrap_or_default(),
        system: (entry.system.as_ref().or(experiment.system.as_ref()))
            .and_then(|system| system.of_tasks(tasks)),
    }
}
