//! Players of Pursuit.
//!
//! | player | what it uses | decentralized | centralized |
//! | --- | --- | --- | --- |
//! | `corner-traps` | memory, messages, joint planning | 92.05 ± 2.19 | 95.80 ± 0.89 |
//! | `close-in` | memory, messages | 8.20 ± 1.74 | 13.05 ± 1.15 |
//! | `track` | memory | 6.75 ± 1.48 | 13.05 ± 1.15 |
//! | `chase` | its view | 5.50 ± 2.96 | 11.25 ± 1.21 |
//!
//! (Standard setting, mean and deviation over the seeds 0..20.)
//!
//! # Why traps
//!
//! Chasing the prey yields about a capture in eight rounds. But by the rules a new prey appears on the least dangerous
//! of a hundred drawn cells, and the capture is checked before its first move. So a cell that is closed on all four
//! sides and has less danger than any other is a trap: new preys appear in it and are caught in the next round, without
//! any move. A corner needs two agents for that. One corner that is less dangerous than all else is drawn with 1 -
//! (51/52)^100 = 86 %, three with 99.7 %, four with 99.97 %. Then every round scores, and the score is about 100 less
//! the round of the first capture.
//!
//! The first prey is caught in a net (`net.rs`): the prey's way depends only on where the agents stand, so agents can
//! stand such that it leads over a cell on which those nearby can close in. Every agent computes the moves of all
//! (`scene.rs`, `march.rs`), and sends the places of all (`news.rs`). While no agent sees the prey, its few possible
//! places are followed by its own rule (`quarry.rs`).
//!
//! # Attempts
//!
//! Means over 200 to 300 seeds from 1000 on. Each line compares with the player at that time:
//!
//! - One net for all preys is not enough: a prey keeps to even or odd cells, and no net was found that catches both.
//! - Without following an unseen prey, only trying the other net after 12 rounds: 89.8; with it 91.4.
//! - A net with four closed corners once a prey sits in one, instead of the net that caught it: 92.0. A stray
//!   prey is rarer then: 0.14 a game instead of 0.28.
//! - Choosing among six or seven nets by looking ahead gains 1.7 where all see the whole map (93.4 to 95.1). On news of
//!   up to three rounds ago agents choose differently, and it costs 2.0 (92.7 to 90.7). Telling each other the choice
//!   did not help either (at best 91.1, when always the same net scored 91.5). So only agents that see everything
//!   choose.
//! - An agent counts as settled once it did not make way: 88.1, as it was mostly just late. Three times: 92.0, and no
//!   game is stuck any more (before, 2 of 300 scored nothing).
//! - The net for even preys, chosen by whole games instead of by the annealer's estimate: 92.0 to 92.7.
//! - A `track` that goes back to a post like `close-in` does, but does not talk, scores 2.5.
//!
//! # Limits
//!
//! The first capture is in round 6.7 in the mean, 3.8 where all see everything; stray preys cost another 0.6 rounds.
//! Agents start within five rows and columns of the top left and the prey at least in row and column 6, so two agents
//! need some rounds until they are beside it, and it flees. No score is above 100, and few layouts allow a capture
//! before round 3; so more knowledge in the first rounds could gain about 4 points, and anything else about 3.
//!
//! The player scores 80 with a view of 3 × 3 and 93.5 with one of 7 × 7; with half of all messages noisy 91.8, with
//! delays of up to 4 rounds 90.6.
//!
//! # The rules `reference`, larger maps, and other swarms
//!
//! Nets that catch were made for the rules `paper`, for 10 to 16 agents on the standard map and for 30 on larger ones.
//! Under `reference` a prey often stays where it is, and a swarm that waits in its net waits to the end of the game: of
//! 100 games half scored 0 (45.5 in the mean, seeds 1000..1100). So in all other games only the closed net is used, and
//! the agents go after a prey that runs free (`stance.rs`): the four posts of the net that are nearest to it move to a
//! stance around it. All know how the prey flees, so each agent plays seven stances up to six rounds ahead, and takes
//! the one that catches first. On maps up to 12 × 12 that takes two to three rounds in the mean. Under `reference` the
//! standard setting scores 92.
//!
//! Means over the seeds 1000..1030 or 1000..1040 where stances were made, 12 agents:
//!
//! | | `paper` 12 × 12 | `paper` 15 × 15 | `reference` 10 × 10 |
//! | --- | ---: | ---: | ---: |
//! | without stances (nets under `reference`, else `close-in`) | 5.3 | 0.8 | 45.5 |
//! | beside the prey | 53 | 5 | 85.4 |
//! | beside its cell now and after its next move, in turns of 8 rounds | 67 | 22 | 92.3 |
//! | these two and the move after that, the one that catches first | 84 | 43 | 90.4 |
//! | across corners as well | 87 | 77 | 92.6 |
//! | two cells away as well | 89 | 78 | 92.8 |
//! | six rounds ahead instead of ten, at a third of the time | 87 | 75 | 92.8 |
//!
//! - Counting the cost of a stance after the capture, as for nets: 85 and 69 instead of 87 and 75.
//! - Agents that see the prey may not be heard, and then wait for others that do not come. So when nothing is caught for
//!   long there are turns in which all look for the prey, and turns in which all come to the closed net and talk: under
//!   `reference` with 12 agents on 15 × 15 cells 63 instead of 50, as fewer games never catch the first prey.
//! - Stances instead of nets in the standard setting `paper`: 91.4 instead of 92.5, as the first capture takes a round
//!   longer (seeds 1000..1060). With 8 and 9 agents they are better (60 and 82 instead of 16 and 65).
//!
//! Closed nets were found by annealing for the probability that a new prey appears in a trap. On maps from 12 × 12 on
//! the traps lie in the middle, where no wall is near, corner to corner, so that they share agents: two traps take six,
//! three take eight. Some agents stand such that all other open cells have more danger. Without a closed net agents
//! spread evenly, which is worse (on 12 × 12 cells 52 instead of 89 with 16 agents).
//!
//! No closed net was found for 16, 20 or 24 agents on 20 × 20 cells: the windows of danger at the corners of the open
//! middle do not meet, so agents near a trap cannot make all other cells more dangerous than it. With 8 agents on 15 ×
//! 15 cells a new prey appears in a trap with 75 %, and one that escapes costs five rounds. Where agents are too far
//! apart to see most of the map (more than 14 cells for each) stances do not help, and `corner-traps` plays as `track`
//! or `close-in`.

mod chase;
mod close_in;
mod corner_traps;
mod field;
mod march;
mod net;
mod news;
mod quarry;
mod scene;
mod stance;
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
