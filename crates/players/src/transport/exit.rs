//! The position of the gap, and of the block before it.
//!
//! The block always lies the same way up to turning and mirroring: its foot stands in the gap of the wall, the rest of
//! it is caught behind the end of the gap. It has to move one cell along the open side, toward the corner, and then
//! straight out. Drawn with the open side below and the corner to the right:
//!
//! ```text
//! W . . . . . . . . W   4
//! W . . . . B B B . W   3
//! W . . . . B B B . W   2   deep
//! W . . . . B B B . W   1
//! W W W W W W B B B B   0
//! 9 8 7 6 5 4 3 2 1 0
//!               far
//! ```
//!
//! Each push needs five agents behind the block, side by side or behind each other.

use swarmbench_engine::{Direction, Pos, Seen, View, limits};

use crate::Seat;

/// Number of pushes until nothing of the block is left on the map: one along, the others out.
pub(super) const PUSHES: u32 = 5;

/// Distance from a corner within which layouts differ, in rows and columns: the extent of the block, and one more.
const NEAR: i32 = 6;

/// A possible position of the gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Exit {
    /// The corner of the map in which the gap ends.
    pub(super) corner: Pos,
    /// The direction out through the gap.
    pub(super) out: Direction,
    /// The direction along the open side toward the corner.
    pub(super) along: Direction,
}

/// A cell in the coordinates of an exit: depth inside the open side, and distance from the corner along it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ExitCell {
    pub(super) deep: i32,
    pub(super) far: i32,
}

impl Exit {
    /// All eight exits, always in the same order: either side of each corner may be the open one.
    pub(super) fn all(seat: &Seat) -> [Self; 8] {
        let most = i32::try_from(*limits::SIZE.end()).unwrap_or(i32::MAX);
        let last = |cells: u16| i32::from(cells).min(most) - 1;
        let (low, right) = (last(seat.height), last(seat.width));
        let rows = [(0, Direction::Up), (low, Direction::Down)];
        let columns = [(0, Direction::Left), (right, Direction::Right)];
        std::array::from_fn(|number| {
            let ((i, vertical), (j, horizontal)) = (rows[number / 4], columns[number / 2 % 2]);
            let (out, along) =
                if number % 2 == 0 { (vertical, horizontal) } else { (horizontal, vertical) };
            Self { corner: Pos::new(i, j), out, along }
        })
    }

    /// Converts a cell to the coordinates of this exit.
    pub(super) const fn place(&self, cell: Pos) -> ExitCell {
        let by = Pos::new(self.corner.i - cell.i, self.corner.j - cell.j);
        ExitCell { deep: dot(self.out, by), far: dot(self.along, by) }
    }

    /// Converts coordinates of this exit to a cell.
    pub(super) const fn cell(&self, place: ExitCell) -> Pos {
        let ((out_i, out_j), (along_i, along_j)) = (self.out.offset(), self.along.offset());
        let i = self.corner.i - out_i * place.deep - along_i * place.far;
        Pos::new(i, self.corner.j - out_j * place.deep - along_j * place.far)
    }

    /// The cells of the block before the first push.
    pub(super) fn block(self) -> impl Iterator<Item = Pos> {
        let places = (0..=3).flat_map(|deep| (0..=4).map(move |far| ExitCell { deep, far }));
        places.filter(|place| is_block(*place, 0)).map(move |place| self.cell(place))
    }

    /// True if pushes along come before pushes out in the same round.
    pub(super) fn goes_along_first(&self) -> bool {
        let turn = |direction| Direction::ALL.iter().position(|&one| one == direction);
        turn(self.along) < turn(self.out)
    }

    /// True if this exit explains everything in view, after `pushes` pushes of the block. Cells far from the corners
    /// are the same for all exits.
    pub(super) fn explains(&self, sight: &Sight<'_>, pushes: u32) -> bool {
        sight.cells.iter().all(|&(cell, seen, on_ring)| {
            let place = self.place(cell);
            let is_gap = place.deep == 0 && (0..=3).contains(&place.far);
            match seen {
                Seen::Block => is_block(place, pushes),
                Seen::Wall => on_ring && !is_gap,
                _ => !is_block(place, pushes) && (is_gap || !on_ring),
            }
        })
    }
}

/// The part of a view that lies near the corners of the map.
pub(super) struct Sight<'a> {
    cells: Vec<(Pos, Seen, bool)>,
    view: &'a View,
}

impl<'a> Sight<'a> {
    /// The corners of the seat's map, as far as they are in view.
    pub(super) fn of(view: &'a View, seat: &Seat) -> Self {
        let [first, .., last] = Exit::all(seat);
        let mut sight = Self { cells: Vec::new(), view };
        let near = |last: i32| {
            let end = (NEAR + 1).min(last + 1);
            (0..end).chain((last - NEAR).max(end)..=last)
        };
        for i in near(last.corner.i) {
            for j in near(last.corner.j) {
                let cell = Pos::new(i, j);
                let on_ring =
                    i == first.corner.i || j == 0 || i == last.corner.i || j == last.corner.j;
                if let Some(seen) = sight.at(cell).filter(|&seen| seen != Seen::Outside) {
                    sight.cells.push((cell, seen, on_ring));
                }
            }
        }
        sight
    }

    /// The content of a cell; `None` outside the view.
    pub(super) fn at(&self, cell: Pos) -> Option<Seen> {
        let part = |at: i32, from: i32| usize::try_from(i64::from(at) - i64::from(from)).ok();
        let (row, column) = (part(cell.i, self.view.origin.i)?, part(cell.j, self.view.origin.j)?);
        if column >= self.view.width || row >= self.view.height {
            return None;
        }
        self.view.cells.get(row * self.view.width + column).copied()
    }
}

/// True if the block covers a place after `pushes` pushes, the first along and the others out.
pub(super) fn is_block(place: ExitCell, pushes: u32) -> bool {
    let along = i32::from(pushes > 0);
    let out = i32::try_from(pushes.saturating_sub(1)).unwrap_or(0);
    match place.deep + out {
        0 => (0..=3).contains(&(place.far + along)),
        1..=3 => (2..=4).contains(&(place.far + along)),
        _ => false,
    }
}

/// Length of a vector in a direction.
const fn dot(direction: Direction, by: Pos) -> i32 {
    let (i, j) = direction.offset();
    by.i * i + by.j * j
}
