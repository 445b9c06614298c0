//! Transport by reaction alone.

use swarmbench_engine::{Act, Action, Direction, Observation, Pos, Seen};

use crate::chance::Chance;
use crate::chart::{Chart, push};
use crate::walk::toward;
use crate::{Player, Seat};

/// Mean number of rounds between moves in a random direction instead of by the rule.
const WHIM_ROUNDS: u32 = 8;

/// Uses only the current view: leaves if it stands in the gap or beside it, goes to a visible block and pushes it, and
/// wanders if it sees neither.
#[derive(Clone)]
struct PushAhead {
    chance: Chance,
    seat: Seat,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    Box::new(PushAhead { chance: Chance::new(seat), seat: seat.clone() })
}

impl Player for PushAhead {
    fn decide(&mut self, observation: &Observation) -> Act {
        let mut chart = Chart::new(&self.seat);
        let Some(here) = chart.look(observation) else { return Act::default() };
        let order = self.chance.order();
        if self.chance.one_in(WHIM_ROUNDS) {
            return Act::of(push(order[0]));
        }
        Act::of(react(&chart, here, order))
    }
}

/// The action that the rule gives for the current view.
fn react(chart: &Chart, here: Pos, order: [Direction; 4]) -> Action {
    // The edge of the map has a wall everywhere but in the gap.
    let out = order.into_iter().find(|&direction| !chart.contains(here.toward(direction)));
    if let Some(out) = out {
        return push(out);
    }
    let is_block = |cell: Pos| chart.at(cell) == Some(Seen::Block);
    let gap = |cell: Pos| chart.is_on_ring(cell) && chart.is_open(cell) && !chart.is_unknown(cell);
    let beside = |cell: Pos| Direction::ALL.into_iter().find(|&side| is_block(cell.toward(side)));
    let walk = |target: Pos, is_goal: &dyn Fn(Pos) -> bool| {
        toward(chart, here, target, order, 1, |cell| !chart.is_unknown(cell) && is_goal(cell))
    };
    let to_gap = chart.ring().find(|&cell| gap(cell)).and_then(|target| walk(target, &gap));
    let to_block = || walk(chart.find(Seen::Block)?, &|cell| beside(cell).is_some());
    let step = to_gap.or_else(|| beside(here)).or_else(to_block);
    push(step.unwrap_or(order[0]))
}
