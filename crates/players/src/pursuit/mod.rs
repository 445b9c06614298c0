//! Players of Pursuit.

mod close_in;

use swarmbench_engine::TaskName;

use crate::BuiltIn;

/// The players of Pursuit, the best one first.
pub(crate) static PLAYERS: &[BuiltIn] = &[BuiltIn {
    name: "close-in",
    tasks: &[TaskName::Pursuit],
    summary: "Calls out where the prey is and walks to the nearest free cell beside it.",
    make: close_in::make,
}];
