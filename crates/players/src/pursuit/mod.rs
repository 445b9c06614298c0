//! Players of Pursuit.

mod chase;
mod close_in;
mod corner_traps;
mod field;
mod march;
mod net;
mod news;
mod quarry;
mod track;

use swarmbench_engine::TaskName;

use crate::BuiltIn;

/// The players of Pursuit, the best one first.
pub(crate) static PLAYERS: &[BuiltIn] = &[
    BuiltIn {
        name: "corner-traps",
        tasks: &[TaskName::Pursuit],
        summary: "Closes off corners in which every new prey appears, and herds a stray one into a net.",
        make: corner_traps::make,
    },
    BuiltIn {
        name: "close-in",
        tasks: &[TaskName::Pursuit],
        summary: "Calls out where the prey is and walks to the nearest free cell beside it.",
        make: close_in::make,
    },
    BuiltIn {
        name: "track",
        tasks: &[TaskName::Pursuit],
        summary: "Walks to where it last saw the prey, or about the map until it sees it again.",
        make: track::make,
    },
    BuiltIn {
        name: "chase",
        tasks: &[TaskName::Pursuit],
        summary: "Steps towards the prey while it sees it, and wanders otherwise.",
        make: chase::make,
    },
];
