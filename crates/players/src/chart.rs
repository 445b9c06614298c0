//! The chart: an agent's memory of the map, and path search on it.
//!
//! A chart of the largest map has 65,536 cells and a swarm has up to 1,024 charts, so a cell that was never
//! seen takes no memory, and a way is found in one pass over the cells.

use std::collections::VecDeque;

use swarmbench_engine::{Action, Direction, Observation, Pos, Seen, View, limits};

use crate::Seat;

/// Greatest distance of a waypoint in rows and columns; no cell of a standard map is farther.
const FAR: i32 = 8;

/// The last sighting of every cell of the map.
#[derive(Clone)]
pub(crate) struct Chart {
    height: i32,
    width: i32,
    /// A packed [`Glimpse`] for each cell, 0 for none: the system allocates zeroed pages only when they are written.
    cells: Vec<u64>,
    /// True if the map has a wall all around, seen or not.
    ring_closed: bool,
    /// The round of the last observation.
    now: u32,
}

/// A sighting: the content of a cell and the round in which it was seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Glimpse {
    seen: Seen,
    round: u32,
}

impl Glimpse {
    /// Packs the glimpse into a nonzero number: the content in the lower half, the round in the upper half.
    fn pack(self) -> u64 {
        u64::from(code(self.seen)) | u64::from(self.round) << 32
    }

    /// Unpacks a number; `None` for 0.
    fn unpack(packed: u64) -> Option<Self> {
        let [kind, marked, low, high, round @ ..] = packed.to_le_bytes();
        let seen = match kind {
            1 => Seen::Empty,
            2 => Seen::Yourself,
            3 => Seen::Agent { number: u16::from_le_bytes([low, high]), marked: marked == 1 },
            4 => Seen::Outside,
            5 => Seen::Wall,
            6 => Seen::Nest,
            7 => Seen::Food,
            8 => Seen::Block,
            9 => Seen::Prey,
            _ => return None,
        };
        Some(Self { seen, round: u32::from_le_bytes(round) })
    }
}

/// The kind of an agent in a packed glimpse.
const AGENT: u32 = 3;

/// The first kind that no agent can enter; no agent can enter any higher kind either.
const FIXED: u32 = 4;

/// Encodes a content as a nonzero number: the kind in the lowest byte, then the mark and the number of an agent.
const fn code(seen: Seen) -> u32 {
    match seen {
        Seen::Empty => 1,
        Seen::Yourself => 2,
        Seen::Agent { number, marked } => AGENT | (marked as u32) << 8 | (number as u32) << 16,
        Seen::Outside => FIXED,
        Seen::Wall => 5,
        Seen::Nest => 6,
        Seen::Food => 7,
        Seen::Block => 8,
        Seen::Prey => 9,
    }
}

/// The kind of a packed glimpse; 0 where there was none.
fn kind(packed: u64) -> u32 {
    u32::from(packed.to_le_bytes()[0])
}

impl Chart {
    /// A chart of an unknown map. The size is clamped to the limits of the rules, so a seat of an invalid size is
    /// harmless.
    pub(crate) fn new(seat: &Seat) -> Self {
        let most = i32::try_from(*limits::SIZE.end()).unwrap_or(i32::MAX);
        let (height, width) = (i32::from(seat.height).min(most), i32::from(seat.width).min(most));
        let area = usize::try_from(height * width).unwrap_or(0);
        Self { height, width, cells: vec![0; area], ring_closed: false, now: 0 }
    }

