//! Flocking around the middle of the map.

use std::collections::BTreeSet;

use swarmbench_engine::tasks::flocking;
use swarmbench_engine::{Act, Action, Observation, Pos, limits};

use crate::chance::Chance;
use crate::chart::{Chart, push};
use crate::{Player, Seat};

/// For how many rounds a cell counts as taken after another agent was seen on it.
const TAKEN_ROUNDS: u32 = 8;

/// How many steps of detour one agent in the way is worth. Whoever is shut in pushes one of the
/// others out of the outline and takes its cell.
const CROWD: u32 = 5;

/// Everybody knows the square and the size of the map, so all agree without a word that the outline
/// lies in the middle. Whoever stands on it stays, everybody else walks to the nearest cell of it
/// that seems free: a cell of one's own by number would only send agents past each other.
struct MeetInTheMiddle {
    chance: Chance,
    chart: Chart,
    outline: BTreeSet<Pos>,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    let (chance, chart) = (Chance::new(seat), Chart::new(seat));
    let outline = outline(seat, &chart);
    Box::new(MeetInTheMiddle { chance, chart, outline })
}

/// The cells of the outline in the middle of the map; only those on which an agent can stand.
fn outline(seat: &Seat, chart: &Chart) -> BTreeSet<Pos> {
    // More agents than any game has would only make a square that no map holds.
    let most = u16::try_from(limits::FLOCKING_AGENTS_MAX).unwrap_or(u16::MAX);
    let cells = flocking::target(seat.num_agents.min(most));
    let side = cells.iter().map(|cell| cell.i + 1).max().unwrap_or(1);
    let start = |cells: u16| (i32::from(cells) - side) / 2;
    let corner = Pos::new(start(seat.height), start(seat.width));
    let is_inside = |cell: &Pos| chart.contains(*cell) && !chart.is_on_ring(*cell);
    cells.into_iter().map(|cell| cell.plus(corner)).filter(is_inside).collect()
}

impl Player for MeetInTheMiddle {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some(here) = self.chart.look(observation) else { return Act::default() };
        if self.outline.contains(&here) {
            return Act::of(Action::Stay);
        }
        let order = self.chance.order();
        let is_free =
            |cell: Pos| self.outline.contains(&cell) && !self.chart.is_taken(cell, TAKEN_ROUNDS);
        Act::of(self.chart.way(here, order, CROWD, is_free).map_or(Action::Stay, push))
    }
}
