//! The possible places of an unseen prey, with their likelihood: it starts in one part of the map, flees by a known
//! rule, and a new one appears where the danger is least.

use swarmbench_engine::tasks::pursuit::{Ground, danger};
use swarmbench_engine::{Pos, RuleSet};

use super::field::Field;

/// Share of the total weight below which a place is dropped, which bounds the work.
const LEAST: f64 = 0.01;

/// All possible places of the prey with their relative weights.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Quarry {
    guesses: Vec<(Pos, f64)>,
}

impl Quarry {
    /// The first prey of a game, which starts in the bottom right quarter of the map.
    pub(super) fn first(height: i32, width: i32) -> Self {
        let rows = height / 2 + 1..height - 1;
        let cells = rows.flat_map(|i| (width / 2 + 1..width - 1).map(move |j| Pos::new(i, j)));
        Self { guesses: cells.map(|cell| (cell, 1.0)).collect() }
    }

    /// A new prey, which appears on the first drawn of the least dangerous cells of as many draws as the map has cells.
    pub(super) fn new(field: &Field) -> Self {
        let mut cells: Vec<(Pos, f64)> =
            field.empty_cells().map(|cell| (cell, danger(field, cell))).collect();
        cells.sort_by(|one, other| one.1.total_cmp(&other.1));
        let count = cells.len();
        let draws = field.height() * field.width();
        // The probability that none of the first `cells` cells is drawn.
        let none_of = |cells: usize| share(count - cells, count).powi(draws);
        let mut guesses = Vec::new();
        let mut safer = 0;
        for level in cells.chunk_by(|one, other| one.1.total_cmp(&other.1).is_eq()) {
            let odds = (none_of(safer) - none_of(safer + level.len())) * share(1, level.len());
            guesses.extend(level.iter().map(|(cell, _)| (*cell, odds)));
            safer += level.len();
        }
        Self { guesses }
    }

    /// A prey that is seen.
    pub(super) fn at(cell: Pos) -> Self {
        Self { guesses: vec![(cell, 1.0)] }
    }

    /// A prey that may be anywhere but is not caught.
    pub(super) fn anywhere(field: &Field, is_odd: Option<bool>) -> Self {
        let cells =
            field.empty_cells().filter(|&cell| is_odd.is_none_or(|odd| odd == is_odd_cell(cell)));
        Self { guesses: cells.map(|cell| (cell, 1.0)).collect() }
    }

    /// True if no possible place is left.
    pub(super) fn is_nowhere(&self) -> bool {
        self.guesses.is_empty()
    }

    /// Drops a cell on which the prey is not.
    pub(super) fn rule_out(&mut self, cell: Pos) {
        self.guesses.retain(|(at, _)| *at != cell);
    }

    /// Drops the cells from which an uncaught prey could not have escaped.
    pub(super) fn escape(&mut self, could: impl Fn(Pos) -> bool) {
        self.guesses.retain(|(at, _)| could(*at));
    }

    /// Moves the prey after the agents have moved; it was not caught.
    pub(super) fn flee(&mut self, field: &Field, rules: RuleSet) {
        let total: f64 = self.guesses.iter().map(|(_, weight)| weight).sum();
        let mut moved: Vec<(Pos, f64)> = Vec::new();
        for &(at, weight) in &self.guesses {
            if weight < LEAST * total {
                continue;
            }
            let Some(to) = field.after_flight(rules, at) else { continue };
            match moved.iter_mut().find(|(cell, _)| *cell == to) {
                Some((_, sum)) => *sum += weight,
                None => moved.push((to, weight)),
            }
        }
        self.guesses = moved;
    }

    /// The place that is more likely than all others together, if there is one.
    pub(super) fn likely(&self) -> Option<Pos> {
        let total: f64 = self.guesses.iter().map(|(_, weight)| weight).sum();
        self.guesses.iter().find(|(_, weight)| *weight > total / 2.0).map(|(cell, _)| *cell)
    }

