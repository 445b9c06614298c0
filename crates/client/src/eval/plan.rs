//! An experiment worked out: the runs that it takes, in the order in which they are played, each with what tells it from
//! all others.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};
use swarmbench_engine::{Config, TaskName};
use swarmbench_players::{BuiltIn, DEFAULT_PLAYER, all, default_for, find};

use super::experiment::{Axes, Experiment, List, MapSize, ModelEntry, Seeds, Shape};
use swarmbench_protocol::run::{OwnSettings, OwnSuite, RunRequest, SuiteRequest};
use swarmbench_protocol::suite::digest_of_template;
use swarmbench_protocol::suite::{Suite, SuiteSettings};

/// The field of `agent_meta` with the identity of a run.
pub const META: &str = "eval";

/// As a player's name: all of them.
pub const ALL: &str = "all";

/// What is changed when the same words come to mean another run.
const FORMAT: u32 = 1;

/// How long a run waits to be gone on with, in seconds: 90 days. By default a game is given up after a day without
/// an act, and requests wait longer for a budget.
const IDLE_TIMEOUT_S: f64 = 90.0 * 86_400.0;

/// Characters of a model's name on boards; a server takes no more. Found out by the last of several models it would be late.
const MODEL_CHARS_MAX: usize = 200;

/// Characters of a suite's name.
const SUITE_NAME_CHARS_MAX: usize = 100;

/// Everything that is wrong with an experiment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlanError(pub Vec<String>);

impl fmt::Display for PlanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.join("\n       "))
    }
}

impl std::error::Error for PlanError {}

/// A language model and how it is asked.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelPlan {
    /// The name on boards.
    pub name: String,
    /// What its endpoint calls it.
    pub model: String,
    /// Where it is; none where nobody said it.
    pub api_base: Option<String>,
    /// The environment variable with its key, where one was named.
    pub api_key_env: Option<String>,
    /// How freely it draws.
    pub temperature: Option<f64>,
    /// From which share of the likeliest tokens.
    pub top_p: Option<f64>,
    /// How many tokens an answer may have.
    pub max_tokens: Option<u64>,
    /// What else is sent with each question.
    pub extra: Map<String, Value>,
}

/// Built-in players.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlayerPlan {
    /// As it was named: a player's name, or `default` for each task's own.
    pub name: String,
    /// The seed of its own choices.
    pub seed: u64,
    /// Who plays which task.
    pub by_task: BTreeMap<TaskName, &'static str>,
}

impl PlayerPlan {
    /// Who plays which task.
    #[must_use]
    pub fn players(&self) -> BTreeMap<TaskName, &'static BuiltIn> {
        let known =
            self.by_task.iter().filter_map(|(&task, name)| Some((task, find(name, task).ok()?)));
        known.collect()
    }
}

/// Who plays a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Who {
    /// A language model.
    Model(ModelPlan),
    /// Built-in players.
    Player(PlayerPlan),
}

/// A run that an experiment takes.
#[derive(Clone, Debug, PartialEq)]
pub struct Planned {
    /// Who plays.
    pub who: Who,
    /// What is played.
    pub suite: Suite,
    /// A prompt template of its own, for models.
    pub template: Option<String>,
    /// Whether a recording answers in the model's place.
    pub is_replay: bool,
}

/// The names of all settings that can be varied, in the order in which they multiply.
pub const AXES: [&str; 11] = [
    "rules",
    "control",
    "map_size",
    "num_agents",
    "view_size",
    "memory",
    "max_round",
    "noise",
    "max_delay",
    "temperature",
    "top_p",
];

impl Planned {
    /// The player, as boards name it.
    #[must_use]
    pub fn name(&self) -> String {
        match &self.who {
            Who::Model(model) => model.name.clone(),
            Who::Player(player) => format!("built-in/{}", player.name),
        }
    }

