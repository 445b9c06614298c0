//! The faults of an experiment, found before its first game.

use std::collections::{BTreeMap, BTreeSet};

use swarmbench_engine::{Config, Seed, TaskName};
use swarmbench_players::{BuiltIn, DEFAULT_PLAYER, all, default_for, find};

use super::settings::{axes, standard};
use super::{
    ALL, MODELS_AT_ONCE_MAX, ModelPlan, PARALLEL_MAX, PlanError, Planned, PlayerPlan, REQUESTS_MAX,
    Who,
};
use crate::eval::experiment::{Experiment, List, ModelEntry, Seeds, SystemMessage};

/// Characters of a model's name on boards: the limit of the server. It is checked here so that the last of several
/// models does not fail after hours.
const MODEL_CHARS_MAX: usize = 200;

/// Games of a run: the limit of the server.
const GAMES_MAX: usize = 1000;

/// Problems, each listed once.
#[derive(Default)]
pub(super) struct Problems(Vec<String>);

impl Problems {
    fn add(&mut self, problem: String) {
        if !self.0.contains(&problem) {
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
    pub(super) fn seeds(&mut self, asked: Option<&List<Seeds>>) -> Vec<Seed> {
        let Some(List(ranges)) = asked else { return standard().seeds };
        let all: BTreeSet<u64> = ranges.iter().flat_map(|range| range.from..=range.last).collect();
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
    pub(super) fn nobody(&mut self, models: &[ModelEntry], players: &[PlayerPlan]) {
        if models.is_empty() && players.is_empty() && self.0.is_empty() {
            self.add(
                "nobody plays: name language models with --model, or built-in players with --player, or a file \
                 that has `models` or `players`"
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
            if let Who::Model(model) = &run.who
                && model.price.is_some_and(|price| !price.is_sane())
            {
                let name = &model.name;
                self.add(format!("the prices of {name} must be numbers of at least 0"));
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
        for game in games {
            // `Config::check`, not `admit`: runs created under wider limits continue, and the server refuses new
            // ones.
            if let Err(errors) = Config::check(&run.suite.settings_of(&game)) {
                errors.0.into_iter().for_each(|error| self.add(error.to_string()));
            }
        }
        if let Who::Model(model) = &run.who {
            self.check_model(model);
        }
    }

    fn check_model(&mut self, model: &ModelPlan) {
        let count = model.name.chars().count();
        if !(1..=MODEL_CHARS_MAX).contains(&count) || model.name.chars().any(char::is_control) {
            self.add(format!(
                "the name of a model must be 1 to {MODEL_CHARS_MAX} characters without control characters, is {:?}",
                model.name
            ));
        }
        for (field, value, most) in
            [("temperature", model.temperature, 10.0), ("top_p", model.top_p, 1.0)]
        {
            if let Some(value) = value.filter(|value| !(0.0..=most).contains(value)) {
                self.add(format!("{field} must be from 0 to {most}, is {value}"));
            }
        }
    }
}
