//! Players of Foraging. Scores: `docs/measured/baselines.md`, written by `.ci/baselines`.
//!
//! # How `one-way-loop` works
//!
//! - **Four maps.** The rules can lay out four maps of 10 × 10 cells (never more than eight of any size). Views and
//!   messages rule maps out; while several are left, it takes the one whose food is nearest. On a known map the length
//!   of every way has a formula.
//! - **Lanes.** The gap in the wall is two cells wide. Loaded agents take one half of it and empty ones the other, and
//!   in the rooms they keep to different sides, so that the traffic is one loop of 28 cells. The loop runs in the same
//!   sense whichever square holds the food: directions are resolved one after another, and in the other sense agents
//!   push those ahead into a wall at the corners.
//! - **Foresight.** In each round an agent computes what all agents in view will do: loaded before empty, then those
//!   nearest to their goal; an agent in the way decides next and makes room. As all use the same rule, they mostly
//!   agree. The player scores the same with a view of 5 × 5 cells as under centralized control, where it sees
//!   everything, so sight and messages are not the limit.
//!
//! # The bound
//!
//! The way from food to nest takes 13 steps, and the way back another 13. Without any traffic, and if no agent is
//! pushed along, an agent that is d steps from the food delivers ⌊(100 − d − 13) / 26⌋ + 1 times. In the loop a lap takes 28 steps, for
//! one half of the gap is a detour of 2. A fourth delivery is then possible only for an agent that starts within 3 steps of the food and
//! never waits; all others deliver three times, which makes 36. Later the detour is almost the only loss; other steps are lost at the
//! beginning, when seven agents at a time want to leave the food by one corner.
//!
//! # What did not help
//!
//! - Foresight without lanes, lanes through the gap alone, and sides in the rooms without one sense of the loop: each is a part of what the
//!   player gains, in this order.
//! - Lanes with the loaded always on the inner one: the loop then runs in the bad sense on half of the maps.
//! - Agents that could still deliver a fourth time take the short lane both ways: they meet all others head on.
//! - Looking ahead with the exact physics as if all others repeated their moves: they do not repeat them.
//! - Planning ways in space and time, one agent around the other: when an agent finds no way, the swarm locks up.
//! - Treating agents that cannot be pushed on in time as impassable.
//!
//! # Other settings
//!
//! In a crowd the loop is full, and a full loop stops. So where more than a third of the cells inside the ring have agents only some
//! walk the loop, about two sevenths of the cells, and the others make room. Where the gap is one cell wide (9 × 9) there is no
//! loop. On larger maps the way is longer.

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
