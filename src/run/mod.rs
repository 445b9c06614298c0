//! Runs: suites of games for one model. A run opens its games as they are needed.

pub mod definition;
pub mod manager;

use jiff::Timestamp;
pub use swarmbench_protocol::status::RunStatus;

use crate::ids::{RunKey, dated_id};
use crate::store::StoreError;
use crate::telemetry::Lost;
use manager::GAME_REPEATS_MAX;
use swarmbench_clock::Entropy;

/// Failure of the host to do something with a run, or a state of the run that does not allow it.
#[derive(Clone, Debug, thiserror::Error)]
pub enum RunError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("the journal failed: there is no run {}", .0.0)]
    Missing(RunKey),
    #[error("the journal failed: the definition of {run} cannot be read: {problem}")]
    Definition { run: String, problem: String },
    /// This program cannot play a game of the run.
    #[error("the journal failed: {0}")]
    Game(String),
    #[error("the journal failed: {0}")]
    Lost(#[from] Lost),
    /// The run has ended in another way than by finishing.
    #[error("the run is {0}, so no more games are opened")]
    Over(String),
    #[error("the game has not ended yet")]
    GameOpen,
    #[error("a game is played again at most {GAME_REPEATS_MAX} times (game_repeats_max)")]
    RepeatedOften,
}

pub fn new_id(now: Timestamp, entropy: &dyn Entropy) -> String {
    dated_id("run_", now, entropy)
}
