//! The status of an episode, and how it ended.

use jiff::Timestamp;
pub use swarmbench_protocol::status::Status;

swarmbench_engine::named! {
    /// Why an episode ended.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Ending {
        TaskDone = "task_done",
        /// All rounds were played.
        RoundsPlayed = "rounds_played",
        /// Its creator ended it.
        Aborted = "aborted",
        /// Nobody acted for too long.
        Idle = "idle",
        /// Its competition closed.
        Closed = "closed",
    }
}

impl Ending {
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
