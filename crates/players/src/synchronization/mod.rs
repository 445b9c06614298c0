//! Players of Synchronization. Scores: `docs/measured/baselines.md`, written by `.ci/baselines`.
//!
//! A round scores at most once, so the maximum is 100. Reaching it takes only a clock that all agents share, such as
//! the number of the round.
//!
//! The other players do not use the number of the round. They gather in the middle of the map, because lights are seen
//! and messages are heard only two cells away. `pass-the-beat` loses the rounds until the beat of the lowest number has
//! spread, and relies on messages that arrive in the next round: with delays the news of a beat is too late. The two
//! players that only react keep the full pace once they have found it, which the means hide: a game scores more than 80
//! or next to nothing. When they stand still in the middle, an agent that sees no lower number may lead a second group,
//! or agents that see agreement too early undo the majority again and again, and this does not end.

mod follow_the_majority;
mod gather;
mod pass_the_beat;
mod round_clock;
mod switch_with_the_lowest;

use swarmbench_engine::TaskName;

use crate::BuiltIn;

/// The players of Synchronization, the best one first.
pub(crate) static PLAYERS: &[BuiltIn] = &[
    BuiltIn {
        name: "round-clock",
        tasks: &[TaskName::Synchronization],
        summary: "Turns its light on in even rounds and off in odd ones.",
        make: round_clock::make,
    },
    BuiltIn {
        name: "pass-the-beat",
        tasks: &[TaskName::Synchronization],
        summary: "Tells others the beat of the lowest number that it has heard of, and keeps it.",
        make: pass_the_beat::make,
    },
    BuiltIn {
        name: "switch-with-the-lowest",
        tasks: &[TaskName::Synchronization],
        summary: "Comes to the middle and switches with the lowest number in view.",
        make: switch_with_the_lowest::make,
    },
    BuiltIn {
        name: "follow-the-majority",
        tasks: &[TaskName::Synchronization],
        summary: "Comes to the middle and does as most lights in view, or switches where all agree.",
        make: follow_the_majority::make,
    },
];
