//! The player that every other one has to beat.

use swarmbench_engine::{Act, Action, Observation};

use crate::chance::Chance;
use crate::{Player, Seat};

/// Picks any action of the task, every one equally likely, and says nothing.
pub(crate) struct Random {
    chance: Chance,
    actions: &'static [Action],
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    Box::new(Random { chance: Chance::new(seat), actions: Action::of_task(seat.task) })
}

impl Player for Random {
    fn decide(&mut self, observation: &Observation) -> Act {
        if observation.position.is_none() {
            return Act::default();
        }
        Act::of(self.chance.pick(self.actions))
    }
}
