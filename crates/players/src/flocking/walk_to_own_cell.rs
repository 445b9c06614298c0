//! Flocking by agents' numbers.

use swarmbench_engine::{Act, Action, Observation, Pos};

use super::outline::Outline;
use crate::{Player, Seat};

/// Every agent has a cell of its own on the outline in the middle of the map, by its number, and walks there:
/// rows first in even rounds and columns first in odd ones.
#[derive(Clone)]
struct WalkToOwnCell {
    goal: Option<Pos>,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    let outline = Outline::in_the_middle(seat);
    let number = usize::from(seat.agent.0) % outline.cells().len().max(1);
    Box::new(WalkToOwnCell { goal: outline.cells().nth(number) })
}

impl Player for WalkToOwnCell {
    fn decide(&mut self, observation: &Observation) -> Act {
        let (Some(here), Some(goal)) = (observation.position, self.goal) else {
            return Act::default();
        };
        let step = |from: i32, to: i32, back, forth| match from.cmp(&to) {
            std::cmp::Ordering::Less => Some(forth),
            std::cmp::Ordering::Equal => None,
            std::cmp::Ordering::Greater => Some(back),
        };
        let rows = step(here.i, goal.i, Action::Up, Action::Down);
        let columns = step(here.j, goal.j, Action::Left, Action::Right);
        let (first, second) =
            if observation.round.is_multiple_of(2) { (rows, columns) } else { (columns, rows) };
        Act::of(first.or(second).unwrap_or(Action::Stay))
    }
}
