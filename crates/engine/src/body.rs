//! Bodies, and the board on which they lie.
//!
//! A body has a top-left position, the cells that it occupies relative to it, a mass, and may be
//! fixed (rules: *Physics*). The board keeps bodies and grid in step. Agents are the first bodies:
//! agent `n` is body `n`.

use std::sync::Arc;

use crate::grid::{BodyId, Direction, Grid, Pos};

/// The kind of a body, which decides its symbol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// A player's body.
    Agent,
    /// `W`, a wall.
    Wall,
    /// `N`, the nest of Foraging. By the rules a part of the wall's body; as both are fixed, a
    /// body of its own behaves the same.
    Nest,
    /// `F`, the food of Foraging.
    Food,
    /// `B`, the block of Transport.
    Block,
    /// `P`, the prey of Pursuit.
    Prey,
}

/// The cells of a body relative to its top-left position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Shape {
    /// The single cell at the position itself.
    Cell,
    /// Any number of cells.
    Cells(Arc<[Pos]>),
}

impl Shape {
    fn cells(&self) -> &[Pos] {
        const ORIGIN: [Pos; 1] = [Pos::new(0, 0)];
        match self {
            Self::Cell => &ORIGIN,
            Self::Cells(cells) => cells,
        }
    }
}

/// A body on the board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Body {
    pub(crate) kind: Kind,
    pub(crate) at: Pos,
    pub(crate) shape: Shape,
    pub(crate) mass: i32,
    pub(crate) fixed: bool,
    /// A body that lies wholly outside the map takes no further part.
    pub(crate) gone: bool,
}

impl Body {
    /// An agent at `at`: one cell, mass 1.
    pub(crate) fn agent(at: Pos) -> Self {
        Self::single(Kind::Agent, at, false)
    }

    /// A body of one cell and mass 1.
    pub(crate) fn single(kind: Kind, at: Pos, fixed: bool) -> Self {
        Self { kind, at, shape: Shape::Cell, mass: 1, fixed, gone: false }
    }

    /// A body of the given cells (relative to `at`); its mass is the root of its area, rounded
    /// down (rules: *Physics*).
    pub(crate) fn of_cells(kind: Kind, at: Pos, cells: Vec<Pos>, fixed: bool) -> Self {
        let mass = i32::try_from(cells.len().isqrt()).expect("a body is smaller than a map");
        Self { kind, at, shape: Shape::Cells(cells.into()), mass, fixed, gone: false }
    }

    /// True if the body lies on a single cell.
    pub(crate) const fn is_single(&self) -> bool {
        matches!(self.shape, Shape::Cell)
    }

    /// The cells on which it lies.
    pub fn cells(&self) -> impl Iterator<Item = Pos> + '_ {
        self.shape.cells().iter().map(|cell| self.at.plus(*cell))
    }

    /// The kind of the body.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        self.kind
    }

    /// The top-left position; for a body that has left the map, the position to which it went.
    #[must_use]
    pub const fn at(&self) -> Pos {
        self.at
    }
}

/// All bodies and the grid on which they lie.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Board {
    grid: Grid,
    bodies: Vec<Body>,
    agents: usize,
}

impl Board {
    /// An empty map on which ids `0..agents` are reserved for agents, placed later by [`Board::place_agent`].
    pub(crate) fn new(height: i32, width: i32, agents: usize) -> Self {
        let nowhere = Body { gone: true, ..Body::agent(Pos::new(-1, -1)) };
        Self { grid: Grid::new(height, width), bodies: vec![nowhere; agents], agents }
    }

    /// The grid that maps cells to bodies.
    #[must_use]
    pub const fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The body with this id.
    #[must_use]
    pub fn body(&self, id: BodyId) -> &Body {
        &self.bodies[id.index()]
    }

    /// All bodies, agents first.
    #[must_use]
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// The agents in order of their numbers.
    #[must_use]
    pub fn agents(&self) -> &[Body] {
        &self.bodies[..self.agents]
    }

    /// The kind of the body on a cell, if any.
    #[must_use]
    pub fn kind_at(&self, at: Pos) -> Option<Kind> {
        self.grid.get(at).map(|id| self.body(id).kind)
    }

    /// Adds a body and lays it on the grid.
    pub(crate) fn place(&mut self, body: Body) -> BodyId {
        let id = BodyId(u16::try_from(self.bodies.len()).expect("a board has few bodies"));
        self.bodies.push(body);
        self.cover(id, Some(id));
        id
    }

    /// Places agent number `agent`.
    pub(crate) fn place_agent(&mut self, agent: usize, at: Pos) {
        self.bodies[agent] = Body::agent(at);
        let id = BodyId(u16::try_from(agent).expect("at most 1,024 agents"));
        self.cover(id, Some(id));
    }

    /// Moves a body to another place at once (the prey's own moves).
    pub(crate) fn put(&mut self, id: BodyId, at: Pos) {
        self.cover(id, None);
        self.bodies[id.index()].at = at;
        self.cover(id, Some(id));
    }

    /// Takes a body's cells off the grid until it is [`put`](Board::put) again.
    pub(crate) fn lift(&mut self, id: BodyId) {
        self.cover(id, None);
    }

    /// Makes a body immovable.
    pub(crate) fn fix(&mut self, id: BodyId) {
        self.bodies[id.index()].fixed = true;
    }

    /// Moves all the given bodies by one cell at once.
    pub(crate) fn shift(&mut self, ids: &[BodyId], direction: Direction) {
        for &id in ids {
            self.cover(id, None);
        }
        for &id in ids {
            let at = self.bodies[id.index()].at.toward(direction);
            self.bodies[id.index()].at = at;
            self.cover(id, Some(id));
            let outside = !self.bodies[id.index()].cells().any(|cell| self.grid.contains(cell));
            self.bodies[id.index()].gone = outside;
        }
    }

    /// Approximate memory that is not shared with `other`, in bytes.
    pub(crate) fn bytes_beside(&self, other: &Self) -> usize {
        size_of_val(&*self.bodies) + self.grid.bytes_beside(&other.grid)
    }

    /// Turns `other`, an earlier state of the same board, into a clone of this one, reusing its memory.
    pub(crate) fn replace(&mut self, other: &mut Self) {
        other.bodies.clone_from(&self.bodies);
        self.grid.replace(&mut other.grid);
    }

    /// Approximate memory, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&*self.bodies) + self.grid.bytes()
    }

    fn cover(&mut self, id: BodyId, by: Option<BodyId>) {
        let Self { grid, bodies, .. } = self;
        for cell in bodies[id.index()].cells() {
            grid.set(cell, by);
        }
    }
}