    /// The tasks that it plays.
    pub fn tasks(&self) -> impl Iterator<Item = TaskName> + '_ {
        self.suite.tasks.iter().filter_map(|task| TaskName::parse(task))
    }

    /// The value of one of [`AXES`]; none where it has none.
    #[must_use]
    pub fn setting(&self, axis: &str) -> Option<String> {
        let Suite { rules, settings, .. } = &self.suite;
        let (temperature, top_p) = match &self.who {
            Who::Model(model) => (model.temperature, model.top_p),
            Who::Player(_) => (None, None),
        };
        match axis {
            "rules" => Some(rules.clone()),
            "control" => Some(settings.control.clone()),
            "map_size" => {
                Some(MapSize { width: settings.width, height: settings.height }.to_string())
            }
            "num_agents" => Some(settings.num_agents.to_string()),
            "view_size" => Some(settings.view_size.to_string()),
            "memory" => Some(settings.memory.to_string()),
            "max_round" => Some(settings.max_round.to_string()),
            "noise" => Some(settings.noise.to_string()),
            "max_delay" => Some(settings.max_delay.to_string()),
            "temperature" => temperature.map(|value| value.to_string()),
            "top_p" => top_p.map(|value| value.to_string()),
            _ => None,
        }
    }

    /// What tells this run from all others, beside its suite, sampling and template: for `agent_meta`.
    fn meta(&self) -> Map<String, Value> {
        let mut meta = Map::new();
        match &self.who {
            Who::Model(ModelPlan { name, model, max_tokens, extra, .. }) => {
                if model != name {
                    meta.insert("model".to_owned(), json!(model));
                }
                if let Some(max_tokens) = max_tokens {
                    meta.insert("max_tokens".to_owned(), json!(max_tokens));
                }
                if !extra.is_empty() {
                    meta.insert("extra".to_owned(), json!(extra));
                }
                if self.is_replay {
                    meta.insert("replay".to_owned(), json!(true));
                }
            }
            Who::Player(PlayerPlan { seed, by_task, .. }) => {
                let by_task: BTreeMap<_, _> =
                    by_task.iter().map(|(task, name)| (task.name(), name)).collect();
                meta.insert("players".to_owned(), json!(by_task));
                meta.insert("player_seed".to_owned(), json!(seed));
            }
        }
        meta
    }

    /// Tells this run from all others: the first 16 hexadecimal digits of SHA-256 of who plays what, and how. Where the
    /// endpoint is, how much is done at once and what may be spent are not in it.
    #[must_use]
    pub fn identity(&self) -> String {
        let sampling = match &self.who {
            Who::Model(model) => (model.temperature, model.top_p),
            Who::Player(_) => (None, None),
        };
        let text = json!([FORMAT, self.name(), self.suite, sampling, self.template, self.meta()]);
        data_encoding::HEXLOWER.encode(&Sha256::digest(text.to_string())[..8])
    }

    /// The request that creates the run, with this many games open at a time.
    #[must_use]
    pub fn request(&self, parallel: u32) -> RunRequest {
        let Suite { name, tasks, seeds, rules, settings } = &self.suite;
        let suite = if Suite::BUILT_IN.contains(&name.as_str()) {
            SuiteRequest::Named(name.clone())
        } else {
            let seed = |&seed: &u64| i64::try_from(seed).unwrap_or(i64::MAX);
            SuiteRequest::Own(Box::new(OwnSuite {
                name: name.clone(),
                tasks: Some(tasks.clone()),
                seeds: seeds.iter().map(seed).collect(),
                settings: Some(OwnSettings {
                    control: Some(settings.control.clone()),
                    num_agents: Some(settings.num_agents),
                    width: Some(settings.width),
                    height: Some(settings.height),
                    view_size: Some(settings.view_size),
                    memory: Some(settings.memory),
                    max_round: Some(settings.max_round),
                    noise: Some(settings.noise),
                    max_delay: Some(settings.max_delay),
                }),
            }))
        };
        let (temperature, top_p) = match &self.who {
            Who::Model(model) => (model.temperature, model.top_p),
            Who::Player(_) => (None, None),
        };
        let mut eval = self.meta();
        eval.insert("identity".to_owned(), json!(self.identity()));
        let mut meta = Map::new();
        meta.insert(META.to_owned(), Value::Object(eval));
        RunRequest {
            suite: Some(suite),
            rules: Some(rules.clone()),
            model: Some(self.name()),
            temperature,
            top_p,
            agent_meta: Some(meta),
            prompt_template: self.template.clone(),
            parallel: Some(parallel),
            idle_timeout_s: Some(IDLE_TIMEOUT_S),
            ..RunRequest::default()
        }
    }

    /// How many rounds its games have at most.
    #[must_use]
    pub fn rounds_max(&self) -> u64 {
        let games = self.suite.tasks.len() * self.suite.seeds.len();
        games as u64 * u64::try_from(self.suite.settings.max_round).unwrap_or(0)
    }

    /// How many acts it takes at most; a model is asked once for each.
    #[must_use]
    pub fn acts_max(&self) -> u64 {
        self.rounds_max() * u64::try_from(self.suite.settings.num_agents).unwrap_or(0)
    }

    /// The name of a game for cassettes: the same whenever and wherever it is played.
    #[must_use]
    pub fn game_name(&self, task: &str, seed: u64) -> String {
        let Suite { rules, settings, .. } = &self.suite;
        let template = self.template.as_deref().map(digest_of_template);
        let text = json!([rules, settings, template]).to_string();
        let digest = data_encoding::HEXLOWER.encode(&Sha256::digest(text)[..6]);
        format!("{task}/{seed}/{digest}")
    }
}

