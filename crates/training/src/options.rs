//! What a batch is made of, and the shapes that follow from it.

use swarmbench_engine::{Action, Config, Control, TaskName};

use crate::window::CHANNELS;

/// What is chosen beside the settings of the game.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// How many environments there are, from 1 to [`Options::ENVIRONMENTS_MAX`].
    pub environments: usize,
    /// From where seeds are drawn.
    pub seed: u64,
    /// Threads that step environments; 0 for as many as there are processors.
    pub threads: usize,
    /// How windows are written.
    pub observations: Observations,
    /// Who earns what.
    pub rewards: Rewards,
    /// What happens after an episode.
    pub autoreset: Autoreset,
    /// Which actions the mask allows.
    pub mask: Mask,
    /// Whether the acts of each episode are recorded. States and journals are made from them.
    pub record: bool,
}

impl Options {
    /// Environments of a batch.
    pub const ENVIRONMENTS_MAX: usize = 1 << 20;
}

impl Default for Options {
    fn default() -> Self {
        Self {
            environments: 1,
            seed: 0,
            threads: 1,
            observations: Observations::Planes,
            rewards: Rewards::Team,
            autoreset: Autoreset::NextStep,
            mask: Mask::Alive,
            record: true,
        }
    }
}

/// How windows are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Observations {
    /// A plane of zeros and ones for each of [`CHANNELS`].
    Planes,
    /// A byte for each cell: its place in [`CHANNELS`].
    Symbols,
    /// Not at all.
    None,
}

/// Who earns what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rewards {
    /// Everybody the change of the score.
    Team,
    /// Every agent what it did itself, where the task can tell.
    Individual,
}

/// What happens after an episode, as Gymnasium names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Autoreset {
    /// The next step begins another episode, whatever the actions are.
    NextStep,
    /// The same step begins another episode; the last observation of the old one is written apart.
    SameStep,
    /// Nothing: stepping an environment whose episode is over is an error.
    Disabled,
}

/// Which actions the mask allows. By the rules every action of an agent on the map is allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mask {
    /// All, to agents that may act.
    Alive,
    /// The same without pushes against a wall, a nest or food that the agent sees right beside itself: they change
    /// nothing. A hint, from nothing but the agent's own window.
    Moves,
}

/// The sizes of all arrays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Environments.
    pub environments: usize,
    /// Agents of each.
    pub agents: usize,
    /// Rows and columns of a window.
    pub window: (usize, usize),
    /// Planes of a window: that of [`CHANNELS`], 1 for symbols, 0 without windows.
    pub planes: usize,
    /// Actions of the task.
    pub actions: usize,
    /// The agents' flag: `light_on` or `carrying_food`, in tasks that have one.
    pub flag: Option<&'static str>,
}

impl Shape {
    pub(crate) fn new(config: &Config, options: &Options) -> Self {
        let length = |cells: i64| usize::try_from(cells).expect("a positive size");
        let settings = config.settings();
        let window = match config.control() {
            Control::Decentralized => (settings.view_size, settings.view_size),
            Control::Centralized => (settings.height, settings.width),
        };
        Self {
            environments: options.environments,
            agents: config.num_agents().into(),
            window: (length(window.0), length(window.1)),
            planes: match options.observations {
                Observations::Planes => CHANNELS.len(),
                Observations::Symbols => 1,
                Observations::None => 0,
            },
            actions: Action::of_task(config.task()).len(),
            flag: match config.task() {
                TaskName::Synchronization => Some("light_on"),
                TaskName::Foraging => Some("carrying_food"),
                TaskName::Transport | TaskName::Pursuit | TaskName::Flocking => None,
            },
        }
    }

    /// Cells of a window.
    #[must_use]
    pub const fn cells(&self) -> usize {
        self.window.0 * self.window.1
    }
}
