//! Runs: a suite of games for one model, opened as they are needed.

pub mod definition;
pub mod manager;

use jiff::Timestamp;
pub use swarmbench_protocol::status::RunStatus;
pub use swarmbench_protocol::suite;

use crate::clock::Entropy;
use crate::ids::dated_id;

/// A new public id of a run.
#[must_use]
pub fn new_id(now: Timestamp, entropy: &dyn Entropy) -> String {
    dated_id("run_", now, entropy)
}
