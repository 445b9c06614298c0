//! The faults of an experiment, found before its first game.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Map, Value, json};
use swarmbench_engine::{Config, Seed, TaskName, limits};
use swarmbench_players::{BuiltIn, DEFAULT_PLAYER, all, default_for, find};

use super::settings::{axes, standard};
use super::teams::size;
use super::{
    ALL, MODELS_AT_ONCE_MAX, ModelPlan, PARALLEL_MAX, PlanError, Planned, PlayerPlan, REQUESTS_MAX,
    RUNS_MAX, TEXTS_BYTES_MAX, Who,
};
use crate::eval::experiment::{Experiment, List, ModelEntry, Numbers, SystemMessage};
use crate::llm::Api;

/// Characters of a model's name on boards: the limit of the server. It is checked here so that the last of several
/// models does not fail after hours.
const MODEL_CHARS_MAX: usize = 200;

/// Games of a run: the limit of the server.
const GAMES_MAX: usize = 1000;

/// Numbers in a list of seeds, with repeated ones: far more than any run has games.
const SEEDS_READ_MAX: usize = 100_000;

/// Problems of one experiment that are told. A long file may have one in each line.
const PROBLEMS_MAX: usize = 100;

/// Problems, each listed once.
#[derive(Default)]
pub(super) struct Problems(Vec<String>);

impl Problems {
    /// Adds a problem.
    pub(super) fn add(&mut self, problem: String) {
        if self.0.len() < PROBLEMS_MAX && !self.0.contains(&problem) {
            self.0.push(problem);
        }
    }

    /// Succeeds if there are no problems.
    pub(super) fn none(self) -> Result<(), PlanError> {
        if self.0.is_empty() { Ok(()) } else { Err(PlanError(self.0)) }
    }

    /// Checks limits of concurrency, which the command line also checks by itself.
    pub(super) fn at_once(&mut self, experiment: &Experiment) {
        let models = experiment.models.iter().flat_map(|List(models)| models);
        let of_models = models.map(|model| ("requests", model.requests, REQUESTS_MAX));
        let of_all = [
            ("parallel", experiment.parallel, PARALLEL_MAX),
            ("requests", experiment.requests, REQUESTS_MAX),
            ("models_at_once", experiment.models_at_once, MODELS_AT_ONCE_MAX),
        ];
        for (name, value, most) in of_all.into_iter().chain(of_models) {
            if let Some(value) = value.filter(|value| !(1..=most).contains(value)) {
                self.add(format!("{name} is {value}, and may be 1 to {most}"));
            }
        }
    }

    /// Adds that these fields make too many runs.
    pub(super) fn too_many(&mut self, fields: &str) {
        self.add(format!(
            "{fields} make more than {RUNS_MAX} runs, the most of an experiment: play it in parts"
        ));
    }

    /// Checks what is sent beside prompts, for `players` models of all runs together: each has its own copy.
    pub(super) fn texts(&mut self, experiment: &Experiment, players: u64) -> bool {
        let bytes = |extra: &Option<Map<String, Value>>, system: &Option<SystemMessage>| {
            let extra = extra.as_ref().map_or(0, |extra| json!(extra).to_string().len());
            extra + system.as_ref().map_or(0, |system| system.json().to_string().len())
        };
        let own = experiment.models.iter().flat_map(|List(models)| models);
        let most = own.map(|model| bytes(&model.extra, &model.system)).max().unwrap_or(0);
        let each = most + bytes(&experiment.extra, &experiment.system);
        let fits = players.saturating_mul(each as u64) <= TEXTS_BYTES_MAX;
        if !fits {
            self.add(format!(
                "`extra` and `system` take {each} bytes, for {players} models of all runs: together at most {TEXTS_BYTES_MAX}; \
                 make them shorter, or play the experiment in parts"
            ));
        }
        fits
    }

    /// Number of agents of a team, if it is within the limits of a game; checked before any team is made.
    pub(super) fn agents(&mut self, asked: i64) -> Option<u16> {
        let agents = u16::try_from(asked).ok().filter(|_| limits::AGENTS.contains(&asked));
        if agents.is_none() {
            let (least, most) = (limits::AGENTS.start(), limits::AGENTS.end());
            self.add(format!("num_agents must be from {least} to {most}, is {asked}"));
        }
        agents
    }

    /// The tasks in their usual order; `None` if the experiment names none.
    pub(super) fn tasks(&mut self, asked: Option<&List<String>>) -> Option<Vec<TaskName>> {
        let List(names) = asked?;
        let mut tasks = BTreeSet::new();
        for name in names {
            match TaskName::find(name) {
                Some(task) => drop(tasks.insert(task)),
                None if name.eq_ignore_ascii_case(ALL) => tasks.extend(TaskName::ALL),
                None => {
                    let known = TaskName::ALL.map(TaskName::name).join(", ");
                    self.add(format!("there is no task {name:?}; the tasks are {known}, or all"));
                }
            }
        }
        Some(TaskName::ALL.into_iter().filter(|task| tasks.contains(task)).collect())
    }

    /// All seeds, sorted and without duplicates.
    pub(super) fn seeds(&mut self, asked: Option<&List<Numbers>>) -> Vec<Seed> {
        let Some(List(ranges)) = asked else { return standard().seeds };
        let all = ranges.iter().flat_map(|range| range.from..=range.last);
        let all: BTreeSet<u64> = all.take(SEEDS_READ_MAX).collect();
        if all.len() > GAMES_MAX || size(ranges) > SEEDS_READ_MAX as u64 {
            self.add(format!(
                "`seeds` has more than {GAMES_MAX} numbers, the most games of a run: take them in parts, and name each once"
            ));
            return standard().seeds;
        }
        let checked = all.into_iter().map(Seed::try_from);
        checked
            .filter_map(|seed| seed.map_err(|error| self.add(format!("seed {error}"))).ok())
            .collect()
    }

