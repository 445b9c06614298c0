//! Flocking by looking at others.

use swarmbench_engine::{Act, Action, Observation, Seen};

use crate::chance::Chance;
use crate::chart::sight;
use crate::{Player, Seat};

/// Steps toward the middle of the agents in view, and at random if it sees none or stands there.
#[derive(Clone)]
struct DriftTogether {
    chance: Chance,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    Box::new(DriftTogether { chance: Chance::new(seat) })
}

impl Player for DriftTogether {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some((here, view)) = sight(observation) else { return Act::default() };
        let others = view.positions().filter(|(_, seen)| matches!(seen, Seen::Agent { .. }));
        // The summed distances of the others, downward and to the right.
        let (below, right) = others.fold((0_i64, 0_i64), |(below, right), (at, _)| {
            let apart = |to: i32, from: i32| i64::from(to) - i64::from(from);
            (below + apart(at.i, here.i), right + apart(at.j, here.j))
        });
        Act::of(if below == 0 && right == 0 {
            self.chance.pick(&[Action::Up, Action::Down, Action::Left, Action::Right])
        } else if below.abs() >= right.abs() {
            if below > 0 { Action::Down } else { Action::Up }
        } else if right > 0 {
            Action::Right
        } else {
            Action::Left
        })
    }
}
