//! Players of Flocking.

mod meet_in_the_middle;

use swarmbench_engine::TaskName;

use crate::BuiltIn;

/// The players of Flocking, the best one first.
pub(crate) static PLAYERS: &[BuiltIn] = &[BuiltIn {
    name: "meet-in-the-middle",
    tasks: &[TaskName::Flocking],
    summary: "Fills the outline of the square in the middle of the map, nearest free cell first.",
    make: meet_in_the_middle::make,
}];