    /// The built-in players without duplicates. A named player has to play every requested task; with `all`, each
    /// player plays the tasks that it can.
    pub(super) fn players(
        &mut self,
        experiment: &Experiment,
        asked: Option<&[TaskName]>,
    ) -> Vec<PlayerPlan> {
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
                        self.add(format!(
                            "there is no built-in player {name:?}; there are {}, default (each task's own) and all",
                            known.join(", ")
                        ));
                        continue;
                    };
                    for &task in asked.unwrap_or_default() {
                        if let Err(unknown) = find(name, task) {
                            self.add(unknown.to_string());
                        }
                    }
                    add(name, of(player));
                }
            }
        }
        found
    }

    /// Checks that anybody plays. Not reported after another problem, such as a wrong name that was meant as a
    /// player.
    pub(super) fn nobody(&mut self, experiment: &Experiment, players: &[PlayerPlan]) {
        let has_models = experiment.models.as_ref().is_some_and(|List(models)| !models.is_empty());
        let is_somebody = has_models || !players.is_empty() || !experiment.teams.is_empty();
        if !is_somebody && self.0.is_empty() {
            self.add(
                "nobody plays: name language models with --model, or built-in players with --player, or a file \
                 that has `models`, `players` or `teams`"
                    .to_owned(),
            );
        }
    }

    /// Checks that system messages can be sent and stored.
    pub(super) fn system(&mut self, experiment: &Experiment, models: &[ModelEntry]) {
        let all = models.iter().map(|model| &model.system).chain([&experiment.system]);
        all.flatten().flat_map(SystemMessage::problems).for_each(|problem| self.add(problem));
    }

    /// Checks that no two different models look the same on a board: one would be taken for the other, or never be
    /// played.
    pub(super) fn namesakes(&mut self, runs: &[Planned]) {
        let mut known: BTreeMap<(String, String, Vec<Option<String>>), &Who> = BTreeMap::new();
        for run in runs {
            let settings = axes().map(|axis| run.setting(axis)).collect();
            let first = known.entry((run.name(), run.suite.name.clone(), settings));
            if *first.or_insert(&run.who) != &run.who {
                self.add(format!(
                    "two models are called {:?}, and are asked in different ways: give each a name of its own (what \
                     its endpoint calls it is `model`)",
                    run.name()
                ));
            }
        }
    }

    /// Checks numbers that no server checks.
    pub(super) fn numbers(&mut self, experiment: &Experiment, runs: &[Planned]) {
        if let Some(share) = experiment.stop_share
            && !(share > 0.0 && share <= 1.0)
        {
            self.add(format!(
                "stop_share is more than 0 and at most 1, where 1 is never; it is {share}"
            ));
        }
        for run in runs {
            for (model, _) in run.models() {
                if model.price.is_some_and(|price| !price.is_sane()) {
                    let name = &model.name;
                    self.add(format!("the prices of {name} must be numbers of at least 0"));
                }
            }
        }
    }

    /// Checks the server's own rules, with the server's messages.
    pub(super) fn check(&mut self, run: &Planned) {
        let games = run.suite.plan();
        if games.len() > GAMES_MAX {
            self.add(format!(
                "a run has at most {GAMES_MAX} games (tasks × seeds), this one has {}: take the seeds in parts",
                games.len()
            ));
        }
        // Games of a task differ in their seeds alone.
        let mut known = BTreeSet::new();
        for game in games.iter().filter(|game| known.insert(&game.task)) {
            // `Config::check`, not `admit`: runs created under wider limits continue, and the server refuses new
            // ones.
            if let Err(errors) = Config::check(&run.suite.settings_of(game)) {
                errors.0.into_iter().for_each(|error| self.add(error.to_string()));
            }
        }
        if let Who::Team(team) = &run.who {
            self.check_name("team", &team.name);
            for member in &team.members {
                self.check_name("member of a team", &member.name);
            }
            let reader = &run.suite.settings.answer_reader;
            for (_, model) in team.models() {
                if model.harness.reader(reader).is_some_and(|own| own != *reader) {
                    self.add(format!(
                        "{}: `harness.answer` of a model cannot differ from that of its team, as all seats of a game have one reader \
                         of answers: write `answer` into `[harness]` of the experiment",
                        model.name
                    ));
                }
            }
        }
        for (model, _) in run.models() {
            self.check_model(model);
        }
    }

    fn check_name(&mut self, whose: &str, name: &str) {
        let count = name.chars().count();
        if !(1..=MODEL_CHARS_MAX).contains(&count) || name.chars().any(char::is_control) {
            self.add(format!(
                "the name of a {whose} must be 1 to {MODEL_CHARS_MAX} characters without control characters, is {name:?}"
            ));
        }
    }

    fn check_model(&mut self, model: &ModelPlan) {
        if let Err(problem) = model.api.sampling(&model.sampling) {
            self.add(format!("{}: {problem}", model.name));
        }
        if let Some(problem) = model.harness.problem(model.api == Api::Responses) {
            self.add(format!("{}: {problem}", model.name));
        }
        self.check_name("model", &model.name);
        for (field, value, most) in [
            ("temperature", model.sampling.temperature, 10.0),
            ("top_p", model.sampling.top_p, 1.0),
        ] {
            if let Some(value) = value.filter(|value| !(0.0..=most).contains(value)) {
                self.add(format!("{field} must be from 0 to {most}, is {value}"));
            }
        }
    }
}
