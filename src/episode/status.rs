//! The status of an episode, and how it ended.

use jiff::Timestamp;

/// The status of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Status {
    /// Created, not started.
    Waiting,
    /// Rounds are played.
    Running,
    /// Played to its end.
    Finished,
    /// Ended by its creator, or because its competition closed.
    Aborted,
    /// Ended after a time without acts.
    Abandoned,
}

impl Status {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Waiting, Self::Running, Self::Finished, Self::Aborted, Self::Abandoned];

    /// Its name on the wire and in the database.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Running => "running",
            Self::Finished => "finished",
            Self::Aborted => "aborted",
            Self::Abandoned => "abandoned",
        }
    }

    /// The status with this name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|status| status.name() == name)
    }

    /// Whether nothing happens any more.
    #[must_use]
    pub const fn is_over(self) -> bool {
        match self {
            Self::Waiting | Self::Running => false,
            Self::Finished | Self::Aborted | Self::Abandoned => true,
        }
    }
}

/// Why an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The task was done.
    TaskDone,
    /// All rounds were played.
    RoundsPlayed,
    /// Its creator ended it.
    Aborted,
    /// Nobody acted for too long.
    Idle,
    /// Its competition closed.
    Closed,
}

impl Ending {
    /// Its name on the wire and in the journal.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::TaskDone => "task_done",
            Self::RoundsPlayed => "rounds_played",
            Self::Aborted => "aborted",
            Self::Idle => "idle",
            Self::Closed => "closed",
        }
    }

    /// The ending with this name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        [Self::TaskDone, Self::RoundsPlayed, Self::Aborted, Self::Idle, Self::Closed]
            .into_iter()
            .find(|ending| ending.name() == name)
    }

    /// The status of an episode that ended so.
    #[must_use]
    pub const fn status(self) -> Status {
        match self {
            Self::TaskDone | Self::RoundsPlayed => Status::Finished,
            Self::Aborted | Self::Closed => Status::Aborted,
            Self::Idle => Status::Abandoned,
        }
    }
}

/// How an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Why.
    pub ending: Ending,
    /// When.
    pub at: Timestamp,
}