    /// Records everything in view and returns the agent's position. `None` if the agent has escaped or the observation
    /// is of another map: then the player does nothing.
    pub(crate) fn look(&mut self, observation: &Observation) -> Option<Pos> {
        let (here, view) = sight(observation).filter(|(here, _)| self.contains(*here))?;
        let Pos { i: top, j: left } = view.origin;
        self.now = observation.round;
        // Most of a large window may lie outside the map.
        let (above, before) = (usize::try_from(-top), usize::try_from(-left));
        let (above, before) = (above.unwrap_or(0), before.unwrap_or(0));
        let start = usize::try_from(left).unwrap_or(0);
        let round = u64::from(self.now) << 32;
        let (width, mine) = (self.row_length(), &mut self.cells);
        let mine = mine.chunks_exact_mut(width).skip(usize::try_from(top).unwrap_or(0));
        for (mine, row) in mine.zip(view.rows().skip(above)) {
            for (cell, &seen) in mine.iter_mut().skip(start).zip(row.iter().skip(before)) {
                *cell = u64::from(code(seen)) | round;
            }
        }
        Some(here)
    }

    /// Records that a wall surrounds the map.
    pub(crate) const fn close_ring(&mut self) {
        self.ring_closed = true;
    }

    /// Records a sighting from a message if the cell is unknown: the agent's own sightings take precedence.
    pub(crate) fn hear(&mut self, at: Pos, seen: Seen) {
        if self.is_unknown(at) {
            self.note(at, seen);
        }
    }

    pub(crate) fn contains(&self, at: Pos) -> bool {
        self.index(at).is_some()
    }

    /// True if the cell lies on the edge of the map, where the wall is.
    pub(crate) fn is_on_ring(&self, at: Pos) -> bool {
        let inside = (1..self.height - 1).contains(&at.i) && (1..self.width - 1).contains(&at.j);
        self.contains(at) && !inside
    }

    /// The cells on the edge of the map.
    pub(crate) fn ring(&self) -> impl Iterator<Item = Pos> + use<> {
        let (last_row, last_column) = (self.height - 1, self.width - 1);
        let rows = (0..=last_row).flat_map(move |i| [Pos::new(i, 0), Pos::new(i, last_column)]);
        let columns = (0..=last_column).flat_map(move |j| [Pos::new(0, j), Pos::new(last_row, j)]);
        rows.chain(columns)
    }

    /// The last known content of a cell; `None` if it is unknown.
    pub(crate) fn at(&self, at: Pos) -> Option<Seen> {
        self.glimpse(at).map(|glimpse| glimpse.seen)
    }

    /// True if the cell lies on the map and was never seen.
    pub(crate) fn is_unknown(&self, at: Pos) -> bool {
        self.contains(at) && self.glimpse(at).is_none()
    }

    /// True if another agent was seen on the cell within the last `rounds`, this one included.
    pub(crate) fn is_taken(&self, at: Pos, rounds: u32) -> bool {
        self.index(at).is_some_and(|index| self.is_crowded(self.cells[index], rounds))
    }

    /// An agent may enter an open cell. Unknown cells count as open.
    pub(crate) fn is_open(&self, at: Pos) -> bool {
        self.index(at).is_some_and(|index| !self.is_shut(at, self.cells[index]))
    }

    /// The first cell in reading order that was last seen to hold `what`.
    pub(crate) fn find(&self, what: Seen) -> Option<Pos> {
        let wanted = u64::from(code(what));
        let is_wanted = |&packed: &u64| packed & u64::from(u32::MAX) == wanted;
        let index = self.cells.iter().position(is_wanted)?;
        let (row, column) = (index / self.row_length(), index % self.row_length());
        Some(Pos::new(i32::try_from(row).ok()?, i32::try_from(column).ok()?))
    }

