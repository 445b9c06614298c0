//! Synchronization by a shared clock.

use swarmbench_engine::{Act, Action, Observation};

use crate::{Player, Seat};

/// Uses the number of the round as a clock that all agents share: all lights are on after even rounds and off after odd
/// ones. No messages are needed, and every round scores.
#[derive(Clone)]
pub(crate) struct RoundClock;

/// Makes the player.
pub(crate) fn make(_: &Seat) -> Box<dyn Player> {
    Box::new(RoundClock)
}

impl Player for RoundClock {
    fn decide(&mut self, observation: &Observation) -> Act {
        let (Some(_), Some(light_on)) = (observation.position, observation.light_on) else {
            return Act::default();
        };
        let wanted = observation.round.is_multiple_of(2);
        Act::of(if light_on == wanted { Action::Stay } else { Action::Switch })
    }
}
