//! Synchronization by reaction alone.

use swarmbench_engine::{Act, Action, Observation};

use super::gather::{lights, step, turn};
use crate::{Player, Seat};

/// Walks to the middle. There it switches if all lights in view are like its own, and otherwise follows the majority.
/// Once all agree they stay in step, as every agent sees only agreement; until then, agents that happen to see
/// agreement switch too early.
#[derive(Clone)]
struct FollowTheMajority {
    seat: Seat,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    Box::new(FollowTheMajority { seat: seat.clone() })
}

impl Player for FollowTheMajority {
    fn decide(&mut self, observation: &Observation) -> Act {
        let (Some(_), Some(is_on)) = (observation.position, observation.light_on) else {
            return Act::default();
        };
        if let Some(step) = step(observation, &self.seat) {
            return Act::of(step);
        }
        let (mut on, mut off) = (usize::from(is_on), usize::from(!is_on));
        for (_, light) in lights(observation, self.seat.rules) {
            *(if light { &mut on } else { &mut off }) += 1;
        }
        Act::of(if on == 0 || off == 0 { Action::Switch } else { turn(is_on, on >= off) })
    }
}