    /// The first step of a shortest way over open cells from `from` to a goal; `None` if there is no way or `from` is a
    /// goal itself. A cell with an agent on it counts as `crowd` steps more. Ties are broken by `order`.
    pub(crate) fn way(
        &self,
        from: Pos,
        order: [Direction; 4],
        crowd: u32,
        is_goal: impl Fn(Pos) -> bool,
    ) -> Option<Direction> {
        if is_goal(from) {
            return None;
        }
        let mut frontier = Frontier::default();
        let mut reached = vec![false; self.cells.len()];
        reached[self.index(from)?] = true;
        let mut next = Some(Reached { length: 0, age: 0, cell: from, first: None });
        while let Some(Reached { length, cell, first, .. }) = next {
            if is_goal(cell) {
                return first;
            }
            for direction in order {
                let beside = cell.toward(direction);
                let Some(index) = self.index(beside) else { continue };
                // The cost of a step depends only on the cell where it ends, so the first way found to a cell is a
                // shortest one.
                let packed = self.cells[index];
                if !reached[index] && !self.is_shut(beside, packed) {
                    reached[index] = true;
                    let more = if self.is_crowded(packed, 1) { crowd } else { 0 };
                    frontier.push(length, more, beside, first.or(Some(direction)));
                }
            }
            next = frontier.pop();
        }
        None
    }

    fn note(&mut self, at: Pos, seen: Seen) {
        if let Some(index) = self.index(at) {
            self.cells[index] = Glimpse { seen, round: self.now }.pack();
        }
    }

    fn glimpse(&self, at: Pos) -> Option<Glimpse> {
        let glimpse = Glimpse::unpack(self.cells[self.index(at)?]);
        let ring = || Glimpse { seen: Seen::Wall, round: 0 };
        glimpse.or_else(|| (self.ring_closed && self.is_on_ring(at)).then(ring))
    }

    /// True if the packed glimpse of a cell shows that no agent can enter it.
    fn is_shut(&self, at: Pos, packed: u64) -> bool {
        kind(packed) >= FIXED || packed == 0 && self.ring_closed && self.is_on_ring(at)
    }

    /// True if the packed glimpse shows an agent within the last `rounds`.
    fn is_crowded(&self, packed: u64, rounds: u32) -> bool {
        let round = u32::try_from(packed >> 32).unwrap_or(0);
        kind(packed) == AGENT && self.now.saturating_sub(round) < rounds
    }

    /// The number of columns, and 1 where there are none.
    fn row_length(&self) -> usize {
        usize::try_from(self.width).unwrap_or(0).max(1)
    }

    fn index(&self, at: Pos) -> Option<usize> {
        let on_map = (0..self.height).contains(&at.i) && (0..self.width).contains(&at.j);
        if on_map { usize::try_from(at.i * self.width + at.j).ok() } else { None }
    }
}

/// The frontier of a search, nearest cells first. A step has one of two costs, so two queues keep the order.
#[derive(Default)]
struct Frontier {
    plain: VecDeque<Reached>,
    crowded: VecDeque<Reached>,
    age: u32,
}

/// A reached cell: its distance, when it was reached, and the first step of the way to it.
struct Reached {
    length: u32,
    age: u32,
    cell: Pos,
    first: Option<Direction>,
}

impl Frontier {
    /// Adds a cell that is one step and `more` away from a cell at `length`. `length` must not decrease from call to
    /// call.
    fn push(&mut self, length: u32, more: u32, cell: Pos, first: Option<Direction>) {
        self.age += 1;
        let queue = if more == 0 { &mut self.plain } else { &mut self.crowded };
        let length = length.saturating_add(more).saturating_add(1);
        queue.push_back(Reached { length, age: self.age, cell, first });
    }

    /// Removes the nearest cell; of equally near cells, the one that was reached first.
    fn pop(&mut self) -> Option<Reached> {
        // Usually no agent is in the way, and a search of the largest map takes this step 65,536 times.
        if self.crowded.is_empty() {
            return self.plain.pop_front();
        }
        let rank = |queue: &VecDeque<Reached>| queue.front().map(|cell| (cell.length, cell.age));
        match (rank(&self.plain), rank(&self.crowded)) {
            (Some(plain), Some(crowded)) if crowded < plain => self.crowded.pop_front(),
            (None, _) => self.crowded.pop_front(),
            _ => self.plain.pop_front(),
        }
    }
}

