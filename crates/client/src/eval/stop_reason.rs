//! Why an evaluation stops before its end.

use crate::client::ClientError;
use crate::llm::Stop;

/// Why not everything was played.
#[derive(Debug, thiserror::Error)]
pub enum StopReason {
    /// It was interrupted.
    #[error("stopped")]
    Requested,
    /// The token budget of this call is spent.
    #[error(
        "the budget is spent: {spent} of {budget} tokens; the next call has a new budget of this size"
    )]
    Budget {
        /// Tokens that were spent.
        spent: u64,
        /// Tokens that might be.
        budget: u64,
    },
    /// A model cannot be asked.
    #[error("{0}")]
    Model(Stop),
    /// The server cannot be used.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// Somebody else ended the run.
    #[error(
        "the run {id} was {status} before all of it was played; the same command starts another"
    )]
    Ended {
        /// Its id.
        id: String,
        /// How it ended.
        status: String,
    },
    /// Seats cannot be played.
    #[error("{0}")]
    Play(String),
}

/// What a failure ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// The runs of the player.
    Player,
    /// Those of further models at the same endpoint, too.
    Endpoint,
    /// Everything.
    All,
}

impl StopReason {
    /// What it ends.
    #[must_use]
    pub const fn reach(&self) -> Reach {
        match self {
            Self::Requested | Self::Budget { .. } | Self::Client(_) => Reach::All,
            Self::Model(stop) => match stop {
                Stop::WrongKey { .. }
                | Stop::NoCredit { .. }
                | Stop::Elsewhere { .. }
                | Stop::OnlyStreams { .. }
                | Stop::Unreachable { .. } => Reach::Endpoint,
                Stop::Cassette { .. } | Stop::BudgetSpent { .. } | Stop::Interrupted => Reach::All,
                Stop::Forbidden { .. }
                | Stop::NotFound { .. }
                | Stop::BadRequest { .. }
                | Stop::ComeLater { .. }
                | Stop::NotOnCassette { .. }
                | Stop::Settings(_) => Reach::Player,
            },
            Self::Ended { .. } | Self::Play(_) => Reach::Player,
        }
    }

    /// Whether the same command resumes, and nothing has to be fixed first.
    #[must_use]
    pub fn can_resume(&self) -> bool {
        match self {
            Self::Requested | Self::Budget { .. } | Self::Client(ClientError::Transport { .. }) => {
                true
            }
            Self::Model(stop) => matches!(
                stop,
                Stop::NoCredit { .. } | Stop::Unreachable { .. } | Stop::ComeLater { .. }
            ),
            Self::Client(_) | Self::Ended { .. } | Self::Play(_) => false,
        }
    }
}

impl From<Stop> for StopReason {
    fn from(stop: Stop) -> Self {
        match stop {
            Stop::Interrupted => Self::Requested,
            Stop::BudgetSpent { spent, budget } => Self::Budget { spent, budget },
            stop => Self::Model(stop),
        }
    }
}
