//! Synchronization by following the lowest number, without memory and without messages.

use swarmbench_engine::{Act, Observation};

use super::gather::{lights, step, turn};
use crate::{Player, Seat};

/// Walks to the middle. There its light becomes the opposite of the light of the lowest number in view, itself
/// included. That agent does the same with a lower number, and the lowest of all switches every round. So every agent
/// whose chain of lowest numbers ends there is in step with it.
#[derive(Clone)]
struct SwitchWithTheLowest {
    seat: Seat,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    Box::new(SwitchWithTheLowest { seat: seat.clone() })
}

impl Player for SwitchWithTheLowest {
    fn decide(&mut self, observation: &Observation) -> Act {
        let (Some(_), Some(is_on)) = (observation.position, observation.light_on) else {
            return Act::default();
        };
        if let Some(step) = step(observation, &self.seat) {
            return Act::of(step);
        }
        let own = (self.seat.agent.0, is_on);
        let lowest = lights(observation, self.seat.rules)
            .fold(own, |lowest, seen| if seen.0 < lowest.0 { seen } else { lowest });
        Act::of(turn(is_on, !lowest.1))
    }
}
