//! Suites: tasks, seeds and settings under a name.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use swarmbench_engine::{RuleSet, Seed, Settings, TaskName};

use crate::game_settings;

/// Games of a run, and their settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Suite {
    /// Name of the suite.
    pub name: String,
    /// Names of the tasks, in the order in which they are played.
    pub tasks: Vec<String>,
    /// Seeds, on each of which every task is played once; with `seeds_by_task` only the seeds of the task.
    pub seeds: Vec<Seed>,
    /// Whether `seeds` has the seeds of the first task, then as many of the second, and so on.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub seeds_by_task: bool,
    /// Name of the rule set.
    pub rules: String,
    /// Settings of all games.
    pub settings: SuiteSettings,
}

game_settings! {
    complete
    /// Settings of all games of a suite: those of an episode except task, seed and rules.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct SuiteSettings {
        /// `decentralized` or `centralized`.
        pub control: String,
        ..settings,
        /// Clock of a round; none without one.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub round_deadline_ms: Option<u64>,
        /// Time that a seat may overspend in all rounds together.
        #[serde(default)]
        pub bank_ms: u64,
    }
}

impl Default for SuiteSettings {
    /// Standard setting.
    fn default() -> Self {
        Self::from(&Settings::default())
    }
}

/// Game of a plan.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlannedGame {
    /// Place of the game in the plan, from 0.
    pub slot: u32,
    /// Name of the task.
    pub task: String,
    /// Seed of the game.
    pub seed: Seed,
}

impl Suite {
    /// Names of the built-in suites.
    pub const BUILT_IN: [&str; 3] = ["standard", "quick", "baselines"];

    /// Built-in suite by these rules: `standard` is the setting of the paper's main tables, five tasks by five seeds; `quick`
    /// is a short look at all tasks; `baselines` is the setting of the paper's baselines, five tasks by the seeds 0 to 19.
    #[must_use]
    pub fn built_in(name: &str, rules: &str) -> Option<Self> {
        let tasks = TaskName::ALL.map(|task| task.name().to_owned()).to_vec();
        let (seeds, max_round) = match name {
            "standard" => {
                ([27, 42, 57, 72, 87].map(Seed::from).to_vec(), SuiteSettings::default().max_round)
            }
            "baselines" => ((0..20).map(Seed::from).collect(), SuiteSettings::default().max_round),
            "quick" => (vec![Seed::from(27)], 20),
            _ => return None,
        };
        let settings = SuiteSettings { max_round, ..SuiteSettings::default() };
        Some(Self {
            name: name.to_owned(),
            tasks,
            seeds,
            seeds_by_task: false,
            rules: rules.to_owned(),
            settings,
        })
    }

    /// All built-in suites by all rule sets.
    pub fn all_built_in() -> impl Iterator<Item = Self> {
        let rules = RuleSet::ALL.iter();
        let pairs =
            Self::BUILT_IN.iter().flat_map(move |name| rules.clone().map(move |r| (name, r)));
        pairs.filter_map(|(name, rules)| Self::built_in(name, rules.name()))
    }

    /// Number of seeds on which each task is played.
    #[must_use]
    pub fn seeds_each(&self) -> usize {
        let tasks = if self.seeds_by_task { self.tasks.len().max(1) } else { 1 };
        self.seeds.len() / tasks
    }

    /// Seeds of the task at this place, from 0.
    fn seeds_of(&self, place: usize) -> &[Seed] {
        let first = if self.seeds_by_task { place * self.seeds_each() } else { 0 };
        self.seeds.get(first..first + self.seeds_each()).unwrap_or_default()
    }

    /// All games, task by task.
    #[must_use]
    pub fn plan(&self) -> Vec<PlannedGame> {
        let pairs =
            self.tasks.iter().enumerate().flat_map(|(place, task)| {
                self.seeds_of(place).iter().map(move |&seed| (task, seed))
            });
        (0..)
            .zip(pairs)
            .map(|(slot, (task, seed))| PlannedGame { slot, task: task.clone(), seed })
            .collect()
    }

    /// Settings of the engine for a game of the suite.
    #[must_use]
    pub fn settings_of(&self, game: &PlannedGame) -> Settings {
        Settings {
            task: game.task.clone(),
            rules: self.rules.clone(),
            seed: game.seed.into(),
            ..Settings::from(&self.settings)
        }
    }

    /// First 12 hexadecimal digits of SHA-256 of the whole suite. Suites of the same name can differ in it.
    #[must_use]
    pub fn digest(&self) -> String {
        let json = serde_json::to_vec(self).expect("a suite has string keys");
        data_encoding::HEXLOWER.encode(&Sha256::digest(json)[..6])
    }
}

/// First 12 hexadecimal digits of SHA-256 of a prompt template's text.
#[must_use]
pub fn digest_of_template(text: &str) -> String {
    data_encoding::HEXLOWER.encode(&Sha256::digest(text)[..6])
}
