//! Options of a batch, and the shapes of its arrays.

use swarmbench_engine::{Action, Config, Control, TaskName};

use crate::window::CHANNELS;

/// Options of a batch beside the settings of the game.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Number of environments, from 1 to [`Options::ENVIRONMENTS_MAX`].
    pub environments: usize,
    /// The seed from which layouts' seeds are drawn.
    pub seed: u64,
    /// Number of threads that step environments; 0 for one per processor.
    pub threads: usize,
    /// Format of windows.
    pub observations: Observations,
    /// Attribution of rewards.
    pub rewards: Rewards,
    /// Behaviour after the end of an episode.
    pub autoreset: Autoreset,
    /// Actions that the mask allows.
    pub mask: Mask,
    /// True if the acts of each episode are recorded, which states and journals require.
    pub record: bool,
}

impl Options {
    /// Maximum number of environments of a batch.
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

/// Format of windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Observations {
    /// A plane of zeros and ones for each of [`CHANNELS`].
    Planes,
    /// A byte for each cell: its index in [`CHANNELS`].
    Symbols,
    /// No windows.
    None,
}

/// Attribution of rewards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rewards {
    /// Every agent earns the change of the score.
    Team,
    /// Every agent earns its own contribution, if the task can attribute it.
    Individual,
}

/// Behaviour after the end of an episode, with Gymnasium's names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Autoreset {
    /// The next step begins another episode and ignores the actions.
    NextStep,
    /// The same step begins another episode; the last observation of the old one is written separately.
    SameStep,
    /// No reset: stepping an environment whose episode is over is an error.
    Disabled,
}

/// Actions that the mask allows. By the rules every action of an agent on the map is allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mask {
    /// All actions, for agents that may act.
    Alive,
    /// All actions except pushes against a wall, a nest or food right beside the agent, which change nothing. This is a
    /// hint, computed from the agent's own window only.
    Moves,
}

/// The sizes of all arrays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Number of environments.
    pub environments: usize,
    /// Number of agents of each environment.
    pub agents: usize,
    /// Rows and columns of a window.
    pub window: (usize, usize),
    /// Planes of a window: one for each of [`CHANNELS`], 1 for symbols, 0 without windows.
    pub planes: usize,
    /// Number of actions of the task.
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

    /// Number of cells of a window.
    #[must_use]
    pub const fn cells(&self) -> usize {
        self.window.0 * self.window.1
    }
}
