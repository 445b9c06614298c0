//! The settings that have names: task, rule set and control. This module uses no other module of the engine.

/// One of the five tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum TaskName {
    /// Push a block out of a gap in the wall, then leave through it.
    Transport,
    /// Surround a prey that flees.
    Pursuit,
    /// Switch all lights on, then off, and so on.
    Synchronization,
    /// Carry food to the nest.
    Foraging,
    /// Form the outline of a square.
    Flocking,
}

impl TaskName {
    /// All tasks.
    pub const ALL: [Self; 5] =
        [Self::Transport, Self::Pursuit, Self::Synchronization, Self::Foraging, Self::Flocking];

    /// Its name on the wire.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Transport => "Transport",
            Self::Pursuit => "Pursuit",
            Self::Synchronization => "Synchronization",
            Self::Foraging => "Foraging",
            Self::Flocking => "Flocking",
        }
    }

    /// The task with exactly this name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|task| task.name() == name)
    }
}

/// Which of the two rule sets holds (rules: the introduction).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RuleSet {
    /// The paper's text.
    Paper,
    /// The public toolkit as it behaves; square maps only.
    Reference,
}

impl RuleSet {
    /// Both rule sets.
    pub const ALL: [Self; 2] = [Self::Paper, Self::Reference];

    /// Its name on the wire.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Reference => "reference",
        }
    }
}

/// Who may talk to whom, and who sees what.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Control {
    /// Everybody sees a window and talks to neighbours.
    Decentralized,
    /// Everybody sees the whole map and talks to the commander alone, and the commander to all.
    Centralized,
}

impl Control {
    /// Both kinds of control.
    pub const ALL: [Self; 2] = [Self::Decentralized, Self::Centralized];

    /// Its name on the wire.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Decentralized => "decentralized",
            Self::Centralized => "centralized",
        }
    }
}
