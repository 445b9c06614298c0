//! Why an evaluation stops before its end.

use crate::llm::Stop;
use crate::players::client::ClientError;

/// Why not everything was played.
#[derive(Debug, thiserror::Error)]
pub enum Halt {
    /// Somebody asked for it.
    #[error("stopped")]
    Asked,
    /// What this call might spend is spent.
    #[error("the budget is spent: {spent} of {budget} tokens; the next call has as many again")]
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

impl Halt {
    /// Whether the same command goes on, and nothing has to be mended first.
    #[must_use]
    pub fn can_go_on(&self) -> bool {
        match self {
            Self::Asked | Self::Budget { .. } | Self::Client(ClientError::Transport { .. }) => true,
            Self::Model(stop) => matches!(
                stop,
                Stop::NoCredit { .. } | Stop::Unreachable { .. } | Stop::ComeLater { .. }
            ),
            Self::Client(_) | Self::Ended { .. } | Self::Play(_) => false,
        }
    }
}

impl From<Stop> for Halt {
    fn from(stop: Stop) -> Self {
        match stop {
            Stop::BudgetSpent { spent, budget } => Self::Budget { spent, budget },
            stop => Self::Model(stop),
        }
    }
}
