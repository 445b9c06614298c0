//! What an agent has learned about the map, and the way across it.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use swarmbench_engine::{Action, Direction, Observation, Pos, Seen, View, limits};

use crate::Seat;

/// What was last seen on every cell of the map.
pub(crate) struct Chart {
    height: i32,
    width: i32,
    cells: Vec<Option<Glimpse>>,
    /// The round of the last observation.
    now: u32,
}

/// What a cell held, and in which round.
#[derive(Clone, Copy)]
struct Glimpse {
    seen: Seen,
    round: u32,
}

impl Chart {
    /// A chart of an unknown map. Its size is limited, so that a seat of a strange size is harmless.
    pub(crate) fn new(seat: &Seat) -> Self {
        let most = i32::try_from(*limits::SIZE.end()).unwrap_or(i32::MAX);
        let (height, width) = (i32::from(seat.height).min(most), i32::from(seat.width).min(most));
        let area = usize::try_from(height * width).unwrap_or(0);
        Self { height, width, cells: vec![None; area], now: 0 }
    }

    /// Notes everything in view. Returns where the agent stands: none where it has escaped or where
    /// the observation is of another map, and then there is nothing for it to do.
    pub(crate) fn look(&mut self, observation: &Observation) -> Option<Pos> {
        let (here, view) = sights(observation).filter(|(here, _)| self.contains(*here))?;
        self.now = observation.round;
        for (at, seen) in view.positions() {
            self.note(at, seen);
        }
        Some(here)
    }

    /// Notes that there is a wall all around the map.
    pub(crate) fn close_ring(&mut self) {
        for cell in self.positions() {
            if self.is_on_ring(cell) {
                self.note(cell, Seen::Wall);
            }
        }
    }

    /// Notes what somebody told; what was seen with own eyes counts more.
    pub(crate) fn hear(&mut self, at: Pos, seen: Seen) {
        if self.is_unknown(at) {
            self.note(at, seen);
        }
    }

    /// Whether the cell lies on the map.
    pub(crate) fn contains(&self, at: Pos) -> bool {
        self.index(at).is_some()
    }

    /// Whether the cell lies on the edge of the map, where the wall is.
    pub(crate) fn is_on_ring(&self, at: Pos) -> bool {
        let inside = (1..self.height - 1).contains(&at.i) && (1..self.width - 1).contains(&at.j);
        self.contains(at) && !inside
    }

    /// What was last seen on a cell of the map; none where it is unknown.
    pub(crate) fn at(&self, at: Pos) -> Option<Seen> {
        self.glimpse(at).map(|glimpse| glimpse.seen)
    }

    /// Whether the cell lies on the map and was never seen.
    pub(crate) fn is_unknown(&self, at: Pos) -> bool {
        self.contains(at) && self.glimpse(at).is_none()
    }

    /// Whether another agent was seen on the cell within the last `rounds`, this one included.
    pub(crate) fn is_taken(&self, at: Pos, rounds: u32) -> bool {
        self.glimpse(at).is_some_and(|glimpse| {
            matches!(glimpse.seen, Seen::Agent { .. })
                && self.now.saturating_sub(glimpse.round) < rounds
        })
    }

    /// Whether an agent may enter the cell. The unknown is worth a try.
    pub(crate) fn is_open(&self, at: Pos) -> bool {
        self.contains(at) && !self.at(at).is_some_and(is_fixed)
    }

    /// The first cell in reading order that was last seen to hold `what`.
    pub(crate) fn find(&self, what: Seen) -> Option<Pos> {
        self.positions().find(|&cell| self.at(cell) == Some(what))
    }

    /// The first step of a shortest way over open cells from `from` to a goal; none where there is no
    /// way or `from` is a goal itself. A cell with an agent on it counts as `crowd` steps more. Of
    /// equally short ways it takes one whose first step comes early in `order`.
    pub(crate) fn way(
        &self,
        from: Pos,
        order: [Direction; 4],
        crowd: u32,
        is_goal: impl Fn(Pos) -> bool,
    ) -> Option<Direction> {
        let mut settled = vec![false; self.cells.len()];
        // Cells by the length so far, then by age, each with the number of the way's first step.
        let mut open = BinaryHeap::from([Reverse((0, 0, from, None::<usize>))]);
        let mut age = 0_u32;
        while let Some(Reverse((length, _, cell, first))) = open.pop() {
            if is_goal(cell) {
                return first.map(|number| order[number]);
            }
            if std::mem::replace(&mut settled[self.index(cell)?], true) {
                continue;
            }
            for (number, &direction) in order.iter().enumerate() {
                let next = cell.toward(direction);
                if self.is_open(next) && self.index(next).is_some_and(|index| !settled[index]) {
                    age += 1;
                    let step = if self.is_taken(next, 1) { 1 + crowd } else { 1 };
                    open.push(Reverse((length + step, age, next, first.or(Some(number)))));
                }
            }
        }
        None
    }

    /// All cells of the map in reading order.
    fn positions(&self) -> impl Iterator<Item = Pos> + use<> {
        let (height, width) = (self.height, self.width);
        (0..height).flat_map(move |i| (0..width).map(move |j| Pos::new(i, j)))
    }

    fn note(&mut self, at: Pos, seen: Seen) {
        if let Some(index) = self.index(at) {
            self.cells[index] = Some(Glimpse { seen, round: self.now });
        }
    }

    fn glimpse(&self, at: Pos) -> Option<Glimpse> {
        self.cells[self.index(at)?]
    }

    fn index(&self, at: Pos) -> Option<usize> {
        let on_map = (0..self.height).contains(&at.i) && (0..self.width).contains(&at.j);
        if on_map { usize::try_from(at.i * self.width + at.j).ok() } else { None }
    }
}

/// Where the agent stands and what it sees; none where it has escaped or where the numbers are beyond any
/// map, with which nobody should have to count.
pub(crate) fn sights(observation: &Observation) -> Option<(Pos, &View)> {
    let (here, view) = (observation.position?, observation.view.as_ref()?);
    let near = -i32::from(u16::MAX)..=i32::from(u16::MAX);
    let is_near = |at: Pos| near.contains(&at.i) && near.contains(&at.j);
    (is_near(here) && is_near(view.origin)).then_some((here, view))
}

/// The action that goes in a direction.
pub(crate) const fn push(direction: Direction) -> Action {
    match direction {
        Direction::Up => Action::Up,
        Direction::Down => Action::Down,
        Direction::Left => Action::Left,
        Direction::Right => Action::Right,
    }
}

/// Whether no agent can enter a cell that holds this.
fn is_fixed(seen: Seen) -> bool {
    match seen {
        Seen::Wall | Seen::Nest | Seen::Food | Seen::Block | Seen::Prey | Seen::Outside => true,
        Seen::Empty | Seen::Yourself | Seen::Agent { .. } => false,
    }
}
