//! Players of Foraging.

mod map_and_carry;

use swarmbench_engine::TaskName;

use crate::BuiltIn;

/// The players of Foraging, the best one first.
pub(crate) static PLAYERS: &[BuiltIn] = &[BuiltIn {
    name: "map-and-carry",
    tasks: &[TaskName::Foraging],
    summary: "Explores with a remembered map, then walks between food and nest, and tells where they are.",
    make: map_and_carry::make,
}];
