//! Players of Transport. Scores: `docs/measured/baselines.md`, written by `.ci/baselines`.
//!
//! # How `push-and-leave` works
//!
//! 1. An agent that does not know the gap excludes the exits that its window contradicts, sends the remaining ones and
//!    goes to the middle of them. After one or two rounds nearly all know the gap.
//! 2. Messages also pass on the last known place of each agent, so that all make about the same plan of places: five
//!    push the block along, the others already stand where it is pushed out. Where the pass along comes before the pass
//!    out (gaps in the left and right wall), both succeed in one round.
//! 3. Agents that pushed along continue. As the others follow the block out, this pushes the rows over into all three
//!    lanes of the gap, and three agents leave in each round.
//!
//! Under centralized control all agents see the whole map, so the same player plans with full knowledge.
//!
//! # What did not help
//!
//! Entering a lane only where a cell gets free, walking up around the rows, and walking around others instead of pushing them aside score
//! less. Six that push along at the end get stuck now and then.
//!
//! # Limits of the score
//!
//! A cell of the gap is reached only through one of three cells before it, one in each round and pass, so at most three
//! agents leave in a round. The block is out of the gap after one push along and four out, and the agents behind it
//! leave a round later: in the rounds 4, 5, 6 and 7 at best where both pushes succeed in one round, else in 5 to 8. So
//! no swarm of twelve scores more than 12 − 0.66 = 11.34 or 12 − 0.78 = 11.22, 11.28 in the mean over the eight
//! layouts. A push in round 0 would need five agents behind the block from the start; the rest of the gap comes from the few cells
//! through which the places behind the block are reached.
//!
//! Fewer than five agents cannot move the block. With more than a third of the map full no agent can walk past the
//! others, and all push where they are. In such a crowd with fewer than 22 free cells `find-and-push` scores more, so
//! `push-and-leave` plays as `find-and-push` there.

mod exit;
mod find_and_push;
mod push_ahead;
mod push_and_leave;
mod swarm;

use swarmbench_engine::TaskName;

use crate::BuiltIn;

/// The players of Transport, the best one first.
pub(crate) static PLAYERS: &[BuiltIn] = &[
    BuiltIn {
        name: "push-and-leave",
        tasks: &[TaskName::Transport],
        summary: "Passes on what is known of gap and swarm, plans who pushes where, and leaves through the gap.",
        make: push_and_leave::make,
    },
    BuiltIn {
        name: "find-and-push",
        tasks: &[TaskName::Transport],
        summary: "Remembers the map, lines up behind the block, pushes it out and leaves, without a word.",
        make: find_and_push::make,
    },
    BuiltIn {
        name: "push-ahead",
        tasks: &[TaskName::Transport],
        summary: "Pushes the block where it sees it and leaves where it sees the gap, without a memory.",
        make: push_ahead::make,
    },
];
