//! The reasons why an evaluation stops early.

use super::judge::advice;
use crate::client::ClientError;
use crate::llm::Stop;
use swarmbench_protocol::failure::Failure;

/// A reason why an evaluation stopped before everything was played.
#[derive(Debug, thiserror::Error)]
pub enum StopReason {
    /// The evaluation was interrupted.
    #[error("stopped")]
    Requested,
    /// The token budget of this call is spent.
    #[error(
        "the budget is spent: {spent} of {budget} tokens; the next call has a new budget of this size"
    )]
    Budget {
        /// Tokens that were spent.
        spent: u64,
        /// The budget.
        budget: u64,
    },
    /// Most answers fail in one way.
    #[error(
        "of {answers} answers of {model}, {count} were {}: {}; the same command plays on, and with --stop-share off it does \
         not stop for this. The last of them: {last}",
        kind.words(),
        advice(*kind)
    )]
    Failing {
        /// The model.
        model: String,
        /// The most frequent failure.
        kind: Failure,
        /// The number of failures of that kind.
        count: u64,
        /// The number of answers.
        answers: u64,
        /// The text of the last answer that failed so.
        last: String,
    },
    /// A model cannot be asked.
    #[error("{0}")]
    Model(Stop),
    /// The server cannot be used.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The run was ended from outside.
    #[error(
        "the run {id} was {status} before all of it was played; the same command starts another"
    )]
    Ended {
        /// The id of the run.
        id: String,
        /// The status of the run.
        status: String,
    },
    /// An attempt in a competition cannot be started.
    #[error("no attempt was started: {0}")]
    NotStarted(String),
    /// An attempt in a competition is over before all its games were played.
    #[error("{0}")]
    AttemptOver(String),
    /// Seats cannot be played.
    #[error("{0}")]
    Play(String),
}

/// The extent of a failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// The runs of this player.
    Player,
    /// Also the runs of further models at the same endpoint.
    Endpoint,
    /// All runs.
    All,
}

impl StopReason {
    /// The extent of the failure.
    #[must_use]
    pub const fn reach(&self) -> Reach {
        match self {
            Self::Requested | Self::Budget { .. } | Self::Client(_) => Reach::All,
            Self::Model(stop) => match stop {
                Stop::WrongKey { .. }
                | Stop::NoCredit { .. }
                | Stop::Elsewhere { .. }
                | Stop::Unreachable { .. } => Reach::Endpoint,
                Stop::Cassette { .. }
                | Stop::BudgetSpent { .. }
                | Stop::MoneySpent { .. }
                | Stop::Interrupted => Reach::All,
                Stop::Forbidden { .. }
                | Stop::NotFound { .. }
                | Stop::BadRequest { .. }
                | Stop::ComeLater { .. }
                | Stop::NotOnCassette { .. }
                | Stop::Settings(_) => Reach::Player,
            },
            Self::Failing { .. }
            | Self::Ended { .. }
            | Self::NotStarted(_)
            | Self::AttemptOver(_)
            | Self::Play(_) => Reach::Player,
        }
    }

    /// True if the same command resumes without a fix.
    #[must_use]
    pub fn can_resume(&self) -> bool {
        match self {
            Self::Requested | Self::Budget { .. } | Self::Failing { .. } => true,
            Self::Client(error) => error.is_temporary(),
            Self::Model(stop) => matches!(
                stop,
                Stop::NoCredit { .. }
                    | Stop::Unreachable { .. }
                    | Stop::ComeLater { .. }
                    | Stop::MoneySpent { .. }
            ),
            Self::Ended { .. } | Self::NotStarted(_) | Self::AttemptOver(_) | Self::Play(_) => {
                false
            }
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
