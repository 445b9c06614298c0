//! The checked settings of an episode.

use crate::names::{AnswerReader, Control, RuleSet, TaskName};
use crate::seed::Seed;
use crate::settings::Settings;

/// Checked settings: an episode that can be laid out and played to its end.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    pub(crate) task: TaskName,
    pub(crate) rules: RuleSet,
    pub(crate) control: Control,
    pub(crate) seed: Seed,
    pub(crate) num_agents: u16,
    pub(crate) width: i32,
    pub(crate) height: i32,
    pub(crate) view_size: i32,
    pub(crate) memory: usize,
    pub(crate) max_round: u32,
    pub(crate) noise: f64,
    pub(crate) max_delay: u32,
    pub(crate) answer_reader: AnswerReader,
    /// The settings as requested: journals and clients are shown these.
    pub(crate) settings: Settings,
}

impl Config {
    /// The task.
    #[must_use]
    pub const fn task(&self) -> TaskName {
        self.task
    }

    /// The rule set.
    #[must_use]
    pub const fn rules(&self) -> RuleSet {
        self.rules
    }

    /// The control: the receivers of messages and the size of views.
    #[must_use]
    pub const fn control(&self) -> Control {
        self.control
    }

    /// The seed of the layout.
    #[must_use]
    pub const fn seed(&self) -> Seed {
        self.seed
    }

    /// Number of agents in the game.
    #[must_use]
    pub const fn num_agents(&self) -> u16 {
        self.num_agents
    }

    /// Number of rounds after which the episode ends.
    #[must_use]
    pub const fn max_round(&self) -> u32 {
        self.max_round
    }

    /// Number of past rounds that an agent remembers.
    #[must_use]
    pub const fn memory(&self) -> usize {
        self.memory
    }

    /// The reader of language models' answers.
    #[must_use]
    pub const fn answer_reader(&self) -> AnswerReader {
        self.answer_reader
    }

    /// Range of sight in each direction: half the window, rounded down.
    #[must_use]
    pub(crate) const fn reach(&self) -> i32 {
        self.view_size / 2
    }

    pub(crate) fn window_cells(&self) -> i64 {
        match self.control {
            Control::Decentralized => i64::from(self.view_size) * i64::from(self.view_size),
            Control::Centralized => i64::from(self.width) * i64::from(self.height),
        }
    }

    /// Number of cells that one agent sees.
    #[must_use]
    pub fn window(&self) -> usize {
        usize::try_from(self.window_cells()).expect("a window has few cells")
    }
}
