//! Cells, positions and directions, and the grid that maps cells to bodies.

use std::sync::Arc;

/// The number of a body on its board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct BodyId(pub(crate) u16);

impl BodyId {
    /// The index of the body in its board's list.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

/// A cell by row and column: `i` grows downward, `j` to the right. May lie outside the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Pos {
    /// The row.
    pub i: i32,
    /// The column.
    pub j: i32,
}

impl Pos {
    /// The cell in row `i` and column `j`.
    #[must_use]
    pub const fn new(i: i32, j: i32) -> Self {
        Self { i, j }
    }

    /// The neighbouring cell in `direction`.
    #[must_use]
    pub const fn toward(self, direction: Direction) -> Self {
        let (di, dj) = direction.offset();
        Self::new(self.i + di, self.j + dj)
    }

    /// This cell moved by the vector `by`.
    #[must_use]
    pub const fn plus(self, by: Pos) -> Self {
        Self::new(self.i + by.i, self.j + by.j)
    }

    /// True if the other cell lies within `reach` rows and `reach` columns.
    #[must_use]
    pub const fn is_within(self, reach: i32, other: Pos) -> bool {
        (self.i - other.i).abs() <= reach && (self.j - other.j).abs() <= reach
    }
}

/// One of the four directions of movement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// One row up (`i - 1`).
    Up,
    /// One row down (`i + 1`).
    Down,
    /// One column to the left (`j - 1`).
    Left,
    /// One column to the right (`j + 1`).
    Right,
}

impl Direction {
    /// All directions in the order in which physics resolves them.
    pub const ALL: [Self; 4] = [Self::Up, Self::Down, Self::Left, Self::Right];

    /// The step as (rows, columns).
    #[must_use]
    pub const fn offset(self) -> (i32, i32) {
        match self {
            Self::Up => (-1, 0),
            Self::Down => (1, 0),
            Self::Left => (0, -1),
            Self::Right => (0, 1),
        }
    }

    /// The opposite direction.
    #[must_use]
    pub const fn opposite(self) -> Self {
        match self {
            Self::Up => Self::Down,
            Self::Down => Self::Up,
            Self::Left => Self::Right,
            Self::Right => Self::Left,
        }
    }
}

/// The body on each cell of the map.
///
/// The cells are stored in pieces, which clones share until one of them changes: the remembered boards of a large map
/// with few agents take little more memory than one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Grid {
    height: i32,
    width: i32,
    pieces: Vec<Arc<[u16]>>,
    spare: Spare,
}

/// Pieces of forgotten boards, reused for the next pieces that change. They are not part of the map, so clones do not
/// copy and comparisons ignore them.
#[derive(Debug, Default)]
struct Spare(Vec<Arc<[u16]>>);

impl Spare {
    /// Takes a piece of this length, if there is one.
    fn take(&mut self, length: usize) -> Option<Arc<[u16]>> {
        let place = self.0.iter().position(|piece| piece.len() == length)?;
        Some(self.0.swap_remove(place))
    }
}

impl Clone for Spare {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl PartialEq for Spare {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Eq for Spare {}

/// Number of cells of a piece of a grid; the last piece may have fewer.
const PIECE_CELLS: usize = 1024;

/// The stored value of an empty cell; no body has this id.
const EMPTY: u16 = u16::MAX;

impl Grid {
    /// An empty map of `height` rows and `width` columns.
    pub(crate) fn new(height: i32, width: i32) -> Self {
        let area = usize::try_from(height * width).expect("a map has a positive size");
        let pieces = vec![EMPTY; area].chunks(PIECE_CELLS).map(Arc::from).collect();
        Self { height, width, pieces, spare: Spare::default() }
    }

    /// The number of rows.
    #[must_use]
    pub const fn height(&self) -> i32 {
        self.height
    }

    /// The number of columns.
    #[must_use]
    pub const fn width(&self) -> i32 {
        self.width
    }

    /// True if the cell lies on the map.
    #[must_use]
    pub const fn contains(&self, at: Pos) -> bool {
        at.i >= 0 && at.i < self.height && at.j >= 0 && at.j < self.width
    }

    /// The body on a cell; nothing lies on the free ground outside the map.
    #[must_use]
    pub fn get(&self, at: Pos) -> Option<BodyId> {
        if !self.contains(at) {
            return None;
        }
        let id = self.cell(at);
        (id != EMPTY).then_some(BodyId(id))
    }

    /// True if the cell lies on the map and nothing lies on it.
    #[must_use]
    pub fn is_free(&self, at: Pos) -> bool {
        self.contains(at) && self.cell(at) == EMPTY
    }

    /// Puts a body on a cell, or clears it; cells outside the map are ignored.
    pub(crate) fn set(&mut self, at: Pos, body: Option<BodyId>) {
        if self.contains(at) {
            let index = self.index(at);
            let value = body.map_or(EMPTY, |id| id.0);
            // A shared piece is copied only if the cell changes.
            if self.cell(at) != value {
                let piece = &mut self.pieces[index / PIECE_CELLS];
                if Arc::get_mut(piece).is_none()
                    && let Some(mut copy) = self.spare.take(piece.len())
                {
                    Arc::make_mut(&mut copy).copy_from_slice(piece);
                    *piece = copy;
                }
                Arc::make_mut(piece)[index % PIECE_CELLS] = value;
            }
        }
    }

    /// Turns `other`, an earlier state of the same map, into a clone of this one. Pieces that only `other` has are kept
    /// for later changes. A change allocates a new piece only if none is kept, so all boards of an episode and the
    /// spare pieces together have at most as many pieces as those boards would have without sharing.
    pub(crate) fn replace(&mut self, other: &mut Self) {
        for (piece, other) in self.pieces.iter().zip(&mut other.pieces) {
            if Arc::ptr_eq(piece, other) {
                continue;
            }
            let mut before = std::mem::replace(other, Arc::clone(piece));
            if Arc::get_mut(&mut before).is_some() {
                self.spare.0.push(before);
            }
        }
    }

    /// Memory of the cells that are not shared with `other`, in bytes.
    pub(crate) fn bytes_beside(&self, other: &Self) -> usize {
        let pieces = self.pieces.iter().zip(&other.pieces);
        let own: usize = pieces
            .filter(|(piece, other)| !Arc::ptr_eq(piece, other))
            .map(|(piece, _)| size_of_val(&**piece))
            .sum();
        own + size_of_val(&*self.pieces)
    }

    /// Memory of all cells, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        let pieces = self.pieces.iter().chain(&self.spare.0);
        let cells: usize = pieces.map(|piece| size_of_val(&**piece)).sum();
        cells + size_of_val(&*self.pieces)
    }

    fn cell(&self, at: Pos) -> u16 {
        let index = self.index(at);
        self.pieces[index / PIECE_CELLS][index % PIECE_CELLS]
    }

    fn index(&self, at: Pos) -> usize {
        usize::try_from(at.i * self.width + at.j).expect("the cell was found to lie on the map")
    }
}