/// The agent's position and view; `None` if it has escaped or lies outside any map.
pub(crate) fn sight(observation: &Observation) -> Option<(Pos, &View)> {
    let (here, view) = (observation.position?, observation.view.as_ref()?);
    let near = -i32::from(u16::MAX)..=i32::from(u16::MAX);
    let numbers = [here.i, here.j, view.origin.i, view.origin.j];
    numbers.iter().all(|number| near.contains(number)).then_some((here, view))
}

/// All cells of a view within `reach` rows and columns of `middle`. A window over a large map has many more.
pub(crate) fn within(
    view: &View,
    middle: Pos,
    reach: i32,
) -> impl Iterator<Item = (Pos, Seen)> + '_ {
    // The number of cells before the first one, and the number of cells from there on.
    let cut = move |middle: i32, origin: i32| {
        let first = i64::from(middle) - i64::from(reach);
        let before = (first - i64::from(origin)).max(0);
        let end = i64::from(middle) + i64::from(reach) + 1;
        let count = (end - first.max(i64::from(origin))).max(0);
        [before, count].map(|cells| usize::try_from(cells).unwrap_or(usize::MAX))
    };
    let ([above, rows], [before, columns]) =
        (cut(middle.i, view.origin.i), cut(middle.j, view.origin.j));
    view.rows().zip(view.origin.i..).skip(above).take(rows).flat_map(move |(row, i)| {
        let cells = row.iter().zip(view.origin.j..).skip(before).take(columns);
        cells.map(move |(&seen, j)| (Pos::new(i, j), seen))
    })
}

/// A cell toward a goal, near enough for a fast path search.
pub(crate) fn waypoint(from: Pos, goal: Pos) -> Pos {
    let near = |from: i32, goal: i32| from + (goal - from).clamp(-FAR, FAR);
    Pos::new(near(from.i, goal.i), near(from.j, goal.j))
}

/// The action that moves in a direction.
pub(crate) const fn push(direction: Direction) -> Action {
    match direction {
        Direction::Up => Action::Up,
        Direction::Down => Action::Down,
        Direction::Left => Action::Left,
        Direction::Right => Action::Right,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_near_a_cell_is_cut_out_of_a_view() {
        for (height, width) in [(1, 1), (3, 7), (9, 4), (12, 12)] {
            for origin in [Pos::new(-3, -2), Pos::new(0, 0), Pos::new(5, 2)] {
                let cells = (0..height * width)
                    .map(|cell| Seen::Agent { number: cell, marked: false })
                    .collect();
                let (height, width) = (usize::from(height), usize::from(width));
                let view = View { origin, height, width, cells };
                for middle in [Pos::new(0, 0), Pos::new(4, 4), Pos::new(6, 3), Pos::new(40, 1)] {
                    for reach in [0, 1, 2, 20] {
                        let near = |(cell, _): &(Pos, Seen)| middle.is_within(reach, *cell);
                        let all: Vec<_> = view.positions().filter(near).collect();
                        let cut: Vec<_> = within(&view, middle, reach).collect();
                        assert_eq!(
                            cut, all,
                            "{height}x{width} at {origin:?}: {middle:?} ± {reach}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_packed_comes_out_again() {
        let agent = |number, marked| Seen::Agent { number, marked };
        let all = [
            (Seen::Empty, true),
            (Seen::Yourself, true),
            (agent(0, false), true),
            (agent(u16::MAX, true), true),
            (Seen::Outside, false),
            (Seen::Wall, false),
            (Seen::Nest, false),
            (Seen::Food, false),
            (Seen::Block, false),
            (Seen::Prey, false),
        ];
        for (seen, is_open) in all {
            for round in [0, 1, u32::MAX] {
                let glimpse = Glimpse { seen, round };
                assert_eq!(Glimpse::unpack(glimpse.pack()), Some(glimpse));
                assert_eq!(kind(glimpse.pack()) < FIXED, is_open, "{seen:?}");
            }
        }
        assert_eq!(Glimpse::unpack(0), None);
    }
}