    /// The probability that the prey sits where it cannot move.
    pub(super) fn share_trapped(&self, field: &Field) -> f64 {
        let [even, odd, trapped] = self.weigh(field);
        trapped / (even + odd + trapped)
    }

    /// The most likely whereabouts of the prey.
    pub(super) fn whereabouts(&self, field: &Field) -> Whereabouts {
        let [even, odd, trapped] = self.weigh(field);
        if trapped > even + odd { Whereabouts::Trapped } else { Whereabouts::of(odd > even) }
    }

    /// The weights of all guesses on even cells, on odd ones, and in traps of either kind.
    fn weigh(&self, field: &Field) -> [f64; 3] {
        let mut weights = [0.0; 3];
        for &(at, weight) in &self.guesses {
            let kind = if field.has_gap(at) { usize::from(is_odd_cell(at)) } else { 2 };
            weights[kind] += weight;
        }
        weights
    }
}

/// The knowledge of the prey on which the choice of posts depends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Whereabouts {
    /// The prey sits where it is caught in this round.
    Trapped,
    /// The prey runs free on even cells (row + column).
    Even,
    /// The prey runs free on odd cells.
    Odd,
}

impl Whereabouts {
    /// The whereabouts of a prey that runs free.
    pub(super) const fn of(is_odd: bool) -> Self {
        if is_odd { Self::Odd } else { Self::Even }
    }
}

/// True if row and column add up to an odd number. A prey takes two steps, so it keeps to cells of a kind.
pub(super) fn is_odd_cell(cell: Pos) -> bool {
    (cell.i + cell.j) & 1 == 1
}

fn share(some: usize, all: usize) -> f64 {
    let number = |count: usize| u32::try_from(count).map_or(f64::MAX, f64::from);
    number(some) / number(all).max(1.0)
}

#[cfg(test)]
mod tests {
    use swarmbench_engine::Kind;

    use super::*;

    /// A map of 10 × 10 with agents.
    fn field(agents: &[(i32, i32)]) -> Field {
        let mut field = Field::new(10, 10);
        for &(i, j) in agents {
            field.put(Pos::new(i, j), Some(Kind::Agent));
        }
        field
    }

    #[test]
    fn the_odds_of_a_new_prey_add_up_and_favour_the_least_danger() {
        let quarry = Quarry::new(&field(&[]));
        let total: f64 = quarry.guesses.iter().map(|(_, odds)| odds).sum();
        assert!((total - 1.0).abs() < 1e-9, "{total}");
        // No wall lies in the window of the cell in the middle. It is drawn with 1 - (63 / 64)^100.
        let (cell, odds) = quarry.guesses[0];
        assert_eq!(cell, Pos::new(5, 5));
        assert!((odds - 0.793).abs() < 0.001, "{odds}");
    }

    #[test]
    fn a_prey_keeps_to_cells_of_a_kind() {
        let field = field(&[(3, 3), (6, 2)]);
        let mut quarry = Quarry::first(10, 10);
        assert_eq!(quarry.whereabouts(&field), Whereabouts::Even);
        quarry.guesses.retain(|(at, _)| is_odd_cell(*at));
        for _ in 0..9 {
            quarry.flee(&field, RuleSet::Paper);
            assert_eq!(quarry.whereabouts(&field), Whereabouts::Odd);
        }
    }

    #[test]
    fn what_is_ruled_out_is_no_guess() {
        let mut quarry = Quarry::at(Pos::new(4, 4));
        assert_eq!(quarry.likely(), Some(Pos::new(4, 4)));
        quarry.rule_out(Pos::new(4, 4));
        assert!(quarry.is_nowhere());
        assert_eq!(quarry.likely(), None);
    }

    #[test]
    fn a_closed_corner_is_a_trap() {
        let field = field(&[(1, 2), (2, 1)]);
        assert_eq!(Quarry::at(Pos::new(1, 1)).whereabouts(&field), Whereabouts::Trapped);
        assert_eq!(Quarry::at(Pos::new(1, 3)).whereabouts(&field), Whereabouts::Even);
    }
}
