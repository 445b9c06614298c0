//! Foraging by reaction to the current view.

use swarmbench_engine::{Act, Action, Observation, Seen};

use crate::chance::Chance;
use crate::chart::sight;
use crate::{Player, Seat};

/// Steps toward the nearest visible food when empty, and toward the nearest visible nest when loaded; otherwise at
/// random.
#[derive(Clone)]
struct WanderAndCarry {
    chance: Chance,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    Box::new(WanderAndCarry { chance: Chance::new(seat) })
}

impl Player for WanderAndCarry {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some((here, view)) = sight(observation) else { return Act::default() };
        let loaded = observation.carrying_food == Some(true);
        let wanted = if loaded { Seen::Nest } else { Seen::Food };
        let apart = |to: i32, from: i32| i64::from(to) - i64::from(from);
        let goals = view.positions().filter(|&(_, seen)| seen == wanted);
        let ways = goals.map(|(at, _)| (apart(at.i, here.i), apart(at.j, here.j)));
        let action = match ways.min_by_key(|(below, right)| below.abs() + right.abs()) {
            None => self.chance.pick(&[Action::Up, Action::Down, Action::Left, Action::Right]),
            Some((below, right)) if below.abs() >= right.abs() => {
                if below > 0 {
                    Action::Down
                } else {
                    Action::Up
                }
            }
            Some((_, right)) => {
                if right > 0 {
                    Action::Right
                } else {
                    Action::Left
                }
            }
        };
        Act::of(action)
    }
}
