//! Competitions as a server runs them; what they are is in [`swarmbench_boards::competition`].

pub mod closing;

use jiff::Timestamp;
pub use swarmbench_boards::competition::*;

use crate::clock::Entropy;
use crate::ids::dated_id;

/// A new public id of a competition.
#[must_use]
pub fn new_id(now: Timestamp, entropy: &dyn Entropy) -> String {
    dated_id("cmp_", now, entropy)
}

/// A new public id of an entrant.
#[must_use]
pub fn new_entrant_id(now: Timestamp, entropy: &dyn Entropy) -> String {
    dated_id("ent_", now, entropy)
}