/// What an experiment comes down to.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// What it is called.
    pub name: String,
    /// What it is for.
    pub description: Option<String>,
    /// Its runs, in order; no two are the same.
    pub runs: Vec<Planned>,
    /// The tasks of all of them.
    pub tasks: Vec<TaskName>,
    /// The settings that are not the same in all of them.
    pub varied: Vec<&'static str>,
    /// The shape of its board.
    pub shape: Shape,
}

impl Plan {
    /// Works an experiment out, and checks everything that can be checked before anything is played. `template` is the
    /// text of its prompt template.
    ///
    /// # Errors
    /// All that is wrong, settings in the same words as the server's.
    pub fn of(experiment: &Experiment, template: Option<&str>) -> Result<Self, PlanError> {
        let mut problems = Problems::default();
        let asked = problems.tasks(experiment.tasks.as_ref());
        let seeds = seeds(experiment.seeds.as_ref());
        let models = experiment.models.as_ref().map_or(&[][..], |List(models)| models);
        let players = problems.players(experiment, asked.as_deref());
        if models.is_empty() && players.is_empty() && problems.0.is_empty() {
            problems.tell(
                "nobody plays: name language models with --model, or built-in players with --player, or a file \
                 that has `models` or `players`"
                    .to_owned(),
            );
        }
        let settings = combinations(experiment);
        // Where none of the names is a task, the settings are checked all the same.
        let all_tasks = asked.filter(|tasks| !tasks.is_empty());
        let all_tasks = all_tasks.unwrap_or_else(|| TaskName::ALL.to_vec());
        let mut runs = Vec::new();
        for entry in models {
            for (suite, temperature, top_p) in &settings {
                runs.push(Planned {
                    who: Who::Model(model(experiment, entry, *temperature, *top_p)),
                    suite: named(suite.clone(), &all_tasks, &seeds),
                    template: template.map(str::to_owned),
                    is_replay: false,
                });
            }
        }
        for player in players {
            let tasks: Vec<TaskName> = player.by_task.keys().copied().collect();
            for (suite, ..) in &settings {
                runs.push(Planned {
                    who: Who::Player(player.clone()),
                    suite: named(suite.clone(), &tasks, &seeds),
                    template: None,
                    is_replay: false,
                });
            }
        }
        for run in &runs {
            problems.check(run);
        }
        problems.namesakes(&runs);
        let mut known = BTreeSet::new();
        runs.retain(|run| known.insert(run.identity()));
        if !problems.0.is_empty() {
            return Err(PlanError(problems.0));
        }
        let tasks: BTreeSet<TaskName> = runs.iter().flat_map(Planned::tasks).collect();
        let is_varied =
            |axis: &&str| runs.iter().any(|run| run.setting(axis) != runs[0].setting(axis));
        Ok(Self {
            name: experiment.name.clone().unwrap_or_else(|| "evaluation".to_owned()),
            description: experiment.description.clone(),
            tasks: TaskName::ALL.into_iter().filter(|task| tasks.contains(task)).collect(),
            varied: AXES.into_iter().filter(is_varied).collect(),
            shape: experiment.board.unwrap_or_default(),
            runs,
        })
    }

