//! Players of Foraging.

mod layout;
mod map_and_carry;
mod one_way_loop;
mod traffic;
mod wander_and_carry;

use swarmbench_engine::TaskName;

use crate::BuiltIn;

/// The players of Foraging, the best one first.
pub(crate) static PLAYERS: &[BuiltIn] = &[
    BuiltIn {
        name: "one-way-loop",
        tasks: &[TaskName::Foraging],
        summary: "Knows which maps there can be, and walks in a loop in which all keep to their lanes.",
        make: one_way_loop::make,
    },
    BuiltIn {
        name: "map-and-carry",
        tasks: &[TaskName::Foraging],
        summary: "Explores with a remembered map, then walks between food and nest, and tells where they are.",
        make: map_and_carry::make,
    },
    BuiltIn {
        name: "map-in-silence",
        tasks: &[TaskName::Foraging],
        summary: "Explores with a remembered map, then walks between food and nest, and says nothing.",
        make: map_and_carry::make_silent,
    },
    BuiltIn {
        name: "wander-and-carry",
        tasks: &[TaskName::Foraging],
        summary: "Steps toward food or nest where one is in view, else anywhere.",
        make: wander_and_carry::make,
    },
];
