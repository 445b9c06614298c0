//! Players of Foraging.

mod layout;
mod map_and_carry;
mod one_way_loop;
mod traffic;

use swarmbench_engine::TaskName;

use crate::BuiltIn;

/// The players of Foraging, the best one first.
pub(crate) static PLAYERS: &[BuiltIn] = &[
    BuiltIn {
        name: "one-way-loop",
        tasks: &[TaskName::Foraging],
        summary: "Foresees.",
        make: one_way_loop::make,
    },
    BuiltIn {
        name: "map-and-carry",
        tasks: &[TaskName::Foraging],
        summary: "Explores with a remembered map, then walks between food and nest, and tells where they are.",
        make: map_and_carry::make,
    },
];
