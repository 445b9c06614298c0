//! Status of an episode, and its ending.

use jiff::Timestamp;
pub use swarmbench_protocol::status::Status;

swarmbench_engine::named! {
    /// Reason for the end of an episode.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Ending {
        TaskDone = "task_done",
        /// All rounds were played.
        RoundsPlayed = "rounds_played",
        /// The creator ended the episode.
        Aborted = "aborted",
        /// No act came for too long.
        Idle = "idle",
        /// The competition closed.
        Closed = "closed",
    }
}

impl Ending {
    /// Status of an episode with this ending.
    pub const fn status(self) -> Status {
        match self {
            Self::TaskDone | Self::RoundsPlayed => Status::Finished,
            Self::Aborted | Self::Closed => Status::Aborted,
            Self::Idle => Status::Abandoned,
        }
    }
}

/// Ending of an episode, and its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    pub ending: Ending,
    pub at: Timestamp,
}
