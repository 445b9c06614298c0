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
//! Running after the prey yields about a capture in eight rounds. But by the rules a new prey appears on the least
//! dangerous of a hundred drawn cells, and whether it is caught is asked before it moves for the first time. So a cell
//! that is closed on all four sides and has less danger than any other is a trap: new preys appear in it and are caught
//! in the next round, without any move. A corner needs two agents for that. One corner that is less dangerous than all
//! else is drawn with 1 - (51/52)^100 = 86 %, three with 99.7 %, four with 99.97 %. Then every round scores, and the
//! score is about 100 less the round of the first capture.
//!
//! For that first prey there are nets (`net.rs`): the prey's way depends on nothing but where the agents stand, so one
//! can stand such that its way leads over a cell on which those nearby can close in. Every agent computes the moves of
//! all (`scene.rs`, `march.rs`), and sends the places of all (`news.rs`). While no agent sees the prey, its few
//! possible places are followed by its own rule (`quarry.rs`).
//!
//! # What was tried
//!
//! Means over 200 to 300 seeds from 1000 on. Each line compares with how the player stood then:
//!
//! - One net for all preys is not enough: a prey keeps to even or odd cells, and no net was found that catches both.
//! - The same without following an unseen prey, only trying the other net after 12 rounds: 89.8; with it 91.4.
//! - A net with four closed corners once a prey sits in one, instead of the net that caught it: 92.0. A stray
//!   prey is rarer then: 0.14 a game instead of 0.28.
//! - To choose among six or seven nets by looking ahead gains 1.7 where all see the whole map (93.4 to 95.1). On news
//!   of up to three rounds ago agents choose differently, and it costs 2.0 (92.7 to 90.7). Telling each other the
//!   choice did not help either (at best 91.1, when always the same net scored 91.5). So only agents that see
//!   everything choose.
//! - To regard an agent as settled that once did not make way: 88.1, as it was mostly just late. Three times: 92.0, and
//!   no game is stuck any more (before, 2 of 300 scored nothing).
//! - The net for even preys, chosen by whole games instead of by the annealer's estimate: 92.0 to 92.7.
//! - A `track` that goes back to a post like `close-in` does, but does not talk, scores 2.5.
//!
//! # What limits it
//!
//! The first capture is in round 6.7 in the mean, 3.8 where all see everything; stray preys cost another 0.6
//! rounds. Agents start within five rows and columns of the top left and the prey at least in row and column 6,
//! so it takes some rounds until two agents can be beside it, and it flees. No score is above 100, and few layouts
//! allow a capture before round 3; so what is left to gain is about 4 points by knowing more in the first rounds,
//! and about 3 beyond that.
//!
//! The traps need a map on which the agents outweigh the walls everywhere. There are nets for 8 to 16 agents on
//! the standard map. Means over 60 seeds: 19 with 8
//! agents (half of the games never catch the first prey), 66 with 9, 88 with 10, and 89 to 93 with 11 to 16.
//! With a view of 3 × 3 it scores 80, with one of 7 × 7 93.5; with half of all messages noisy 91.8, with delays of up
//! to 4 rounds 90.6. The nets were made for the rules `paper`; under `reference`, where the prey often stays, it scores
//! 36 at the standard setting on seeds 0..20.
//!
//! # Larger maps and other swarms
//!
//! For the sizes of the paper's scaling table there are nets of their own, where any were found (seeds 0..20):
//!
//! | map | agents | `corner-traps` | `close-in` | `track` |
//! | --- | ---: | ---: | ---: | ---: |
//! | 15 × 15 | 20 | 30.0 ± 8.5 | 3.5 | 2.1 |
//! | 15 × 15 | 30 | 88.1 ± 2.4 | 7.0 | 4.3 |
//! | 20 × 20 | 20 | 0.5 ± 0.5 | 0.2 | 0.5 |
//! | 20 × 20 | 30 | 14.3 ± 7.8 | 1.2 | 1.0 |
//!
//! With 20 agents on 15 × 15 cells, nets that keep traps closed and catch what runs free in the same posts were looked
//! for in vain (two traps take eight agents, and twelve do not catch anything there). To move to a closed net after each
//! capture scores less (28.1 instead of 32.5, seeds 1000..1040), as the prey that appears meanwhile is free.
//!
//! In all other games `corner-traps` plays as the best of the others there: `chase` where a fourth of the map is full
//! (35.7 instead of 20.4 with 20 agents on 10 × 10 cells, 86.2 instead of 54.5 with 16 on 8 × 8), `track` where agents
//! are far between, and else `close-in`.

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
