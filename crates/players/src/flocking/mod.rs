//! Players of Flocking. Scores: `docs/measured/baselines.md`, written by `.ci/baselines`.
//!
//! # The bound, which is reached
//!
//! The score is the cost of the layout less the least cost of any round, and no cost is below 0. So the cost of the
//! layout is the bound. `meet-in-the-middle` reaches it in every game at the standard setting: the deviation of its scores is the
//! deviation of the layouts.
//!
//! # Design
//!
//! - All agents have to use the same square. Every agent knows the size of the map, so the middle needs no message. In
//!   `follow-the-leader` one agent sends a place instead, which works as well, a little later.
//! - No agent has a cell of its own. With own cells (`walk-to-own-cell`) agents block each other's way, and some of the
//!   last never arrive.
//! - An agent may be shut in or out, with the last hole on the other side. At the standard setting it is enough to push
//!   an agent out of its cell, which then looks for another one. In larger swarms on small maps most games were not finished
//!   that way: now agents in place move up after some rounds, and the hole comes by.
//! - An agent that steps toward the middle of the agents in view does worse than a random one: small groups stand in
//!   clumps, and a clump is far from an outline.
//!
//! # Limits of other settings
//!
//! Time is the limit on large maps: the agents are still on their way after 100 rounds. A square that is larger
//! than the map never has cost 0; the agents then line the walls.

mod drift_together;
mod follow_the_leader;
mod meet_in_the_middle;
mod outline;
mod walk_to_own_cell;

use swarmbench_engine::TaskName;

use crate::BuiltIn;

/// The players of Flocking, the best one first.
pub(crate) static PLAYERS: &[BuiltIn] = &[
    BuiltIn {
        name: "meet-in-the-middle",
        tasks: &[TaskName::Flocking],
        summary: "Fills the outline of the square in the middle of the map, nearest free cell first.",
        make: meet_in_the_middle::make,
    },
    BuiltIn {
        name: "follow-the-leader",
        tasks: &[TaskName::Flocking],
        summary: "Fills the outline around the first agent, whose place all pass on.",
        make: follow_the_leader::make,
    },
    BuiltIn {
        name: "walk-to-own-cell",
        tasks: &[TaskName::Flocking],
        summary: "Walks to a cell of the outline in the middle that is its own by number.",
        make: walk_to_own_cell::make,
    },
    BuiltIn {
        name: "drift-together",
        tasks: &[TaskName::Flocking],
        summary: "Steps toward the middle of the agents in view.",
        make: drift_together::make,
    },
];
