//! The only check of settings (rules: *Limits*).
//!
//! [`Settings`] are unchecked; a [`Config`] is known to be playable: every layout fits, every cost is bounded, nothing
//! in the engine has to check again.

use std::fmt;

use crate::config::Config;
use crate::names::{AnswerReader, Control, RuleSet, TaskName};
use crate::seed::Seed;
use crate::settings::Settings;
use crate::tasks;

/// The reason why a setting was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field} {problem}")]
pub struct SettingError {
    /// The name of the setting.
    pub field: &'static str,
    /// The allowed values, and the one that was sent.
    pub problem: String,
}

/// All settings that were refused; never empty.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SettingErrors(pub Vec<SettingError>);

impl fmt::Display for SettingErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (n, error) in self.0.iter().enumerate() {
            write!(f, "{}{error}", if n == 0 { "" } else { "; " })?;
        }
        Ok(())
    }
}

impl std::error::Error for SettingErrors {}

/// The limits of settings; the error that a limit causes names it.
pub mod limits {
    /// Rows and columns of a map.
    pub const SIZE: std::ops::RangeInclusive<i64> = 8..=256;
    /// Agents of an episode; fewer if they do not fit on the map.
    pub const AGENTS: std::ops::RangeInclusive<i64> = 1..=1024;
    /// Agents of a Flocking episode, whose cost grows fastest.
    pub const FLOCKING_AGENTS_MAX: i64 = 256;
    /// Rounds of an episode.
    pub const ROUNDS: std::ops::RangeInclusive<i64> = 1..=100_000;
    /// Remembered rounds.
    pub const MEMORY: std::ops::RangeInclusive<i64> = 0..=50;
    /// Rounds by which a message can be late.
    pub const DELAY: std::ops::RangeInclusive<i64> = 0..=100;
    /// Seeds: whole numbers that are exact in every JSON reader.
    pub const SEED: std::ops::RangeInclusive<i64> = 0..=(1 << 53) - 1;
    /// Cells of a window × memory.
    pub const REMEMBERED_CELLS_MAX: i64 = 1 << 16;
    /// Cells of a window × memory × agents.
    pub const REMEMBERED_CELLS_OF_ALL_MAX: i64 = 1 << 22;
    /// Agents × rounds.
    pub const ACTS_MAX: i64 = 10_000_000;
    /// Cells of a window × agents, whatever they remember; for new episodes.
    pub const CELLS_OF_A_ROUND_MAX: i64 = 1 << 20;
    /// Agents × agents that each of them reaches, at most as many as a window has cells; for new episodes.
    pub const MESSAGES_OF_A_ROUND_MAX: i64 = 1 << 17;
    /// Agents × agents that each of them reaches × rounds for which a message can be under way; for new episodes.
    pub const MESSAGES_UNDER_WAY_MAX: i64 = 1 << 22;
    /// Agents × (remembered rounds + rounds by which a message can be late): the messages whose text is kept; for new
    /// episodes.
    pub const TEXTS_KEPT_MAX: i64 = 1 << 16;
}

impl Config {
    /// Checks the settings of a new episode. The limits are stricter than for episodes that were created or announced
    /// before, which are checked by [`Config::check`].
    ///
    /// # Errors
    /// Errors of [`Config::check`], then errors of [`Config::check_new`].
    pub fn admit(settings: &Settings) -> Result<Self, SettingErrors> {
        let config = Self::check(settings)?;
        config.check_new()?;
        Ok(config)
    }

    /// Checks the limits of new episodes, beyond those of all playable ones: cells seen in a round, messages delivered
    /// in a round, and messages and texts kept.
    ///
    /// # Errors
    /// Every limit that is exceeded.
    pub fn check_new(&self) -> Result<(), SettingErrors> {
        let mut check = Check(Vec::new());
        let agents = i64::from(self.num_agents);
        let window = self.window_cells();
        let delay = i64::from(self.max_delay);
        let reached = match self.control {
            Control::Decentralized => window.min(agents),
            // All agents send to the commander, and the commander sends to all.
            Control::Centralized => 2,
        };
        let messages = agents * reached;
        check.most(
            "num_agents",
            "× cells of a window",
            agents * window,
            limits::CELLS_OF_A_ROUND_MAX,
        );
        check.most(
            "num_agents",
            "× agents that one of them reaches (at most the cells of a window)",
            messages,
            limits::MESSAGES_OF_A_ROUND_MAX,
        );
        check.most(
            "max_delay",
            "(+ 1) × num_agents × agents that one of them reaches (at most the cells of a window)",
            (delay + 1) * messages,
            limits::MESSAGES_UNDER_WAY_MAX,
        );
        check.most(
            "memory",
            "(+ max_delay) × num_agents",
            (cast::<_, i64>(self.memory) + delay) * agents,
            limits::TEXTS_KEPT_MAX,
        );
        check.done()
    }

