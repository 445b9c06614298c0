//! The outline of a square at a place that all agents know, and the steps that fill it.

use std::collections::BTreeSet;

use swarmbench_engine::tasks::flocking;
use swarmbench_engine::{Action, Direction, Pos, limits};

use crate::Seat;
use crate::chance::Chance;
use crate::chart::{Chart, push};

/// Number of rounds for which a cell counts as occupied after another agent was seen on it.
const TAKEN_ROUNDS: u32 = 8;

/// Detour in steps that an agent in the way is worth. An agent that is shut in pushes another one out of the outline
/// and takes its cell.
const CROWD: u32 = 5;

/// Distance in steps beyond which an agent walks straight toward a cell: a path search would be slow, and the agent
/// could not see others there anyway.
const FAR: i32 = 20;

/// The outline of the square that the swarm is to form, at some place.
#[derive(Clone)]
pub(super) struct Outline {
    /// All cells; a cell that no agent can reach is replaced by the nearest reachable one.
    cells: BTreeSet<Pos>,
    /// Twice the coordinates of the middle, which may lie between cells.
    middle: Pos,
    /// The first round in which agents in place move up while there are holes.
    turns_from: u32,
}

impl Outline {
    /// The outline around a place, moved onto the map.
    pub(super) fn around(seat: &Seat, place: Pos) -> Self {
        // The number of agents is clamped: a malformed seat would make a square that fits on no map.
        let most = u16::try_from(limits::FLOCKING_AGENTS_MAX).unwrap_or(u16::MAX);
        let cells = flocking::target(seat.num_agents.min(most));
        let side = cells.iter().map(|cell| cell.i + 1).max().unwrap_or(1);
        let (height, width) = (i32::from(seat.height), i32::from(seat.width));
        // A square that is too large for the map sticks out on both sides.
        let first = |middle: i32, size: i32| match size - 1 - side {
            room if room < 1 => (size - side).div_euclid(2),
            room => (middle - side / 2).min(room).max(1),
        };
        let corner = Pos::new(first(place.i, height), first(place.j, width));
        let inside = |at: i32, size: i32| at.min(size - 2).max(1);
        let onto_map = |cell: Pos| Pos::new(inside(cell.i, height), inside(cell.j, width));
        Self {
            cells: cells.into_iter().map(|cell| onto_map(cell.plus(corner))).collect(),
            middle: Pos::new(2 * corner.i + side - 1, 2 * corner.j + side - 1),
            turns_from: u32::from(seat.height) + u32::from(seat.width),
        }
    }

    /// The outline in the middle of the map.
    pub(super) fn in_the_middle(seat: &Seat) -> Self {
        Self::around(seat, Pos::new(i32::from(seat.height) / 2, i32::from(seat.width) / 2))
    }

    /// All cells in reading order.
    pub(super) fn cells(&self) -> impl ExactSizeIterator<Item = Pos> + '_ {
        self.cells.iter().copied()
    }

    /// An agent on the outline stays, all others walk to the nearest cell of it that seems free. Cells assigned by
    /// number would only send agents past each other.
    ///
    /// An agent that is not in place after the time that it takes to cross the map is shut in or out. The agents in
    /// place then move up, and the hole comes by.
    pub(super) fn fill(&self, chart: &Chart, chance: &mut Chance, here: Pos, round: u32) -> Action {
        let is_late = round >= self.turns_from;
        if self.cells.contains(&here) {
            let step = self.next(here).filter(|&(next, _)| is_late && self.is_hole(chart, next));
            return step.map_or(Action::Stay, |(_, side)| push(side));
        }
        let order = chance.order();
        if is_late {
            let is_beside = |side: &Direction| self.cells.contains(&here.toward(*side));
            let is_empty = |side: &Direction| !chart.is_taken(here.toward(*side), 1);
            if order.iter().any(is_beside) {
                let hole = order.into_iter().filter(is_beside).find(is_empty);
                return hole.map_or(Action::Stay, push);
            }
        }
        let is_free = |cell: Pos| self.cells.contains(&cell) && !chart.is_taken(cell, TAKEN_ROUNDS);
        let steps = |cell: &Pos| (cell.i - here.i).abs() + (cell.j - here.j).abs();
        let nearest = self.cells().filter(|&cell| is_free(cell)).min_by_key(steps);
        let step = match nearest {
            Some(goal) if steps(&goal) > FAR => {
                let is_closer = |side: &Direction| {
                    let next = here.toward(*side);
                    (goal.i - next.i).abs() + (goal.j - next.j).abs() < steps(&goal)
                };
                order.into_iter().find(is_closer)
            }
            Some(_) => chart.way(here, order, CROWD, is_free),
            None => None,
        };
        step.map_or(Action::Stay, push)
    }

    /// An empty cell of the outline that no agent out of place can enter now.
    fn is_hole(&self, chart: &Chart, cell: Pos) -> bool {
        let waits = |beside: Pos| chart.is_taken(beside, 1) && !self.cells.contains(&beside);
        !chart.is_taken(cell, 1) && !Direction::ALL.iter().any(|&side| waits(cell.toward(side)))
    }

    /// The next cell of the outline clockwise, and its direction.
    fn next(&self, cell: Pos) -> Option<(Pos, Direction)> {
        let from_middle =
            |cell: Pos| Pos::new(2 * cell.i - self.middle.i, 2 * cell.j - self.middle.j);
        let here = from_middle(cell);
        // Rows grow downward, so a clockwise turn is positive.
        let turn = |next: Pos| here.j * next.i - here.i * next.j;
        let mut sides = Direction::ALL.into_iter().map(|side| (cell.toward(side), side));
        sides.find(|(next, _)| self.cells.contains(next) && turn(from_middle(*next)) > 0)
    }
}
