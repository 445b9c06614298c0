//! Players of Pursuit. Scores: `docs/measured/baselines.md`, written by `.ci/baselines`.
//!
//! # Why traps
//!
//! Chasing the prey yields a capture every several rounds. But by the rules a new prey appears on the least dangerous
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
//! # Decisions, and what did not help
//!
//! - One net for all preys is not enough: a prey keeps to even or odd cells, and no net was found that catches both.
//! - Following an unseen prey by its own rule catches the first one sooner than trying the other net after some rounds.
//! - Once a prey sits in a corner, a net with four closed corners replaces the net that caught it: fewer preys stray.
//! - Choosing among several nets by looking ahead helps where all see the whole map. On news of up to three rounds ago agents choose
//!   differently, and telling each other the choice did not help either. So only agents that see everything choose.
//! - An agent that did not make way once is mostly just late; one that did not three times counts as settled, and no game gets stuck.
//!
//! # Limits
//!
//! Agents start within five rows and columns of the top left and the prey at least in row and column 6, so two agents
//! need some rounds until they are beside it, and it flees. No score is above 100, and few layouts allow a capture
//! before round 3.
//!
//! # The rules `reference`, larger maps, and other swarms
//!
//! Nets that catch were made for the rules `paper`, for 10 to 16 agents on the standard map and for 30 on larger ones.
//! Under `reference` a prey often stays where it is, and a swarm that waits in its net waits to the end of the game. So in all other
//! games only the closed net is used, and the agents go after a prey that runs free (`stance.rs`): the four posts of the net that are
//! nearest to it move to a stance around it. All know how the prey flees, so each agent plays seven stances up to six rounds ahead, and
//! takes the one that catches first: beside the prey, beside its cells now and in the next moves, across corners, or two cells away.
//!
//! - Agents that see the prey may not be heard, and then wait for others that do not come. So when nothing is caught for
//!   long there are turns in which all look for the prey, and turns in which all come to the closed net and talk.
//! - In the standard setting under `paper` nets catch the first prey a round sooner than stances. With 8 and 9 agents stances are better.
//!
//! Closed nets were found by annealing for the probability that a new prey appears in a trap. On maps from 12 × 12 on
//! the traps lie in the middle, where no wall is near, corner to corner, so that they share agents: two traps take six,
//! three take eight. Some agents stand such that all other open cells have more danger. Without a closed net agents
//! spread evenly, which is worse.
//!
//! No closed net was found for 16, 20 or 24 agents on 20 × 20 cells: the windows of danger at the corners of the open
//! middle do not meet, so agents near a trap cannot make all other cells more dangerous than it. Where agents are too far
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
