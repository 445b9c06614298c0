//! Runs: a suite of games for one model, opened as they are needed.

pub mod definition;
pub mod manager;

use jiff::Timestamp;
pub use swarmbench_protocol::status::RunStatus;

use crate::ids::{RunKey, dated_id};
use crate::store::StoreError;
use swarmbench_clock::Entropy;

/// Why nothing could be done with a run. It is the host's fault, never a player's.
#[derive(Clone, Debug, thiserror::Error)]
pub enum RunError {
    /// The database cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// It does not exist.
    #[error("the journal failed: there is no run {}", .0.0)]
    Missing(RunKey),
    /// What was decided about it cannot be read.
    #[error("the journal failed: the definition of {run} cannot be read: {problem}")]
    Definition { run: String, problem: String },
    /// This program cannot play one of its games.
    #[error("the journal failed: {0}")]
    Game(String),
    #[error("the journal failed: {0}")]
    Panicked(String),
}

/// A new public id of a run.
pub fn new_id(now: Timestamp, entropy: &dyn Entropy) -> String {
    dated_id("run_", now, entropy)
}
