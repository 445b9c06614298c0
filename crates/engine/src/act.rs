//! Acts: an agent's decisions in a round.

use crate::grid::Direction;
use crate::message::Message;
use crate::names::TaskName;

/// The number of an agent; its name is `Agent_` and this number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct AgentId(pub u16);

impl AgentId {
    /// The commander under centralized control.
    pub const COMMANDER: Self = Self(0);

    /// Parses a name such as `Agent_3`; only the canonical spelling is accepted.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        let digits = name.strip_prefix("Agent_")?;
        // The canonical number has no sign and no leading zeros.
        let is_plain = digits.bytes().all(|digit| digit.is_ascii_digit());
        let is_short = digits == "0" || !digits.starts_with('0');
        if is_plain && is_short { digits.parse().ok().map(Self) } else { None }
    }

    /// The index of the agent in lists by agent.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

impl std::fmt::Display for AgentId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Agent_{}", self.0)
    }
}

/// An action of an agent's body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Action {
    /// Push one cell up.
    Up,
    /// Push one cell down.
    Down,
    /// Push one cell to the left.
    Left,
    /// Push one cell to the right.
    Right,
    /// Do nothing, on purpose.
    Stay,
    /// Flip the own light; in Synchronization only.
    Switch,
}

impl Action {
    /// All actions, those of every task first.
    pub const ALL: [Self; 6] =
        [Self::Up, Self::Down, Self::Left, Self::Right, Self::Stay, Self::Switch];

    /// The actions that a task knows.
    #[must_use]
    pub fn of_task(task: TaskName) -> &'static [Self] {
        if task == TaskName::Synchronization { &Self::ALL } else { &Self::ALL[..5] }
    }

    /// The name, in upper case.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Up => "UP",
            Self::Down => "DOWN",
            Self::Left => "LEFT",
            Self::Right => "RIGHT",
            Self::Stay => "STAY",
            Self::Switch => "SWITCH",
        }
    }

    /// The action of `task` with exactly this name.
    #[must_use]
    pub fn parse(task: TaskName, name: &str) -> Option<Self> {
        Self::of_task(task).iter().copied().find(|action| action.name() == name)
    }

    /// The direction of the push; `None` for actions that do not push.
    #[must_use]
    pub const fn direction(self) -> Option<Direction> {
        match self {
            Self::Up => Some(Direction::Up),
            Self::Down => Some(Direction::Down),
            Self::Left => Some(Direction::Left),
            Self::Right => Some(Direction::Right),
            Self::Stay | Self::Switch => None,
        }
    }
}

/// An agent's decision for one round. The default is "no action, no message".
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Act {
    /// The action; `None` does nothing.
    pub action: Option<Action>,
    /// The message; `None` says nothing.
    pub message: Option<Message>,
    /// The only receiver of the commander's message under centralized control (rules: *Centralized control*).
    pub to: Option<AgentId>,
}

impl Act {
    /// An action without a message.
    #[must_use]
    pub const fn of(action: Action) -> Self {
        Self { action: Some(action), message: None, to: None }
    }
}
