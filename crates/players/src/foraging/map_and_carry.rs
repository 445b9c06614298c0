//! Foraging by a remembered map.

use swarmbench_engine::{Act, Action, Direction, Message, Observation, Pos, Seen};

use crate::chance::Chance;
use crate::chart::{Chart, push};
use crate::talk::heard;
use crate::{Player, Seat};

/// Detour in steps that an agent in the way is worth. At the standard setting the score falls by almost half as this
/// grows to 8: agents that walk around a jam make it wider.
const CROWD: u32 = 1;

/// Mean number of rounds before a stuck agent steps aside.
const PATIENCE_ROUNDS: u32 = 3;

/// Draws a map of all it sees, explores until it knows where to go, then walks to the food when it is empty and to the
/// nest when it is loaded. It may send the places of both.
#[derive(Clone)]
struct MapAndCarry {
    chance: Chance,
    chart: Chart,
    /// Position in the previous round.
    before: Option<Pos>,
    talks: bool,
}

/// Makes the player that sends its knowledge.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    player(seat, true)
}

/// Makes the player that sends nothing.
pub(crate) fn make_silent(seat: &Seat) -> Box<dyn Player> {
    player(seat, false)
}

fn player(seat: &Seat, talks: bool) -> Box<dyn Player> {
    let mut chart = Chart::new(seat);
    chart.close_ring();
    Box::new(MapAndCarry { chance: Chance::new(seat), chart, before: None, talks })
}

impl Player for MapAndCarry {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some(here) = self.chart.look(observation) else { return Act::default() };
        if self.talks {
            for (words, seen) in [("Food at", Seen::Food), ("Nest at", Seen::Nest)] {
                for [i, j] in heard(observation, words) {
                    self.chart.hear(Pos::new(i, j), seen);
                }
            }
        }
        let loaded = observation.carrying_food == Some(true);
        let is_stuck = self.before.replace(here) == Some(here);
        let action = self.walk(here, if loaded { Seen::Nest } else { Seen::Food }, is_stuck);
        let message = if self.talks { self.news(observation.round) } else { None };
        Act { action: Some(action), message, to: None }
    }
}

impl MapAndCarry {
    /// Tells where the food is in even rounds and where the nest is in odd ones, if it is known.
    fn news(&self, round: u32) -> Option<Message> {
        let (words, seen) = match round % 2 {
            0 => ("Food at", Seen::Food),
            _ => ("Nest at", Seen::Nest),
        };
        let at = self.chart.find(seen)?;
        Message::new(&format!("{words} {} {}", at.i, at.j))
    }

    /// The next step toward the wanted content, or toward unknown cells while its place is unknown.
    fn walk(&mut self, here: Pos, wanted: Seen, is_stuck: bool) -> Action {
        let order = self.chance.order();
        let chart = &self.chart;
        // Two agents that want to pass each other get on only if one gives way. Both see the same, so chance decides
        // which.
        if is_stuck && self.chance.one_in(PATIENCE_ROUNDS) {
            let is_free = |cell| chart.is_open(cell) && !chart.is_taken(cell, 1);
            let aside = order.into_iter().find(|&side| is_free(here.toward(side)));
            return aside.map_or(Action::Stay, push);
        }
        let step = if let Some(found) = chart.find(wanted) {
            let beside = |cell: Pos| Direction::ALL.map(|side| chart.at(cell.toward(side)));
            // Food and nest are two cells wide. The distance is checked first: on a large map looking around every cell
            // is slow.
            let is_goal =
                |cell: Pos| cell.is_within(2, found) && beside(cell).contains(&Some(wanted));
            chart.way(here, order, CROWD, is_goal)
        } else {
            chart.way(here, order, CROWD, |cell| chart.is_unknown(cell))
        };
        push(step.unwrap_or(order[0]))
    }
}
