//! Players of Foraging.
//!
//! | player | kind | seeds 0..20 | seeds 1000..1200 |
//! | --- | --- | --- | --- |
//! | `one-way-loop` | memory, messages, knows the rules' maps | 36.45 ± 1.28 | 36.33 ± 1.12 |
//! | `map-and-carry` | memory, messages | 20.80 ± 3.14 | 19.68 ± 3.28 |
//! | `map-in-silence` | memory, no messages | 20.05 ± 3.52 | 19.19 ± 3.31 |
//! | `wander-and-carry` | reaction to what is in view | 0.30 ± 0.57 | 0.39 ± 0.62 |
//! | `random` | | 0.05 ± 0.22 | 0.09 ± 0.30 |
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
//!   everything (36.30 ± 1.03 on seeds 0..20), so sight and messages are not the limit.
//!
//! # The bound
//!
//! The way from food to nest takes 13 steps, and the way back another 13. Without any traffic, and if no agent is
//! pushed along, an agent that is d steps from the food delivers ⌊(100 − d − 13) / 26⌋ + 1 times: 43.85 in the mean
//! over the seeds 0..20. In the loop a lap takes 28 steps, for one half of the gap is a detour of 2. A fourth delivery
//! is then possible only for an agent that starts within 3 steps of the food and never waits; all others deliver three
//! times, which makes 36. After the first 50 rounds the detour is almost the only loss; other steps are lost at the
//! beginning, when seven agents at a time want to leave the food by one corner.
//!
//! # Attempts that did not help
//!
//! Mean scores on seeds 1000..1200 or 1000..1100, at the stage at which each was tried.
//!
//! - Foresight without lanes: 28.8. Lanes through the gap alone: 30.7. Sides in the rooms as well: 32.3.
//!   Loaded before empty instead of who is most pressed for time: 33.6. The same sense of the loop on all maps: 36.3.
//! - The lanes with the loaded always on the inner one, which makes the loop run in the bad sense on half of the
//!   maps: 37 on the good ones but 27 and 32 on the bad ones.
//! - Agents that could still deliver a fourth time take the short lane both ways: 24.8 to 31.5 instead of 36.3. They
//!   meet all others head on.
//! - Looking ahead with the exact physics, for each of the five actions up to 16 rounds as if all others repeated their
//!   moves: between 29.1 and 36.5 instead of 36.3, and never clearly more, as the others do not repeat them.
//! - Planning ways in space and time, one agent around the other, 16 rounds ahead: between 0.7 and 17.3. When an agent
//!   finds no way, the swarm locks up.
//! - Treating agents that cannot be pushed on in time as impassable: 34.1 instead of 36.3.
//!
//! # Other settings
//!
//! Sixteen agents on 10 × 10 cells score 40.8, twenty 39.1 (seeds 0..20): from there on the loop is full, and a full
//! loop stops. So in a crowd (more agents than a third of the cells inside the ring) only some walk the loop, and the
//! others make room: 24 agents score 38.5 instead of 30.9, thirty 30.1 instead of 21.0, and 24 on 8 × 8 cells 32.1
//! instead of 20.0 (seeds 1000..1040). Fewer or more carriers than two sevenths of the cells score less. Where the gap
//! is one cell wide (9 × 9) there is no loop, and the swarm scores 11.6, little more than `map-in-silence` (10.4, seeds
//! 1000..1060). On larger maps the way is longer: docs/evaluate/baselines.md has the scores.

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