    /// The same with a recording in place of all models: that is not what the models played, so these are other runs.
    #[must_use]
    pub fn replayed(mut self) -> Self {
        for run in &mut self.runs {
            run.is_replay = matches!(run.who, Who::Model(_));
        }
        self
    }

    /// The settings that all runs share and that are not those of the standard setting, by name.
    #[must_use]
    pub fn shared(&self) -> Vec<(&'static str, String)> {
        let usual = Planned {
            who: Who::Player(PlayerPlan { name: String::new(), seed: 0, by_task: BTreeMap::new() }),
            suite: standard(),
            template: None,
            is_replay: false,
        };
        let run = &self.runs[0];
        let shared = AXES.into_iter().filter(|axis| !self.varied.contains(axis));
        let told = shared.filter(|axis| run.setting(axis) != usual.setting(axis));
        told.filter_map(|axis| Some((axis, run.setting(axis)?))).collect()
    }
}

fn standard() -> Suite {
    Suite::built_in("standard", "paper").expect("it is built in")
}

fn model(
    experiment: &Experiment,
    entry: &ModelEntry,
    temperature: Option<f64>,
    top_p: Option<f64>,
) -> ModelPlan {
    let named_key = entry.api_base.is_none().then(|| experiment.api_key_env.clone()).flatten();
    ModelPlan {
        name: entry.name.clone(),
        model: entry.model.clone().unwrap_or_else(|| entry.name.clone()),
        api_base: entry.api_base.clone().or_else(|| experiment.api_base.clone()),
        // A key is for the place for which it was named.
        api_key_env: entry.api_key_env.clone().or(named_key),
        temperature: entry.temperature.or(temperature),
        top_p: entry.top_p.or(top_p),
        max_tokens: entry.max_tokens.or(experiment.max_tokens),
        extra: entry.extra.clone().or_else(|| experiment.extra.clone()).unwrap_or_default(),
    }
}

/// All seeds, each once, in order.
fn seeds(asked: Option<&List<Seeds>>) -> Vec<u64> {
    match asked {
        None => standard().seeds,
        Some(List(ranges)) => {
            let all: BTreeSet<u64> =
                ranges.iter().flat_map(|range| range.from..=range.last).collect();
            all.into_iter().collect()
        }
    }
}

/// All combinations of settings: a suite without tasks, seeds and name, and how models draw.
fn combinations(experiment: &Experiment) -> Vec<(Suite, Option<f64>, Option<f64>)> {
    let groups = match experiment.vary.as_slice() {
        [] => vec![experiment.settings.clone()],
        groups => groups.iter().map(|group| group.clone().over(&experiment.settings)).collect(),
    };
    groups.iter().flat_map(multiply).collect()
}

/// The combinations of one group.
fn multiply(axes: &Axes) -> Vec<(Suite, Option<f64>, Option<f64>)> {
    type Combination = (Suite, Option<f64>, Option<f64>);
    fn by<T: Clone>(
        all: Vec<Combination>,
        values: Option<&List<T>>,
        set: impl Fn(&mut Combination, T),
    ) -> Vec<Combination> {
        let Some(List(values)) = values else { return all };
        let with = |base: &Combination, value: &T| {
            let mut one = base.clone();
            set(&mut one, value.clone());
            one
        };
        all.iter().flat_map(|base| values.iter().map(move |value| with(base, value))).collect()
    }
    let all = vec![(standard(), None, None)];
    let all = by(all, axes.rules.as_ref(), |one, value| one.0.rules = value);
    let all = by(all, axes.control.as_ref(), |one, value| one.0.settings.control = value);
    let all = by(all, axes.map_size.as_ref(), |one, MapSize { width, height }| {
        one.0.settings.width = width;
        one.0.settings.height = height;
    });
    let all = by(all, axes.num_agents.as_ref(), |one, value| one.0.settings.num_agents = value);
    let all = by(all, axes.view_size.as_ref(), |one, value| one.0.settings.view_size = value);
    let all = by(all, axes.memory.as_ref(), |one, value| one.0.settings.memory = value);
    let all = by(all, axes.max_round.as_ref(), |one, value| one.0.settings.max_round = value);
    let all = by(all, axes.noise.as_ref(), |one, value| one.0.settings.noise = value);
    let all = by(all, axes.max_delay.as_ref(), |one, value| one.0.settings.max_delay = value);
    let all = by(all, axes.temperature.as_ref(), |one, value| one.1 = Some(value));
    by(all, axes.top_p.as_ref(), |one, value| one.2 = Some(value))
}

