//! The baseline for all other players.

use swarmbench_engine::{Act, Action, Observation, TaskName};

use crate::chance::Chance;
use crate::{BuiltIn, Player, Seat};

pub(crate) const PLAYER: BuiltIn = BuiltIn {
    name: "random",
    tasks: &TaskName::ALL,
    summary: "Picks any action, every one equally likely, and says nothing.",
    make,
};

#[derive(Clone)]
struct Random {
    chance: Chance,
    actions: &'static [Action],
}

fn make(seat: &Seat) -> Box<dyn Player> {
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
