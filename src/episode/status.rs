//! The status of an episode, and how it ended.

use jiff::Timestamp;
pub use swarmbench_protocol::status::Status;

/// Why an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
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
    pub const fn name(self) -> &'static str {
        match self {
            Self::TaskDone => "task_done",
            Self::RoundsPlayed => "rounds_played",
            Self::Aborted => "aborted",
            Self::Idle => "idle",
            Self::Closed => "closed",
        }
    }

    pub fn parse(name: &str) -> Option<Self> {
        [Self::TaskDone, Self::RoundsPlayed, Self::Aborted, Self::Idle, Self::Closed]
            .into_iter()
            .find(|ending| ending.name() == name)
    }

    /// The status of an episode that ended so.
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
    pub ending: Ending,
    pub at: Timestamp,
}