/// The suite of these tasks and seeds, under a name that follows from what it is: runs of the same suite are on the same
/// board. A built-in one has its own name.
fn named(mut suite: Suite, tasks: &[TaskName], seeds: &[u64]) -> Suite {
    suite.tasks = tasks.iter().map(|task| task.name().to_owned()).collect();
    suite.seeds = seeds.to_vec();
    for built_in in Suite::BUILT_IN {
        built_in.clone_into(&mut suite.name);
        if Suite::built_in(built_in, &suite.rules).as_ref() == Some(&suite) {
            return suite;
        }
    }
    let mut parts = Vec::new();
    let usual = standard();
    if tasks.len() < TaskName::ALL.len() {
        parts.push(suite.tasks.join(" + "));
    } else {
        parts.push("all tasks".to_owned());
    }
    if suite.seeds != usual.seeds {
        parts.push(format!("seeds {}", ranges(seeds)));
    }
    let (is, was) = (settings(&suite.settings), settings(&usual.settings));
    for ((name, value), (_, usual)) in is.iter().zip(&was) {
        if value != usual {
            parts.push(format!("{name} {value}"));
        }
    }
    let name = parts.join(", ");
    suite.name = if name.chars().count() > SUITE_NAME_CHARS_MAX {
        name.chars().take(SUITE_NAME_CHARS_MAX - 1).chain(['…']).collect()
    } else {
        name
    };
    suite
}

