//! The map of one moment as an agent believes it, with the flight of a prey on it.

use swarmbench_engine::tasks::pursuit::{Ground, flight, is_caught};
use swarmbench_engine::{Direction, Kind, Pos, RuleSet};

/// A map with a wall ring, some agents and at most one prey.
#[derive(Clone, Debug)]
pub(super) struct Field {
    height: i32,
    width: i32,
    cells: Vec<Option<Kind>>,
}

impl Field {
    /// An empty map of this size with its wall ring.
    pub(super) fn new(height: i32, width: i32) -> Self {
        let area = usize::try_from(height * width).unwrap_or(0);
        let mut field = Self { height, width, cells: vec![None; area] };
        for i in 0..height {
            for j in 0..width {
                if !field.is_inside(Pos::new(i, j)) {
                    field.put(Pos::new(i, j), Some(Kind::Wall));
                }
            }
        }
        field
    }

    /// True if the cell lies inside the ring.
    pub(super) fn is_inside(&self, at: Pos) -> bool {
        (1..self.height - 1).contains(&at.i) && (1..self.width - 1).contains(&at.j)
    }

    /// Sets or clears the content of a cell; cells outside the map are ignored.
    pub(super) fn put(&mut self, at: Pos, kind: Option<Kind>) {
        if let Some(index) = self.index(at) {
            self.cells[index] = kind;
        }
    }

    /// All empty cells in reading order.
    pub(super) fn empty_cells(&self) -> impl Iterator<Item = Pos> {
        let cells =
            (1..self.height - 1).flat_map(|i| (1..self.width - 1).map(move |j| Pos::new(i, j)));
        cells.filter(|&cell| self.is_free(cell))
    }

    /// The place of a prey on this cell after its own move; `None` if it is caught.
    pub(super) fn after_flight(&self, rules: RuleSet, prey: Pos) -> Option<Pos> {
        let ground = WithPrey { field: self, prey };
        if is_caught(&ground, prey) {
            return None;
        }
        Some(flight(&ground, rules, prey).unwrap_or(prey))
    }

    /// The empty cells beside a cell.
    pub(super) fn gaps(&self, at: Pos) -> impl Iterator<Item = Pos> {
        Direction::ALL
            .into_iter()
            .map(move |side| at.toward(side))
            .filter(|&cell| self.is_free(cell))
    }

    /// True if a prey on this cell could still get away.
    pub(super) fn has_gap(&self, at: Pos) -> bool {
        self.gaps(at).next().is_some()
    }

    fn index(&self, at: Pos) -> Option<usize> {
        let on_map = (0..self.height).contains(&at.i) && (0..self.width).contains(&at.j);
        if on_map { usize::try_from(at.i * self.width + at.j).ok() } else { None }
    }
}

impl Ground for Field {
    fn height(&self) -> i32 {
        self.height
    }

    fn width(&self) -> i32 {
        self.width
    }

    fn kind_at(&self, at: Pos) -> Option<Kind> {
        self.index(at).and_then(|index| self.cells[index])
    }
}

/// A field with a prey on one of its cells: the prey cannot step back onto that cell, as its own body lies there.
struct WithPrey<'a> {
    field: &'a Field,
    prey: Pos,
}

impl Ground for WithPrey<'_> {
    fn height(&self) -> i32 {
        self.field.height
    }

    fn width(&self) -> i32 {
        self.field.width
    }

    fn kind_at(&self, at: Pos) -> Option<Kind> {
        if at == self.prey { Some(Kind::Prey) } else { self.field.kind_at(at) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prey_always_leaves_its_cell() {
        let mut field = Field::new(10, 10);
        for cell in [Pos::new(1, 1), Pos::new(8, 8), Pos::new(5, 5)] {
            assert_ne!(field.after_flight(RuleSet::Paper, cell), Some(cell));
        }
        // One step is free, but from there only the step back.
        for agent in [Pos::new(2, 1), Pos::new(1, 3), Pos::new(2, 2)] {
            field.put(agent, Some(Kind::Agent));
        }
        assert_eq!(field.after_flight(RuleSet::Paper, Pos::new(1, 1)), Some(Pos::new(1, 1)));
        field.put(Pos::new(1, 2), Some(Kind::Agent));
        assert_eq!(field.after_flight(RuleSet::Paper, Pos::new(1, 1)), None);
    }
}
