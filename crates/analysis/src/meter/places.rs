//! The cells on which agents have stood.

use std::collections::{HashSet, VecDeque};

use swarmbench_engine::Pos;

use super::counts::small;
use crate::game::Setup;

/// A set of cells of the map.
#[derive(Clone, Default)]
struct CellSet(Vec<u64>);

impl CellSet {
    /// Adds a cell by its number; returns whether it is new.
    fn insert(&mut self, cell: usize) -> bool {
        let (word, bit) = (cell / 64, 1 << (cell % 64));
        if self.0.len() <= word {
            self.0.resize(word + 1, 0);
        }
        let is_new = self.0[word] & bit == 0;
        self.0[word] |= bit;
        is_new
    }

    fn contains(&self, cell: usize) -> bool {
        self.0.get(cell / 64).is_some_and(|word| word >> (cell % 64) & 1 == 1)
    }
}

/// The number of a cell, row by row; `None` outside the map.
fn number(setup: &Setup, cell: Pos) -> Option<usize> {
    setup.contains(cell).then(|| {
        usize::try_from(cell.i * setup.width + cell.j).expect("a cell of the map has a number")
    })
}

/// The cells on which agents stood.
#[derive(Default)]
pub(super) struct Explored {
    on_map: CellSet,
    outside: HashSet<Pos>,
    /// The number of these cells on the map.
    pub(super) cells: u32,
}

impl Explored {
    pub(super) fn visit(&mut self, setup: &Setup, cell: Pos) {
        match number(setup, cell) {
            Some(number) => self.cells += u32::from(self.on_map.insert(number)),
            None => {
                self.outside.insert(cell);
            }
        }
    }

    /// The number of these cells, those outside the map included.
    pub(super) fn cells_anywhere(&self) -> u32 {
        self.cells + small(self.outside.len())
    }
}

/// The path of an agent, as far as it is needed to recognize returns to cells that the agent no longer remembers.
#[derive(Clone, Default)]
pub(super) struct Trail {
    left: CellSet,
    /// The cells that the agent left in the rounds that it remembers, with these rounds.
    recent: VecDeque<(u32, Pos)>,
}

impl Trail {
    /// Adds a step onto another cell; returns whether the agent last left that cell more than `memory` rounds ago.
    pub(super) fn step(
        &mut self,
        setup: &Setup,
        memory: u32,
        round: u32,
        from: Pos,
        to: Pos,
    ) -> bool {
        while self.recent.front().is_some_and(|&(left, _)| round - left > memory) {
            self.recent.pop_front();
        }
        let is_revisit = number(setup, to).is_some_and(|cell| self.left.contains(cell))
            && self.recent.iter().all(|&(_, cell)| cell != to);
        if let Some(cell) = number(setup, from) {
            self.left.insert(cell);
        }
        self.recent.push_back((round, from));
        is_revisit
    }
}
