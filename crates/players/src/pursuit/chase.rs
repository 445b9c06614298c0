//! Pursuit by chasing the prey: pure reaction, without memory and without messages.

use swarmbench_engine::{Act, Action, Direction, Observation, Pos, Seen, View};

use crate::chance::Chance;
use crate::chart::{push, sight};
use crate::{Player, Seat};

/// Steps toward a visible prey, stays if it stands beside it, and wanders otherwise.
#[derive(Clone)]
struct Chase {
    chance: Chance,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    Box::new(Chase { chance: Chance::new(seat) })
}

impl Player for Chase {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some((here, view)) = sight(observation) else { return Act::default() };
        let order = self.chance.order();
        let prey = find(view, Seen::Prey);
        let gap = |at: Pos| prey.map(|prey| at.i.abs_diff(prey.i) + at.j.abs_diff(prey.j));
        if gap(here) == Some(1) {
            return Act::of(Action::Stay);
        }
        let is_empty = |&way: &Direction| seen_at(view, here.toward(way)) == Some(Seen::Empty);
        let open: Vec<Direction> = order.into_iter().filter(is_empty).collect();
        // Ties go to the first step, so the agent wanders if no prey is in sight.
        let best = open.into_iter().min_by_key(|&way| gap(here.toward(way)));
        Act::of(best.map_or(Action::Stay, push))
    }
}

/// The first cell in view with this content.
fn find(view: &View, what: Seen) -> Option<Pos> {
    view.positions().find(|(_, seen)| *seen == what).map(|(at, _)| at)
}

/// The content of a cell; `None` outside the view.
fn seen_at(view: &View, at: Pos) -> Option<Seen> {
    let row = usize::try_from(at.i - view.origin.i).ok()?;
    let column =
        usize::try_from(at.j - view.origin.j).ok().filter(|&column| column < view.width)?;
    view.cells.get(row * view.width + column).copied()
}