fn settings(settings: &SuiteSettings) -> [(&'static str, String); 9] {
    [
        ("control", settings.control.clone()),
        ("width", settings.width.to_string()),
        ("height", settings.height.to_string()),
        ("num_agents", settings.num_agents.to_string()),
        ("view_size", settings.view_size.to_string()),
        ("memory", settings.memory.to_string()),
        ("max_round", settings.max_round.to_string()),
        ("noise", settings.noise.to_string()),
        ("max_delay", settings.max_delay.to_string()),
    ]
}

/// Seeds in short: what follows one another as a range.
#[must_use]
pub fn ranges(seeds: &[u64]) -> String {
    let mut parts: Vec<(u64, u64)> = Vec::new();
    for &seed in seeds {
        match parts.last_mut() {
            Some((_, last)) if last.checked_add(1) == Some(seed) => *last = seed,
            _ => parts.push((seed, seed)),
        }
    }
    let told = parts.iter().map(|&(from, last)| match last - from {
        0 => from.to_string(),
        1 => format!("{from}, {last}"),
        _ => format!("{from}..{}", last.saturating_add(1)),
    });
    told.collect::<Vec<_>>().join(", ")
}

/// What is wrong, each thing once.
#[derive(Default)]
struct Problems(Vec<String>);

impl Problems {
    fn tell(&mut self, problem: String) {
        if !self.0.contains(&problem) {
            self.0.push(problem);
        }
    }

    /// The tasks in their usual order; none where nobody named any.
    fn tasks(&mut self, asked: Option<&List<String>>) -> Option<Vec<TaskName>> {
        let List(names) = asked?;
        let mut tasks = BTreeSet::new();
        for name in names {
            let known =
                TaskName::ALL.into_iter().find(|task| task.name().eq_ignore_ascii_case(name));
            match known {
                Some(task) => drop(tasks.insert(task)),
                None if name.eq_ignore_ascii_case(ALL) => tasks.extend(TaskName::ALL),
                None => {
                    let known = TaskName::ALL.map(TaskName::name).join(", ");
                    self.tell(format!("there is no task {name:?}; the tasks are {known}, or all"));
                }
            }
        }
        Some(TaskName::ALL.into_iter().filter(|task| tasks.contains(task)).collect())
    }

    /// The players, each once. A named one has to play every requested task; of `all`, each plays what it
    /// knows.
    fn players(&mut self, experiment: &Experiment, asked: Option<&[TaskName]>) -> Vec<PlayerPlan> {
        let seed = experiment.player_seed.unwrap_or(1);
        let mut found: Vec<PlayerPlan> = Vec::new();
        let mut add = |name: &str, by_task: BTreeMap<TaskName, &'static str>| {
            if !by_task.is_empty() && found.iter().all(|known| known.name != name) {
                found.push(PlayerPlan { name: name.to_owned(), seed, by_task });
            }
        };
        let tasks = asked.unwrap_or(&TaskName::ALL);
        let of = |player: &BuiltIn| -> BTreeMap<_, _> {
            let known = player.tasks.iter().filter(|task| tasks.contains(task));
            known.map(|&task| (task, player.name)).collect()
        };
        for name in experiment.players.iter().flat_map(|List(names)| names) {
            match name.as_str() {
                ALL => all().for_each(|player| add(player.name, of(player))),
                DEFAULT_PLAYER => {
                    let own = tasks.iter().map(|&task| (task, default_for(task).name));
                    add(name, own.collect());
                }
                name => {
                    let Some(player) = all().find(|player| player.name == name) else {
                        let known: Vec<_> = all().map(|player| player.name).collect();
                        self.tell(format!(
                            "there is no built-in player {name:?}; there are {}, default (each task's own) and all",
                            known.join(", ")
                        ));
                        continue;
                    };
                    for &task in asked.unwrap_or_default() {
                        if let Err(unknown) = find(name, task) {
                            self.tell(unknown.to_string());
                        }
                    }
                    add(name, of(player));
                }
            }
        }
        found
    }

    /// Models that a board would show as one, though they are not: one would be taken for the other, or never played.
    fn namesakes(&mut self, runs: &[Planned]) {
        let mut known: BTreeMap<(String, String, [Option<String>; AXES.len()]), &Who> =
            BTreeMap::new();
        for run in runs {
            let settings = AXES.map(|axis| run.setting(axis));
            let first = known.entry((run.name(), run.suite.name.clone(), settings));
            if *first.or_insert(&run.who) != &run.who {
                self.tell(format!(
                    "two models are called {:?}, and are asked in different ways: give each a name of its own (what \
                     its endpoint calls it is `model`)",
                    run.name()
                ));
            }
        }
    }

    /// Checks what the server would refuse, in its words.
    fn check(&mut self, run: &Planned) {
        let games = run.suite.plan();
        let most = 1000;
        if games.len() > most {
            self.tell(format!(
                "a run has at most {most} games (tasks × seeds), this one has {}: take the seeds in parts",
                games.len()
            ));
        }
        for game in games {
            // Runs that were created under wider limits continue; a new one is refused by the server.
            if let Err(errors) = Config::check(&run.suite.settings_of(&game)) {
                errors.0.into_iter().for_each(|error| self.tell(error.to_string()));
            }
        }
        if let Who::Model(model) = &run.who {
            let count = model.name.chars().count();
            if !(1..=MODEL_CHARS_MAX).contains(&count) || model.name.chars().any(char::is_control) {
                self.tell(format!(
                    "the name of a model must be 1 to {MODEL_CHARS_MAX} characters without control characters, is {:?}",
                    model.name
                ));
            }
            for (field, value, most) in
                [("temperature", model.temperature, 10.0), ("top_p", model.top_p, 1.0)]
            {
                if let Some(value) = value.filter(|value| !(0.0..=most).contains(value)) {
                    self.tell(format!("{field} must be from 0 to {most}, is {value}"));
                }
            }
        }
    }
}
