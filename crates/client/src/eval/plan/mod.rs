//! The runs of an experiment, in the order in which they are played.
//!
//! - `run`: a run, its identity and the request that creates it.
//! - `settings`: the combinations of settings.
//! - `suite`: suites and their names.
//! - `problems`: the faults of an experiment.
//! - `teams`: several players on the seats of one swarm.
//! - `attempt`: the plan of an attempt in a competition.

mod attempt;
mod problems;
mod run;
mod settings;
mod suite;
mod teams;

use std::collections::BTreeSet;
use std::fmt;

use serde_json::Value;
use swarmbench_engine::{Settings, TaskName};
use swarmbench_protocol::suite::Suite;

use crate::llm::{Price, Sampling};

use super::experiment::{Experiment, HarnessPlan, List, ModelEntry, Shape};
use problems::Problems;
pub use run::{META, ModelPlan, Planned, PlayerPlan, Who};
pub(super) use settings::value;
pub use settings::{axes, setting_text};
use settings::{combinations, standard};
use suite::named;
pub use suite::ranges;
use teams::{MEMBERS_MAX, Teams, models_of_teams};
pub use teams::{MemberPlan, MemberPlayer, TeamPlan};

/// The name of all players or all tasks.
pub const ALL: &str = "all";

/// Maximum number of open games of a run.
pub const PARALLEL_MAX: u32 = 64;

/// Maximum number of concurrent requests to an endpoint or a model.
pub const REQUESTS_MAX: u32 = 4096;

/// Maximum number of models of one endpoint that play at the same time.
pub const MODELS_AT_ONCE_MAX: u32 = 16;

/// Maximum bytes of further fields and system messages of all runs together.
const TEXTS_BYTES_MAX: u64 = 64 * 1024 * 1024;

/// Maximum number of runs of an experiment, duplicates included. Products of lists in a short file could be endless.
pub const RUNS_MAX: u64 = 4096;

/// Looks up the price of a model; an error says what is wrong with it.
pub type Prices<'a> = dyn Fn(&ModelPlan) -> Result<Option<Price>, String> + 'a;

/// No prices but those of the experiment.
///
/// # Errors
/// None.
pub const fn no_prices(_: &ModelPlan) -> Result<Option<Price>, String> {
    Ok(None)
}

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
    /// is the text of its prompt template, and `prices` has prices of models that have none of their own.
    ///
    /// # Errors
    /// All problems; those of settings are worded as by the server.
    pub fn of(
        experiment: &Experiment,
        template: Option<&str>,
        prices: &Prices<'_>,
    ) -> Result<Self, PlanError> {
        let mut problems = Problems::default();
        let mut runs = all_runs(experiment, template, prices, &mut problems);
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
            run.is_replay = !run.models().is_empty();
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
    prices: &Prices<'_>,
    problems: &mut Problems,
) -> Vec<Planned> {
    let asked = problems.tasks(experiment.tasks.as_ref());
    let models = experiment.models.as_ref().map_or(&[][..], |List(models)| models);
    let players = problems.players(experiment, asked.as_deref());
    problems.nobody(experiment, &players);
    problems.system(experiment, models);
    let seeds = problems.seeds(experiment.seeds.as_ref());
    let of_teams: BTreeSet<&str> = models_of_teams(experiment).into_iter().collect();
    let alone: Vec<_> =
        models.iter().filter(|entry| !of_teams.contains(entry.name.as_str())).collect();
    let each = (alone.len() + players.len()).max(1) as u64;
    let Some(combinations) = combinations(experiment, RUNS_MAX / each) else {
        problems.too_many("`models`, `players` and the combinations of `settings`");
        return Vec::new();
    };
    if !problems.texts(experiment, each * combinations.len() as u64) {
        return Vec::new();
    }
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
    let asked = |sampling| Asked { experiment, tasks: &tasks, sampling, prices };
    for entry in alone {
        for (suite, temperature, top_p) in &combinations {
            let model = asked([*temperature, *top_p]).model(entry, problems);
            let who = Who::Model(Box::new(model));
            let suite = answered(suite, &entry.harness.over(&experiment.harness));
            runs.push(planned(who, &suite, &tasks, template));
        }
    }
    for player in players {
        let tasks: Vec<TaskName> = player.by_task.keys().copied().collect();
        for (suite, ..) in &combinations {
            runs.push(planned(Who::Player(player.clone()), suite, &tasks, None));
        }
    }
    let mut count = runs.len() as u64;
    for (suite, temperature, top_p) in &combinations {
        let Some(agents) = problems.agents(suite.settings.num_agents) else { continue };
        let asked = asked([*temperature, *top_p]);
        let suite = &answered(suite, &experiment.harness);
        let teams = Teams { asked, agents };
        count += teams.count();
        if count > RUNS_MAX {
            problems.too_many("`teams` and the combinations of `settings`");
            break;
        }
        let members = u64::from(agents).min(MEMBERS_MAX as u64);
        if !problems.texts(experiment, count.saturating_mul(members)) {
            break;
        }
        for team in teams.all(problems) {
            runs.push(planned(Who::Team(team), suite, &tasks, template));
        }
    }
    runs
}

/// The suite with the reader of answers of this shape.
fn answered(suite: &Suite, harness: &HarnessPlan) -> Suite {
    let mut suite = suite.clone();
    if let Some(reader) = harness.reader(&suite.settings.answer_reader) {
        suite.settings.answer_reader = reader;
    }
    suite
}

/// Settings of the requests to models in one combination.
struct Asked<'e> {
    experiment: &'e Experiment,
    tasks: &'e [TaskName],
    /// The temperature and `top_p` of the combination.
    sampling: [Option<f64>; 2],
    prices: &'e Prices<'e>,
}

impl Asked<'_> {
    fn model(&self, entry: &ModelEntry, problems: &mut Problems) -> ModelPlan {
        let [temperature, top_p] = self.sampling;
        let shared_api = self.experiment.api.unwrap_or_default();
        let mut entry = entry.clone();
        let ModelEntry { api_base, api, api_key_env, headers, .. } = entry.clone();
        entry.fill(self.experiment);
        if api_base.is_some() || api.is_some_and(|api| api != shared_api) {
            // The experiment's key and headers are for the experiment's address only.
            (entry.api_base, entry.api, entry.api_key_env, entry.headers) =
                (api_base, api, api_key_env, headers);
        }
        let mut plan = ModelPlan {
            model: entry.model.unwrap_or_else(|| entry.name.clone()),
            name: entry.name,
            api_base: entry.api_base,
            api_key_env: entry.api_key_env,
            api: entry.api.unwrap_or_default(),
            headers: entry.headers.unwrap_or_default(),
            requests: entry.requests,
            sampling: Sampling {
                temperature: entry.temperature.or(temperature),
                top_p: entry.top_p.or(top_p),
                max_tokens: entry.max_tokens,
                max_completion_tokens: entry.max_completion_tokens,
                effort: entry.effort,
                thinking_budget: entry.thinking_budget,
                reasoning_summary: entry.reasoning_summary,
                seed: None,
            },
            stream: entry.stream.unwrap_or_default(),
            price: entry.price,
            extra: entry.extra.unwrap_or_default(),
            system: entry.system.and_then(|system| system.of_tasks(self.tasks)),
            harness: entry.harness,
        };
        if plan.price.is_none() {
            plan.price = (self.prices)(&plan).unwrap_or_else(|wrong| {
                problems.add(wrong);
                None
            });
        }
        plan
    }
}
