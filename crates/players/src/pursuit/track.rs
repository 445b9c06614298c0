//! Pursuit by memory: no messages, but every agent remembers where the prey was.

use swarmbench_engine::{Act, Action, Direction, Observation, Pos, Seen, View};

use crate::chance::Chance;
use crate::chart::{Chart, push, waypoint};
use crate::walk::toward;
use crate::{Player, Seat};

/// Number of rounds for which a sighting counts. The prey takes two steps a round but often comes back, because the
/// reason that drew it there remains.
const FRESH_ROUNDS: u32 = 4;

/// Detour in steps that an agent in the way is worth.
const CROWD: u32 = 4;

/// Walks to the nearest free cell beside the last sighting of the prey. If that is long ago, walks from one random
/// place of the map to another until it sees the prey again.
#[derive(Clone)]
struct Track {
    chance: Chance,
    chart: Chart,
    /// The place and the round of the last sighting of the prey.
    prey: Option<(Pos, u32)>,
    /// The destination while the prey's place is unknown.
    errand: Pos,
    /// Rows and columns of the map.
    size: (u16, u16),
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    let mut chart = Chart::new(seat);
    chart.close_ring();
    Box::new(Track {
        chance: Chance::new(seat),
        chart,
        prey: None,
        errand: Pos::new(0, 0),
        size: (seat.height, seat.width),
    })
}

impl Player for Track {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some(here) = self.chart.look(observation) else { return Act::default() };
        let seen = observation.view.iter().flat_map(View::positions);
        for (at, _) in seen.filter(|(_, seen)| *seen == Seen::Prey) {
            self.prey = Some((at, observation.round));
        }
        let is_fresh = |seen: u32| observation.round.saturating_sub(seen) <= FRESH_ROUNDS;
        self.prey = self.prey.filter(|(_, seen)| is_fresh(*seen));
        let order = self.chance.order();
        let way = if let Some((prey, _)) = self.prey {
            let beside = Direction::ALL.map(|side| prey.toward(side));
            let is_goal = |cell: Pos| beside.contains(&cell) && !self.chart.is_taken(cell, 1);
            if is_goal(here) {
                return Act::of(Action::Stay);
            }
            // If all are occupied no search is needed.
            let is_free = beside.into_iter().any(is_goal);
            is_free.then(|| toward(&self.chart, here, prey, order, CROWD, is_goal)).flatten()
        } else {
            if here.is_within(1, self.errand) || !self.chart.is_open(self.errand) {
                self.errand = self.draw_errand(here);
            }
            self.chart.way(here, order, CROWD, |cell| cell == self.errand)
        };
        Act::of(push(way.unwrap_or(order[0])))
    }
}

impl Track {
    /// A random cell inside the wall, or one on the way there.
    fn draw_errand(&mut self, here: Pos) -> Pos {
        let mut draw = |cells: u16| {
            let inside: Vec<i32> = (1..i32::from(cells.clamp(3, 256)) - 1).collect();
            self.chance.pick(&inside)
        };
        waypoint(here, Pos::new(draw(self.size.0), draw(self.size.1)))
    }
}
