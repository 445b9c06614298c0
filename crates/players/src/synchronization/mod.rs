//! Players of Synchronization.

mod round_clock;

use swarmbench_engine::TaskName;

use crate::BuiltIn;

/// The players of Synchronization, the best one first.
pub(crate) static PLAYERS: &[BuiltIn] = &[BuiltIn {
    name: "round-clock",
    tasks: &[TaskName::Synchronization],
    summary: "Turns its light on in even rounds and off in odd ones.",
    make: round_clock::make,
}];
