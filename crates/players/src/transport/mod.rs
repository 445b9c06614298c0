//! Players of Transport.
//!
//! Means at the standard setting over the seeds 1000..1500, and over the reported 0..20:
//!
//! | player | sees | 1000..1500 | 0..20 |
//! | --- | --- | ---: | ---: |
//! | `push-and-leave`, centralized control | the whole map | 10.74 | 10.75 |
//! | `push-and-leave` | its window, messages | 10.64 ± 0.13 | 10.62 ± 0.13 |
//! | `find-and-push` | its window, what it saw before | 9.78 ± 0.51 | 9.86 ± 0.51 |
//! | `push-ahead` | its window | 0.54 ± 1.67 | 0.30 ± 1.36 |
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
//! # Attempts (seeds 1000..1200)
//!
//! | step | mean |
//! | --- | ---: |
//! | the player before it: all push along, then all walk around the block | 10.14 |
//! | the plan: six push along, six wait for the push out | 10.38 |
//! | searching in the middle of what is possible, not at the nearest unknown cell | 10.49 |
//! | five push along, seven wait | 10.50 |
//! | the plan includes agents of unknown place | 10.54 |
//! | agents that pushed along continue | 10.64 |
//!
//! Alternatives to the last step: entering a lane only where a cell gets free 10.57, walking up around the rows 10.55.
//! Walking around others instead of pushing them aside: 10.59 with a detour of 3 for each agent. A steeper or flatter
//! cost of distance, another order of the first steps: no difference beyond chance. Six that push along at the end:
//! 10.0, because now and then the swarm gets stuck.
//!
//! # Limits of the score
//!
//! A cell of the gap is reached only through one of three cells before it, one in each round and pass, so at most three
//! agents leave in a round. The block is out of the gap after one push along and four out, and the agents behind it
//! leave a round later: in the rounds 4, 5, 6 and 7 at best where both pushes succeed in one round, else in 5 to 8. So
//! no swarm of twelve scores more than 12 − 0.66 = 11.34 or 12 − 0.78 = 11.22, 11.28 in the mean over the eight
//! layouts.
//!
//! A push in round 0 would need five agents behind the block from the start. Counting for each layout the rounds until
//! five can have walked there, and the corner behind the block is empty, leaves 10.96 in the mean (seeds 1000..2000; an
//! estimate, as it assumes that no agent is moved by others, and ignores those that push out). The first push comes in
//! round 4.4 in the mean, in round 3.8 under centralized control: missing knowledge costs 0.1, and the rest of the gap
//! comes from the few cells through which the places behind the block are reached.
//!
//! Fewer than five agents cannot move the block. With more than a third of the map full no agent can walk past the
//! others, and all push where they are. In such a crowd with fewer than 22 free cells `find-and-push` scores more, so
//! `push-and-leave` plays as `find-and-push` there: on 9 × 9 cells 30 agents score 21.9 instead of 12.7, on 10 × 10
//! cells 34 agents 28.4 instead of 27.8 (seeds 0..20).

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
