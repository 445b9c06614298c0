//! An experiment worked out: the runs that it takes, in the order in which they are played, each with what tells it from
//! all others.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};
use swarmbench_engine::{Config, Seed, Settings, TaskName};
use swarmbench_players::{BuiltIn, DEFAULT_PLAYER, all, default_for, find};

use super::experiment::{Axes, Experiment, List, MapSize, ModelEntry, Seeds, Shape};
use swarmbench_protocol::run::{OwnSettings, OwnSuite, RunRequest, SuiteRequest};
use swarmbench_protocol::suite::Suite;
use swarmbench_protocol::suite::digest_of_template;

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
pub fn axes() -> impl Iterator<Item = &'static str> {
    let first = ["rules", "control", "map_size"];
    let others = Settings::NAMES.iter().copied();
    let others = others.filter(|name| !["control", "width", "height"].contains(name));
    first.into_iter().chain(others).chain(["temperature", "top_p"])
}

/// The value of one of [`axes`] in a run by these rules and settings, at this temperature and `top_p`; none where it has
/// none.
pub(super) fn value(
    axis: &str,
    rules: &str,
    settings: &Settings,
    [temperature, top_p]: [Option<f64>; 2],
) -> Option<String> {
    match axis {
        "rules" => Some(rules.to_owned()),
        "map_size" => Some(MapSize { width: settings.width, height: settings.height }.to_string()),
        "temperature" => temperature.map(|value| value.to_string()),
        "top_p" => top_p.map(|value| value.to_string()),
        name => settings.get(name),
    }
}

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

    /// The value of one of [`axes`]; none where it has none.
    #[must_use]
    pub fn setting(&self, axis: &str) -> Option<String> {
        let Suite { rules, settings, .. } = &self.suite;
        value(axis, rules, &settings.into(), self.sampling())
    }

    /// The temperature and `top_p` of a model.
    fn sampling(&self) -> [Option<f64>; 2] {
        match &self.who {
            Who::Model(model) => [model.temperature, model.top_p],
            Who::Player(_) => [None, None],
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
        let text =
            json!([FORMAT, self.name(), self.suite, self.sampling(), self.template, self.meta()]);
        data_encoding::HEXLOWER.encode(&Sha256::digest(text.to_string())[..8])
    }

    /// The request that creates the run, with this many games open at a time.
    #[must_use]
    pub fn request(&self, parallel: u32) -> RunRequest {
        let Suite { name, tasks, seeds, rules, settings } = &self.suite;
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
    pub fn game_name(&self, task: &str, seed: Seed) -> String {
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
        let models = experiment.models.as_ref().map_or(&[][..], |List(models)| models);
        let players = problems.players(experiment, asked.as_deref());
        if models.is_empty() && players.is_empty() && problems.0.is_empty() {
            problems.tell(
                "nobody plays: name language models with --model, or built-in players with --player, or a file \
                 that has `models` or `players`"
                    .to_owned(),
            );
        }
        let seeds = problems.seeds(experiment.seeds.as_ref());
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
            varied: axes().filter(is_varied).collect(),
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
        let shared = axes().filter(|axis| !self.varied.contains(axis));
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

/// Settings of a run: a suite without tasks, seeds and name, and the temperature and `top_p` of models.
type Combination = (Suite, Option<f64>, Option<f64>);

/// All combinations of settings.
fn combinations(experiment: &Experiment) -> Vec<Combination> {
    let groups = match experiment.vary.as_slice() {
        [] => vec![experiment.settings.clone()],
        groups => groups.iter().map(|group| group.clone().over(&experiment.settings)).collect(),
    };
    groups.iter().flat_map(multiply).collect()
}

/// The combinations of one group.
fn multiply(group: &Axes) -> Vec<Combination> {
    let lists = group.lists();
    let given = axes().filter_map(|axis| Some((axis, lists.get(axis)?)));
    given.fold(vec![(standard(), None, None)], |all, (axis, values)| {
        all.iter()
            .flat_map(|base| values.iter().map(move |value| with(base.clone(), axis, value)))
            .collect()
    })
}

/// A combination with this value on an axis.
fn with(
    (mut suite, mut temperature, mut top_p): Combination,
    axis: &str,
    value: &Value,
) -> Combination {
    let text = || value.as_str().expect("a text");
    let mut set = |asked: Value| {
        let asked: OwnSettings = serde_json::from_value(asked).expect("an axis is a setting");
        suite.settings = (&asked.over((&suite.settings).into())).into();
    };
    match axis {
        "rules" => text().clone_into(&mut suite.rules),
        "map_size" => {
            let MapSize { width, height } = text().parse().expect("the size of a map");
            set(json!({ "width": width, "height": height }));
        }
        "temperature" => temperature = value.as_f64(),
        "top_p" => top_p = value.as_f64(),
        setting => set(json!({ setting: value })),
    }
    (suite, temperature, top_p)
}

/// The suite of these tasks and seeds, under a name that follows from what it is: runs of the same suite are on the same
/// board. A built-in one has its own name.
fn named(mut suite: Suite, tasks: &[TaskName], seeds: &[Seed]) -> Suite {
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
    let (is, was) = (Settings::from(&suite.settings), Settings::from(&usual.settings));
    let mut names = Settings::NAMES.to_vec();
    // Names of suites have always had the size of the map before the number of agents.
    names.sort_by_key(|name| !["control", "width", "height"].contains(name));
    for name in names {
        if let (Some(value), true) = (is.get(name), is.get(name) != was.get(name)) {
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

/// Seeds in short: what follows one another as a range.
#[must_use]
pub fn ranges(seeds: &[Seed]) -> String {
    let mut parts: Vec<(u64, u64)> = Vec::new();
    for seed in seeds.iter().map(|seed| seed.get()) {
        match parts.last_mut() {
            Some((_, last)) if *last + 1 == seed => *last = seed,
            _ => parts.push((seed, seed)),
        }
    }
    let told = parts.iter().map(|&(from, last)| match last - from {
        0 => from.to_string(),
        1 => format!("{from}, {last}"),
        _ => format!("{from}..{}", last + 1),
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

    /// All seeds, each once, in order.
    fn seeds(&mut self, asked: Option<&List<Seeds>>) -> Vec<Seed> {
        let Some(List(ranges)) = asked else { return standard().seeds };
        let all: BTreeSet<u64> = ranges.iter().flat_map(|range| range.from..=range.last).collect();
        let checked = all.into_iter().map(Seed::try_from);
        checked
            .filter_map(|seed| seed.map_err(|error| self.tell(format!("seed {error}"))).ok())
            .collect()
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
        let mut known: BTreeMap<(String, String, Vec<Option<String>>), &Who> = BTreeMap::new();
        for run in runs {
            let settings = axes().map(|axis| run.setting(axis)).collect();
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