    /// Checks settings, of a new episode or an old one.
    ///
    /// # Errors
    /// Every setting that is out of its range, with the range; if all are in range, every combination that is too large
    /// or does not fit.
    pub fn check(settings: &Settings) -> Result<Self, SettingErrors> {
        let mut check = Check(Vec::new());
        let s = settings;
        let task = check.name("task", &s.task, &TaskName::ALL, TaskName::name);
        let rules = check.name("rules", &s.rules, &RuleSet::ALL, RuleSet::name);
        let control = check.name("control", &s.control, &Control::ALL, Control::name);
        let (readers, reader) = (&AnswerReader::ALL, AnswerReader::name);
        let reader = check.name("answer_reader", &s.answer_reader, readers, reader);
        check.range("seed", s.seed, &limits::SEED);
        check.range("num_agents", s.num_agents, &limits::AGENTS);
        check.range("width", s.width, &limits::SIZE);
        check.range("height", s.height, &limits::SIZE);
        check.range("max_round", s.max_round, &limits::ROUNDS);
        check.range("memory", s.memory, &limits::MEMORY);
        check.range("max_delay", s.max_delay, &limits::DELAY);
        if !(0.0..=1.0).contains(&s.noise) {
            check.fail("noise", format!("must be a probability from 0 to 1, is {}", s.noise));
        }
        let largest = 2 * s.width.max(s.height).clamp(8, 256) + 1;
        if !(3..=largest).contains(&s.view_size) || s.view_size % 2 == 0 {
            let is = s.view_size;
            check.fail("view_size", format!("must be odd and from 3 to {largest}, is {is}"));
        }
        let (Some(task), Some(rules), Some(control), Some(answer_reader)) =
            (task, rules, control, reader)
        else {
            return Err(SettingErrors(check.0));
        };
        check.done()?;
        let config = Self {
            task,
            rules,
            control,
            seed: cast(s.seed),
            num_agents: cast(s.num_agents),
            width: cast(s.width),
            height: cast(s.height),
            view_size: cast(s.view_size),
            memory: cast(s.memory),
            max_round: cast(s.max_round),
            noise: s.noise,
            max_delay: cast(s.max_delay),
            answer_reader,
            settings: s.clone(),
        };
        config.check_combinations()?;
        Ok(config)
    }

    /// The same settings with the layout of another seed.
    ///
    /// # Errors
    /// If the agents do not fit on that layout.
    pub fn with_seed(&self, seed: Seed) -> Result<Self, SettingErrors> {
        let settings = Settings { seed: seed.into(), ..self.settings.clone() };
        let config = Self { seed, settings, ..self.clone() };
        config.check_combinations()?;
        Ok(config)
    }

    /// Checks the combinations of settings: memory, total cost, and whether the agents fit.
    fn check_combinations(&self) -> Result<(), SettingErrors> {
        let mut check = Check(Vec::new());
        let agents = i64::from(self.num_agents);
        if self.rules == RuleSet::Reference && self.width != self.height {
            let (width, height) = (self.width, self.height);
            check.fail(
                "width",
                format!(
                    "must equal height under the rules `reference`, is {width} with height {height}"
                ),
            );
        }
        if self.task == TaskName::Flocking && agents > limits::FLOCKING_AGENTS_MAX {
            let most = limits::FLOCKING_AGENTS_MAX;
            check.fail("num_agents", format!("must be from 1 to {most} in Flocking, is {agents}"));
        }
        let remembered = self.window_cells() * cast::<_, i64>(self.memory);
        let (one, all) = (limits::REMEMBERED_CELLS_MAX, limits::REMEMBERED_CELLS_OF_ALL_MAX);
        if remembered > one {
            check.fail(
                "memory",
                format!("× cells of a window must be at most {one}, is {remembered}"),
            );
        } else if remembered * agents > all {
            let is = remembered * agents;
            check.fail(
                "memory",
                format!("× cells of a window × num_agents must be at most {all}, is {is}"),
            );
        }
        if agents * i64::from(self.max_round) > limits::ACTS_MAX {
            let (most, is) = (limits::ACTS_MAX, agents * i64::from(self.max_round));
            check.fail("max_round", format!("× num_agents must be at most {most}, is {is}"));
        }
        check.done()?;
        let room = tasks::room(self);
        if agents > room {
            let task = self.task.name();
            check.fail(
                "num_agents",
                format!("must be from 1 to {room} to fit on this map of {task}, is {agents}"),
            );
        }
        check.done()
    }

    /// The settings that were checked.
    #[must_use]
    pub fn settings(&self) -> Settings {
        self.settings.clone()
    }
}

/// Converts a number that was checked to be in range.
fn cast<A: TryInto<B>, B>(value: A) -> B
where
    A::Error: fmt::Debug,
{
    value.try_into().expect("the range was checked")
}

/// Collects problems.
struct Check(Vec<SettingError>);

impl Check {
    fn fail(&mut self, field: &'static str, problem: String) {
        self.0.push(SettingError { field, problem });
    }

    fn most(&mut self, field: &'static str, product: &str, is: i64, most: i64) {
        if is > most {
            self.fail(field, format!("{product} must be at most {most}, is {is}"));
        }
    }

    fn range(&mut self, field: &'static str, value: i64, range: &std::ops::RangeInclusive<i64>) {
        if !range.contains(&value) {
            let (low, high) = (range.start(), range.end());
            self.fail(field, format!("must be from {low} to {high}, is {value}"));
        }
    }

    fn name<T: Copy>(
        &mut self,
        field: &'static str,
        value: &str,
        all: &[T],
        name: fn(T) -> &'static str,
    ) -> Option<T> {
        let found = all.iter().copied().find(|&one| name(one) == value);
        if found.is_none() {
            let names: Vec<_> = all.iter().map(|&one| name(one)).collect();
            let shown: String = value.chars().take(40).collect();
            self.fail(field, format!("must be one of {}, is {shown:?}", names.join(", ")));
        }
        found
    }

    fn done(&mut self) -> Result<(), SettingErrors> {
        if self.0.is_empty() { Ok(()) } else { Err(SettingErrors(std::mem::take(&mut self.0))) }
    }
}
